"""Draws a picture of each story that ships with drl-av, for the documentation.

python tools/draw_stories.py docs/assets/stories
"""

import argparse
from contextlib import closing
from pathlib import Path

from draw_drive import COLOURS, ROAD_PART, WIDTH_PX
from PIL import Image

from drl_av.drawing.panels import Caption
from drl_av.drawing.picture import draw
from drl_av.env.highway import HighwayEnv

MOMENTS = {
    "stalled_vehicle": 4,
    "barricade": 5,
    "lane_drop": 8,
    "cut_in": 3,
    "fast_overtaker": 8,
    "two_into_one_lane": 3,
}
"""The time of each story's picture, seconds after its start."""
KEEP = 0
"""The number of the action of the ego, which keeps its lane and its speed."""


def main() -> None:
    """Draw the road near the ego at one moment of each story as a PNG file."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("out", type=Path, metavar="DIR", help="folder for the pictures")
    options = parser.parse_args()
    options.out.mkdir(parents=True, exist_ok=True)
    for story, moment in MOMENTS.items():
        drawn = picture(story, moment)
        drawn.save(options.out / f"{story}.png", optimize=True)


def picture(story: str, moment: int) -> Image.Image:
    """Return the picture of a story after ``moment`` decisions of an ego that keeps its lane."""
    calm = {"traffic": {"kind": "calm"}}
    with closing(HighwayEnv(story, "permit_all", calm)) as env:
        env.reset(seed=0)
        for _ in range(moment):
            env.step(KEEP)
        caption = Caption(driver=story, decision=moment)
        drawn = Image.fromarray(draw(env.scene.snapshot, env.road, caption)).crop(ROAD_PART)
    size = WIDTH_PX, WIDTH_PX * drawn.height // drawn.width
    return drawn.resize(size).quantize(COLOURS, Image.Quantize.MAXCOVERAGE)


if __name__ == "__main__":
    main()
