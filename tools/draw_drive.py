"""Draws the animated GIF of the README: a rule, and the shipped driver in the same traffic.

python tools/draw_drive.py docs/drive.gif
"""

import argparse
from collections.abc import Sequence
from contextlib import closing
from pathlib import Path

from PIL import Image

from drl_av.drivers.driver import Driver
from drl_av.drivers.registry import default_config, find_drivers, make_drivers
from drl_av.env.highway import HighwayEnv
from drl_av.env.rollout import rollout
from drl_av.env.video import Film
from drl_av.files.atomic import require_writable

FRAMES_PER_DECISION = 6
FRAME_MS = 90
DRIVERS = "gap-mobil", "pretrained"
"""From the top to the bottom; both drive under the check of the second."""
ROAD_PART = (0, 0, 1280, 376)
"""The part of the picture that the GIF shows, header and road: (left, top, right, bottom), px."""
WIDTH_PX = 880
COLOURS = 128


def main() -> None:
    """Drive one episode with each driver, and write some of its decisions as a GIF."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("out", type=Path, metavar="FILE.gif")
    parser.add_argument("--seed", type=int, default=10, help="seed of the traffic (default: 10)")
    parser.add_argument("--vehicles", type=int, default=15, help="beside the ego (default: 15)")
    parser.add_argument("--first", type=int, default=38, help="first decision (default: 38)")
    parser.add_argument("--last", type=int, default=54, help="last decision (default: 54)")
    options = parser.parse_args()
    require_writable(options.out)
    choices = find_drivers(DRIVERS)
    config = default_config(choices).with_traffic("calm")
    config = config.updated("simulation", decisions_per_episode=options.last)
    with closing(HighwayEnv(config=config)) as env:
        films = [
            film(env, name, driver, options.seed, options.vehicles, options.first)
            for name, driver in make_drivers(choices, config).items()
        ]
    first, *rest = with_one_palette([one_below_another(both) for both in zip(*films, strict=True)])
    first.save(
        options.out, save_all=True, append_images=rest, duration=FRAME_MS, loop=0, optimize=True
    )


def film(
    env: HighwayEnv, name: str, driver: Driver, seed: int, vehicles: int, first: int
) -> list[Image.Image]:
    """Drive an episode; return its frames from the decision ``first`` on."""
    taken, frames = Film(name, env.road, seed), []
    for decision in rollout(env, driver, seed, vehicles):
        taken.add(decision)
    for drawn in taken.pictures(FRAMES_PER_DECISION, first):
        picture = Image.fromarray(drawn).crop(ROAD_PART)
        frames.append(picture.resize((WIDTH_PX, WIDTH_PX * picture.height // picture.width)))
    return frames


def one_below_another(pictures: Sequence[Image.Image]) -> Image.Image:
    """Return one picture of several of the same size."""
    width, height = pictures[0].size
    page = Image.new("RGB", (width, height * len(pictures)))
    for row, picture in enumerate(pictures):
        page.paste(picture, (0, row * height))
    return page


def with_one_palette(frames: list[Image.Image]) -> list[Image.Image]:
    """Reduce all frames to the same few colours; unchanged parts then need no bytes in the file."""
    palette = frames[0].quantize(COLOURS, Image.Quantize.MAXCOVERAGE)
    return [frame.quantize(palette=palette, dither=Image.Dither.NONE) for frame in frames]


if __name__ == "__main__":
    main()
