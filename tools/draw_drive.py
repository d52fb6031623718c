"""Draws the animated GIF of the README: the shipped driver overtakes.

python tools/draw_drive.py docs/drive.gif
"""

import argparse
from pathlib import Path

from PIL import Image

from drl_av.drivers.registry import default_config, find_drivers, make_drivers
from drl_av.env.highway import HighwayEnv
from drl_av.env.rollout import rollout
from drl_av.env.video import Film

FRAMES_PER_DECISION = 6
FRAME_MS = 90
ROAD_PART = (0, 0, 1280, 376)
"""The part of the picture that the GIF shows, header and road: (left, top, right, bottom), px."""
WIDTH_PX = 880
COLOURS = 128


def main() -> None:
    """Drive one episode, and write some of its decisions as a GIF."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("out", type=Path, metavar="FILE.gif")
    parser.add_argument("--seed", type=int, default=3, help="seed of the traffic (default: 3)")
    parser.add_argument("--vehicles", type=int, default=15, help="beside the ego (default: 15)")
    parser.add_argument("--first", type=int, default=58, help="first decision (default: 58)")
    parser.add_argument("--last", type=int, default=73, help="last decision (default: 73)")
    options = parser.parse_args()
    frames = overtaking(options.seed, options.vehicles, options.first, options.last)
    first, *rest = with_one_palette(frames)
    first.save(
        options.out, save_all=True, append_images=rest, duration=FRAME_MS, loop=0, optimize=True
    )


def overtaking(seed: int, vehicles: int, first: int, last: int) -> list[Image.Image]:
    """Drive an episode with the shipped driver; return the frames of decisions first to last."""
    choices = find_drivers(["pretrained"])
    config = default_config(choices).updated("simulation", decisions_per_episode=last)
    env = HighwayEnv(config=config)
    [driver] = make_drivers(choices, config).values()
    film, frames = Film("the shipped driver", env.road, seed), []
    for decision in rollout(env, driver, seed, vehicles):
        film.add(decision)
    for drawn in film.pictures(FRAMES_PER_DECISION, first):
        picture = Image.fromarray(drawn).crop(ROAD_PART)
        frames.append(picture.resize((WIDTH_PX, WIDTH_PX * picture.height // picture.width)))
    env.close()
    return frames


def with_one_palette(frames: list[Image.Image]) -> list[Image.Image]:
    """Reduce all frames to the same few colours; unchanged parts then need no bytes in the file."""
    palette = frames[0].quantize(COLOURS, Image.Quantize.MAXCOVERAGE)
    return [frame.quantize(palette=palette, dither=Image.Dither.NONE) for frame in frames]


if __name__ == "__main__":
    main()
