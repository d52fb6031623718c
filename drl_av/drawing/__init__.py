"""Pictures, films and HTML pages of highway scenes, made without a screen."""

from drl_av.drawing.panels import Caption
from drl_av.drawing.picture import Picture, draw
from drl_av.drawing.renderer import next_caption
from drl_av.drawing.sheet import SHEET_SIZE

__all__ = ["SHEET_SIZE", "Caption", "Picture", "draw", "next_caption"]
