"""Draws a picture of a scene without a screen: road near the ego, loop and panels."""

from functools import lru_cache

import numpy as np
import numpy.typing as npt
from PIL import Image, ImageOps

from drl_av.drawing.canvas import GROUND, OVERSAMPLING, SHEET_SIZE, Canvas
from drl_av.drawing.loop_view import draw_ring, lay_ring
from drl_av.drawing.open_view import draw_open_road, lay_open_road
from drl_av.drawing.panels import (
    Caption,
    draw_decision,
    draw_header,
    draw_history,
    draw_reward,
    lay_cards,
    lay_legend,
)
from drl_av.drawing.road_view import CLOSE_UP, OVERVIEW, draw_band, lay_asphalt, lay_marks
from drl_av.road.road import Road
from drl_av.road.snapshot import Snapshot

Picture = npt.NDArray[np.uint8]


def draw(
    snapshot: Snapshot, road: Road, caption: Caption, size: tuple[int, int] = SHEET_SIZE
) -> Picture:
    """Draw one scene and return the picture, uint8 of shape (height, width, 3).

    ``size`` is (width, height) in px. The layout is scaled to fit; if the aspect ratio differs, it
    gets bars at its sides.
    """
    sheet = Canvas(_background(road).copy())
    for band in (CLOSE_UP, OVERVIEW):
        draw_band(sheet, band, snapshot, road)
    if road.is_loop:
        draw_ring(sheet, snapshot, road)
    else:
        draw_open_road(sheet, snapshot, road)
    draw_header(sheet, snapshot, caption)
    draw_decision(sheet, snapshot, caption)
    draw_reward(sheet, caption)
    draw_history(sheet, caption)
    image = sheet.image.reduce(OVERSAMPLING)
    if size != SHEET_SIZE:
        image = ImageOps.pad(image, size, Image.Resampling.LANCZOS, color=GROUND)
    return np.array(image, dtype=np.uint8)


@lru_cache(maxsize=8)
def _background(road: Road) -> Image.Image:
    """Return the image of the static parts. It is cached: copy it before drawing on it."""
    width, height = SHEET_SIZE
    size = (OVERSAMPLING * width, OVERSAMPLING * height)
    sheet = Canvas(Image.new("RGB", size, GROUND))
    for band in (CLOSE_UP, OVERVIEW):
        lay_asphalt(sheet, band, road)
    lay_marks(sheet)
    lay_cards(sheet)
    if road.is_loop:
        lay_ring(sheet, road)
    else:
        lay_open_road(sheet, road)
    lay_legend(sheet)
    return sheet.image
