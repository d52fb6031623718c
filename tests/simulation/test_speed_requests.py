"""SUMO is asked for the leaders of few vehicles, and none that comes near its limit is left out."""

from contextlib import ExitStack, closing
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from drl_av.arrays import FloatArray
from drl_av.config import Config
from drl_av.env.highway import HighwayEnv
from drl_av.road.road import OPEN_LAP_M
from drl_av.road.snapshot import NO_COMMANDS
from drl_av.scenarios.folder import write_scenario
from drl_av.scenarios.road_types import ROAD_TYPES
from drl_av.simulation import speed_requests
from drl_av.simulation.speed_requests import near_limit, stoppable_speed

LAP_M, LANE_M, STEP_S = 500.0, 3.8, 0.5


def found(
    motion: FloatArray,
    elapsed_s: float = 0.0,
    braking: float = 4.0,
    accel: float = 2.0,
    known_m: float = np.inf,
    lap_m: float = LAP_M,
) -> list[int]:
    """The rows near their limit; ``motion`` has a row (s, y, speed) for each vehicle."""
    n = len(motion)
    columns = np.vstack((np.array(motion, np.float64).T, np.full(n, np.nan)))
    limits = np.repeat([[5.0], [1.8], [braking], [accel], [0.76], [2.5]], n, axis=1)
    rows = np.empty(n, np.int64)
    wishes = NO_COMMANDS.rows, NO_COMMANDS.acceleration_m_s2
    road_m = lap_m, LANE_M, known_m
    count = near_limit(
        np.ascontiguousarray(columns), limits, *wishes, elapsed_s, STEP_S, *road_m, rows
    )
    return rows[:count].tolist()


FAR_EGO = (250.0, 7.6, 30.0)
BEHIND = (100.0, 3.8, 20.0)


@pytest.mark.parametrize(
    ("gap_m", "y_m", "speed_m_s", "near"),
    [
        # at most 21 m/s at the end of the step, from which it stops in 21^2/8 + 21/4 = 60.375 m;
        # the vehicle ahead brakes from 20 m/s to a standstill within 20^2/8 - 20/4 = 45 m
        *((15.4, 3.8, 20.0, True), (15.6, 3.8, 20.0, False)),
        *((60.4, 3.8, 0.0, True), (60.6, 3.8, 0.0, False)),
        *((5.0, 7.6, 0.0, False), (5.0, 7.6 - 1.1, 0.0, True)),
        *((5.0, 7.6 - 0.8, 0.0, False), (5.0, 0.7, 0.0, False)),
    ],
    ids=[
        *("as fast", "as fast, farther", "standing", "standing, farther"),
        *("in the next lane", "its body comes in", "its body nearly does", "on the other side"),
    ],
)
def test_a_vehicle_is_near_its_limit_if_it_could_not_stop_behind_the_one_ahead(
    gap_m: float, y_m: float, speed_m_s: float, near: bool
) -> None:
    ahead = (100.0 + 5.0 + 2.5 + gap_m, y_m, speed_m_s)
    assert found([FAR_EGO, BEHIND, ahead]) == ([1] if near else [])


def test_in_the_course_of_a_decision_vehicles_move_by_their_speeds_and_come_from_the_side() -> None:
    beside = (120.0, 7.6 - 0.8, 20.0)
    assert found([FAR_EGO, BEHIND, beside]) == []
    assert found([FAR_EGO, BEHIND, beside], 0.5) == [1]  # 0.38 m are enough to touch the line
    # 16.1 m, too much; one step on, 10 m/s have become 5 m of it
    assert found([FAR_EGO, BEHIND, (123.6, 3.8, 20.0)]) == []
    slower = (100.0 + 7.5 + 53.0, 3.8, 10.0)  # stops within 10 m: 63.0 m
    assert found([FAR_EGO, BEHIND, slower]) == []
    assert found([FAR_EGO, BEHIND, slower], 0.5) == [1]


def test_the_one_ahead_may_be_the_ego_and_beyond_the_seam_of_the_loop() -> None:
    assert found([(5.0, 3.8, 20.0), (490.0, 3.8, 20.0)]) == [1]
    assert found([(490.0, 3.8, 20.0), (5.0, 3.8, 20.0)]) == []
    # on its way to the same lane, and beside it: half a second later 0.35 m ahead of it
    assert found([(499.9, 6.8, 21.0), (0.05, 3.8, 20.0)]) == []
    assert found([(499.9, 6.8, 21.0), (0.05, 3.8, 20.0)], 0.5) == [1]


def test_what_is_beyond_the_watched_part_of_an_open_road_may_stand() -> None:
    # its front is at 102.5 m; 60.4 m and SUMO's 2.5 m beyond
    assert found([FAR_EGO, BEHIND], known_m=165.5, lap_m=OPEN_LAP_M) == []
    assert found([FAR_EGO, BEHIND], known_m=165.4, lap_m=OPEN_LAP_M) == [1]


