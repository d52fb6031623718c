"""The README's picture: the shipped driver in the middle of a lane change.

python tools/draw_picture.py docs/drive.png
"""

import argparse
from dataclasses import replace
from pathlib import Path

from PIL import Image

from drl_av.drawing import draw
from drl_av.env.highway import HighwayEnv
from drl_av.env.rollout import drive
from drl_av.evaluation.drivers import build, choose, config_of


class LaneChangePicture:
    """A watcher that draws the first lane change after ``from_decision`` when it is half done."""

    def __init__(self, driver: str, from_decision: int) -> None:
        self.driver, self.from_decision = driver, from_decision
        self.image: Image.Image | None = None

    def __call__(self, env: HighwayEnv) -> None:
        change, affordances = env.scene.lane_change, env.scene.affordances
        if self.image is None and change is not None and env.decisions >= self.from_decision:
            crossed = (
                abs(affordances.ego_y_m - change.origin * affordances.lane_width_m)
                / affordances.lane_width_m
            )
            if 0.3 < crossed < 0.5:
                caption = replace(env.caption, driver=self.driver)
                self.image = Image.fromarray(draw(env.scene.snapshot, env.road, caption))


def main() -> None:
    """Drive, and draw."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("out", type=Path, metavar="FILE.png")
    parser.add_argument("--seed", type=int, default=12, help="of the traffic (default: 12)")
    parser.add_argument("--vehicles", type=int, default=15, help="(default: 15)")
    parser.add_argument("--from-decision", type=int, default=40, help="(default: 40)")
    options = parser.parse_args()
    choices = choose(["pretrained"])
    config = config_of(choices)
    picture = LaneChangePicture("double DQN", options.from_decision)
    env = HighwayEnv(config=config, render_mode="rgb_array")
    [(name, driver)] = build(choices, config).items()
    drive(env, driver, name, options.seed, options.vehicles, picture)
    env.close()
    if picture.image is None:
        raise SystemExit("No lane change in this episode: try another --seed.")
    picture.image.quantize(256).save(options.out, optimize=True)


if __name__ == "__main__":
    main()
