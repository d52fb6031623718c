"""Colours, and an image with drawing functions in pixels of the picture's layout."""

from functools import lru_cache

import numpy as np
from PIL import Image, ImageDraw, ImageFont

Color = tuple[int, int, int]
Point = tuple[float, float]

CANVAS_SIZE = (1280, 720)
"""Width and height of the layout, px."""
EGO_COLOR: Color = (233, 64, 200)
ALARM: Color = (255, 106, 61)
AMBER: Color = (255, 190, 40)
GROUND: Color = (15, 19, 26)
CARD: Color = (24, 30, 40)
ASPHALT: Color = (45, 51, 62)
BARRED: Color = (58, 49, 46)
RULE: Color = (62, 71, 86)
DIM: Color = (139, 150, 168)
BRIGHT: Color = (238, 242, 248)
DARK: Color = (14, 17, 23)

SLOW_M_S, FAST_M_S = 10.0, 34.0
"""Speeds at the ends of the colour scale; a speed beyond an end gets the colour of that end."""
SPEED_COLORS = np.array(
    [
        (222, 53, 48),
        (246, 130, 67),
        (253, 205, 112),
        (226, 238, 190),
        (120, 205, 205),
        (66, 146, 240),
    ],
    dtype=np.float64,
)
OVERSAMPLING = 2
"""Image pixels per pixel of the layout, in each direction."""


def speed_color(speed_m_s: float) -> Color:
    """Return the colour of a speed in m/s, from red (slow) to blue (fast).

    Colour-blind people can also distinguish the colours.
    """
    share = np.clip((speed_m_s - SLOW_M_S) / (FAST_M_S - SLOW_M_S), 0.0, 1.0)
    knots = np.linspace(0.0, 1.0, len(SPEED_COLORS))
    red, green, blue = (round(float(np.interp(share, knots, c))) for c in SPEED_COLORS.T)
    return red, green, blue


class Canvas:
    """An oversampled image; all its methods take coordinates in pixels of the layout."""

    def __init__(self, image: Image.Image) -> None:
        self.image = image
        self._pen = ImageDraw.Draw(image)

    def box(
        self,
        corners: tuple[float, float, float, float],
        fill: Color,
        radius: float = 0.0,
        outline: Color | None = None,
        width: float = 0.0,
    ) -> None:
        """Draw a rounded rectangle with ``corners`` (left, top, right, bottom)."""
        k = OVERSAMPLING
        left, top, right, bottom = (round(k * c) for c in corners)
        ends = (left, top, max(left, right - 1), max(top, bottom - 1))
        self._pen.rounded_rectangle(ends, k * radius, fill, outline, round(k * width))

    def dot(self, center: Point, radius: float, fill: Color) -> None:
        """Draw a filled circle; ``center`` (x, y) and ``radius`` are in px of the layout."""
        x, y, r = (OVERSAMPLING * v for v in (*center, radius))
        self._pen.ellipse((x - r, y - r, x + r, y + r), fill)

    def arc(self, center: Point, radius: float, degrees: Point, fill: Color, width: float) -> None:
        """Draw an arc with the outer radius ``radius`` and the line width ``width``.

        ``degrees`` holds the angles of its two ends, clockwise from the right.
        """
        x, y, r = (OVERSAMPLING * v for v in (*center, radius))
        self._pen.arc((x - r, y - r, x + r, y + r), *degrees, fill, round(OVERSAMPLING * width))

    def line(self, points: list[Point], fill: Color, width: float) -> None:
        """Draw a line through all points."""
        scaled = [(OVERSAMPLING * x, OVERSAMPLING * y) for x, y in points]
        self._pen.line(scaled, fill, round(OVERSAMPLING * width), joint="curve")

    def polygon(self, points: list[Point], fill: Color) -> None:
        """Draw a filled polygon."""
        self._pen.polygon([(OVERSAMPLING * x, OVERSAMPLING * y) for x, y in points], fill)

    def text(
        self,
        at: Point,
        text: str,
        size: int,
        fill: Color = BRIGHT,
        anchor: str = "ls",
        bold: bool = False,
    ) -> None:
        """Draw one line of text.

        ``anchor`` is Pillow's code for the point of the text that lies at ``at``; the default "ls"
        is the left end of the baseline.
        """
        place = (OVERSAMPLING * at[0], OVERSAMPLING * at[1])
        stroke = 0.018 * size * OVERSAMPLING if bold else 0
        self._pen.text(
            place, text, fill, _font(size), anchor, stroke_width=stroke, stroke_fill=fill
        )


@lru_cache(maxsize=32)
def _font(size: int) -> ImageFont.FreeTypeFont | ImageFont.ImageFont:
    """Return the default font; ``size`` is in pixels of the layout."""
    return ImageFont.load_default(OVERSAMPLING * size)


@lru_cache(maxsize=512)
def wrapped(text: str, size: int, width: int, most: int) -> tuple[str, ...]:
    """Return the text as at most ``most`` lines of at most ``width`` px; dots replace the rest."""
    font = _font(size)
    lines = [""]
    for word in text.split():
        longer = f"{lines[-1]} {word}".strip()
        if not lines[-1] or font.getlength(longer) <= OVERSAMPLING * width:
            lines[-1] = longer
        else:
            lines.append(word)
    if len(lines) > most:
        lines = [*lines[: most - 1], " ".join(lines[most - 1 :])]
    return tuple(_shortened(line, font, OVERSAMPLING * width) for line in lines)


def _shortened(line: str, font: ImageFont.FreeTypeFont | ImageFont.ImageFont, width: int) -> str:
    """Return the line; if it is longer than ``width`` image pixels, dots replace its end."""
    if font.getlength(line) <= width:
        return line
    while line and font.getlength(line + "...") > width:
        line = line[:-1]
    return line.rstrip(" ,") + "..."