places = st.tuples(
    st.floats(0.0, LAP_M, exclude_max=True),
    st.sampled_from([0.0, 3.8, 7.6]) | st.floats(0.0, 7.6),
    st.floats(0.0, 40.0),
)


@given(
    st.lists(places, min_size=2, max_size=8),
    st.sampled_from([0.0, 0.5, 1.0]),
    st.floats(1.0, 9.0),
    st.floats(0.1, 5.0),
    st.data(),
)
def test_wherever_the_vehicles_have_gone_nobody_else_is_near_its_limit(
    motion: Any, elapsed_s: float, braking: float, accel: float, data: st.DataObject
) -> None:
    near = found(motion, elapsed_s, braking, accel)
    moved_m = data.draw(
        st.lists(st.floats(-0.76, 0.76), min_size=len(motion), max_size=len(motion))
    )
    now = [
        ((s + (elapsed_s > 0.0) * v * STEP_S) % LAP_M, y + aside * elapsed_s, v)
        for (s, y, v), aside in zip(motion, moved_m, strict=True)
    ]
    for row, (s, y, v) in enumerate(now[1:], 1):
        center_m = LANE_M * np.floor(y / LANE_M + 0.5)
        for other, (its_s, its_y, its_v) in enumerate(now):
            if other == row or abs(its_y - center_m) >= LANE_M / 2 + 0.9:
                continue
            gap_m = (its_s - s) % LAP_M - 5.0 - 2.5
            if stoppable_speed(gap_m, its_v, braking, STEP_S) < v + accel * STEP_S:
                assert row in near


# Whole episodes in SUMO


CALM = {"kind": "calm", "keep_stopping_distance": True}
KINDS = {
    "calm": CALM,
    "lanes change often": CALM | {"random_lane_changes_per_s": 0.1},
    "trucks": CALM | {"truck_share": 0.4, "speed_gain_max": 1.0},
    **{kind: {"kind": kind} for kind in ("paper", "hazards", "naturalistic")},
}


def everybody(*arguments: Any) -> int:
    """In place of ``near_limit``: everybody is near its limit, as far as we know."""
    near_limit.fast(*arguments)
    rows = arguments[-1]
    rows[: len(rows) - 1] = range(1, len(rows))
    return len(rows) - 1


def driven(env: HighwayEnv, seed: int, vehicles: int, decisions: int = 40) -> list[bytes]:
    """The states of all vehicles around an ego that acts at random."""
    rng, states = np.random.default_rng(seed), []
    env.reset(seed=seed, options={"vehicles": vehicles})
    for _ in range(decisions):
        _, _, collided, truncated, _ = env.step(int(rng.integers(12)))
        states.append(np.array(env.scene.snapshot[2:8]).tobytes())
        if collided or truncated:
            break
    return states


def both_ways(env: HighwayEnv, monkeypatch: pytest.MonkeyPatch, *of: int) -> list[list[bytes]]:
    """The same episode: SUMO is asked for few leaders, and for all."""
    trajectories = [driven(env, *of)]
    with monkeypatch.context() as patch:
        patch.setattr(speed_requests, "near_limit", SimpleNamespace(fast=everybody))
        trajectories.append(driven(env, *of))
    return trajectories


@pytest.mark.parametrize("kind", KINDS)
def test_the_traffic_drives_as_if_sumo_were_asked_for_every_leader(
    kind: str, stack: ExitStack, monkeypatch: pytest.MonkeyPatch
) -> None:
    settings: dict[str, Any] = {"safety": {"check": "paper"}, "traffic": KINDS[kind]}
    env = stack.enter_context(closing(HighwayEnv(config=settings)))
    for seed, vehicles in ((7, 5), (2, 30), (3, 45)):
        few, all_of_them = both_ways(env, monkeypatch, seed, vehicles)
        assert few == all_of_them


@pytest.mark.parametrize("kind", ["straight", "merge", "exit", "ramp_to_ramp"])
def test_on_open_roads_too(
    kind: str, tmp_path: Path, stack: ExitStack, monkeypatch: pytest.MonkeyPatch
) -> None:
    write_scenario(tmp_path / "road", ROAD_TYPES[kind]())
    config = Config().with_traffic("naturalistic")  # in which the vehicles beyond the end count
    env = stack.enter_context(closing(HighwayEnv(tmp_path / "road", config=config)))
    few, all_of_them = both_ways(env, monkeypatch, 1, 40)
    assert few == all_of_them


def test_in_free_flow_hardly_a_leader_is_asked_for(
    stack: ExitStack, monkeypatch: pytest.MonkeyPatch
) -> None:
    config = Config().updated("traffic", keep_stopping_distance=True)
    env = stack.enter_context(closing(HighwayEnv(config=config)))
    driven(env, 1, 10, 1)
    requests, asked = env.simulation._requests, []
    leader = requests._leader
    monkeypatch.setattr(requests, "_leader", lambda *of: asked.append(of) or leader(*of))
    for _ in range(100):
        env.step(0)
    assert 0 < len(asked) < 0.1 * 100 * 2 * 10
