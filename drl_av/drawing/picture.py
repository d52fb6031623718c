"""Draws a picture of a scene without a screen: road near the ego, loop and panels."""

from functools import lru_cache

import numpy as np
import numpy.typing as npt
from PIL import Image, ImageOps

from drl_av.drawing.canvas import CANVAS_SIZE, GROUND, OVERSAMPLING, Canvas
from drl_av.drawing.overview import draw_open_road, draw_ring, lay_open_road, lay_ring
from drl_av.drawing.panels import (
    Caption,
    draw_decision,
    draw_header,
    draw_history,
    draw_reward,
    lay_cards,
    lay_legend,
)
from drl_av.drawing.road_view import CLOSE_UP, OVERVIEW, draw_strip, lay_asphalt, lay_marks
from drl_av.road.road import Road
from drl_av.road.snapshot import Snapshot

Picture = npt.NDArray[np.uint8]


def draw(
    snapshot: Snapshot, road: Road, caption: Caption, size: tuple[int, int] = CANVAS_SIZE
) -> Picture:
    """Draw one scene and return the picture, uint8 of shape (height, width, 3).

    ``size`` is (width, height) in px. The layout is scaled to fit; if the aspect ratio differs, it
    gets bars at its sides.
    """
    canvas = Canvas(_background(road).copy())
    for strip in (CLOSE_UP, OVERVIEW):
        draw_strip(canvas, strip, snapshot, road)
    if road.is_loop:
        draw_ring(canvas, snapshot, road)
    else:
        draw_open_road(canvas, snapshot, road)
    draw_header(canvas, snapshot, caption)
    draw_decision(canvas, snapshot, caption)
    draw_reward(canvas, caption)
    draw_history(canvas, caption)
    image = canvas.image.reduce(OVERSAMPLING)
    if size != CANVAS_SIZE:
        image = ImageOps.pad(image, size, Image.Resampling.LANCZOS, color=GROUND)
    return np.array(image, dtype=np.uint8)


@lru_cache(maxsize=8)
def _background(road: Road) -> Image.Image:
    """Return the image of the static parts. It is cached: copy it before drawing on it."""
    width, height = CANVAS_SIZE
    size = (OVERSAMPLING * width, OVERSAMPLING * height)
    canvas = Canvas(Image.new("RGB", size, GROUND))
    for strip in (CLOSE_UP, OVERVIEW):
        lay_asphalt(canvas, strip, road)
    lay_marks(canvas)
    lay_cards(canvas)
    if road.is_loop:
        lay_ring(canvas, road)
    else:
        lay_open_road(canvas, road)
    lay_legend(canvas)
    return canvas.image
