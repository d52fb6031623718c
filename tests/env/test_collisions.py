"""No collision is missed in SUMO, and none is invented: beside a witness that looks often.

At 1 s a SUMO step, bodies 5 m long come right through each other at 20 m/s.
"""

from collections import Counter
from collections.abc import Iterator
from contextlib import closing
from dataclasses import replace

import numpy as np
import pytest
from oracles.plan import next_lane_change

from drl_av.arrays import FloatArray
from drl_av.config import Config
from drl_av.drivers.rule_based import RandomDriver
from drl_av.driving.actions import Action, Lateral
from drl_av.driving.scene import Scene
from drl_av.env.highway import HighwayEnv
from drl_av.road.snapshot import Collision, CollisionKind, Snapshot
from drl_av.safety.check import Rule, Verdict
from drl_av.scenarios.folder import PlacedVehicle

LOOKS = np.linspace(0.0, 1.0, 401)[:, None]
"""At 40 m/s and steps of 1 s a look every 10 cm."""


class Witness:
    """Looks at the vehicles 400 times in each SUMO step, on a straight way between its ends."""

    def __init__(self, env: HighwayEnv) -> None:
        self.env = env
        env.simulation.after_step = self.look
        self.depth_m = -np.inf

    def reset(self, seed: int, vehicles: int | None = None) -> None:
        self.env.reset(seed=seed, options={} if vehicles is None else {"vehicles": vehicles})
        self._before = self.env.scene.snapshot

    def look(self, after: Snapshot) -> None:
        """Note how deep the ego is in another body in this step, negative for the way to it."""
        before, self._before = self._before, after
        lap_m = self.env.road.lap_m
        near = np.abs(after.y_m - after.y_m[0]) < 4.0
        moved_m = (after.s_m - before.s_m) % lap_m
        moved_m = np.where(moved_m > lap_m / 2, 0.0, moved_m)  # a rounding error backward
        s_m, y_m = before.s_m + LOOKS * moved_m, before.y_m + LOOKS * (after.y_m - before.y_m)
        self.depth_m = self._depth_m(s_m[:, near], y_m[:, near], lap_m)

    def _depth_m(self, s_m: FloatArray, y_m: FloatArray, lap_m: float) -> float:
        apart_m = np.abs(s_m[:, 1:] - s_m[:, :1]) % lap_m
        lengthwise_m = 5.0 - np.minimum(apart_m, lap_m - apart_m)
        sideways_m = 1.8 - np.abs(y_m[:, 1:] - y_m[:, :1])
        return float(np.minimum(lengthwise_m, sideways_m).max(initial=-np.inf))

    def agrees(self, collision: Collision | None) -> bool:
        """Whether the ego collided in the last step, but for the way between two looks."""
        return self.depth_m > -0.11 if collision else self.depth_m <= 0


def plant(lateral_plant: str, step_s: float) -> Config:
    config = Config().with_traffic("calm").updated("simulation", step_length_s=step_s)
    config = config.updated("traffic", random_lane_changes_per_s=0.0)
    return config.updated("ego", lateral_plant=lateral_plant)


def on_the_road(scene: Scene, proposed: Action) -> Verdict:
    """Permits all but to leave the road, which would end most episodes."""
    change = next_lane_change(scene.lane_change, scene.affordances.lane, proposed.lateral)
    if change is None or 0 <= change.target <= 2:
        return Verdict(proposed, Rule.NONE)
    return Verdict(proposed._replace(lateral=Lateral.KEEP), Rule.OFF_ROAD)


@pytest.fixture(
    params=[(name, s) for name in ("kinematic", "steering") for s in (1.0, 0.5, 0.25)],
    ids=lambda found: "{}-{}".format(*found),
)
def unchecked(request: pytest.FixtureRequest) -> Iterator[Witness]:
    # vehicles that keep a stopping distance hit no vehicle from behind
    config = plant(*request.param).updated("traffic", keep_stopping_distance=False)
    with closing(HighwayEnv(config=config, safety_check=on_the_road)) as env:
        yield Witness(env)


def watch_step(witness: Witness, action: int) -> tuple[CollisionKind | None, bool]:
    """One decision, of which the witness says the same; how it ended, and whether the episode."""
    _, _, terminated, truncated, info = witness.env.step(action)
    kind = CollisionKind(info["collision"]) if info["collision"] else None
    met = None if kind is None else Collision(kind, info["collided_with"] or None)
    assert witness.agrees(met)
    return kind, terminated or truncated


def test_the_random_driver_collides_where_the_witness_says_so(unchecked: Witness) -> None:
    driver, env, ends = RandomDriver(), unchecked.env, Counter()
    for seed in range(10):
        unchecked.reset(seed, 30)
        driver.start(seed)
        over = False
        while not over:
            kind, over = watch_step(unchecked, driver.act(env.scene, env.indicators).number)
            ends[kind] += 1
    assert ends.total() - ends[None] > 6
    assert ends[CollisionKind.HIT_BESIDE] > 1


def approaches(rng: np.random.Generator) -> Iterator[tuple[PlacedVehicle, PlacedVehicle]]:
    """The ego in the middle lane and another, which drive at 20 to 25 m/s towards each other."""
    while True:
        slow, gap_m, rear_m = rng.uniform(0.0, 5.0), rng.uniform(5.0, 60.0), rng.uniform(0.0, 500.0)
        fast, lane = slow + rng.uniform(20.0, 25.0), int(rng.choice([0, 1, 1, 2]))
        rear, front = ("ego", "other") if rng.random() < 0.5 else ("other", "ego")
        lanes = {"ego": 1, "other": lane}
        placed = {
            rear: PlacedVehicle(rear, lanes[rear], rear_m, fast, fast),
            front: PlacedVehicle(front, lanes[front], (rear_m + 5 + gap_m) % 500, slow, slow + 0.1),
        }
        yield placed["ego"], placed["other"]


def test_placed_approaches_at_20_m_s_collide_where_the_witness_says_so(unchecked: Witness) -> None:
    rng, simulation, ends = np.random.default_rng(11), unchecked.env.simulation, Counter()
    empty = simulation.scenario
    for number, (ego, other) in zip(range(40), approaches(rng), strict=False):
        description = replace(empty.description, vehicles=(ego, other))
        simulation.fleet.scenario = replace(empty, description=description)
        unchecked.reset(number)
        simulation._sumo.vehicle.setSpeedMode("other", 32)
        simulation._sumo.vehicle.setSpeed("other", other.speed_m_s)
        action, over, kind = int(rng.choice([0, 0, 4, 8])), False, None
        while not over and unchecked.env.decisions < 6:
            kind, over = watch_step(unchecked, action)
        ends[kind] += 1
    assert min(ends[CollisionKind.HIT_AHEAD], ends[CollisionKind.HIT_FROM_BEHIND], ends[None]) > 3
