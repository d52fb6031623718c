"""Lane changes that a scenario sets for its placed vehicles, and vehicles that leave its road."""

from contextlib import closing
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from drl_av.config import Config
from drl_av.errors import ScenarioError
from drl_av.road.snapshot import Command, Snapshot
from drl_av.scenarios.folder import load_scenario, read_description, write_scenario
from drl_av.scenarios.highways import MergeDescription, StraightDescription
from drl_av.scenarios.loop import ScenarioDescription
from drl_av.scenarios.road_description import PlacedVehicle
from drl_av.simulation.fleet import Fleet
from drl_av.simulation.simulation import Simulation

EGO = PlacedVehicle("ego", 1, 300.0, 20.0, 30.0)
MOVER = PlacedVehicle("mover", 2, 400.0, 20.0, 20.0, ((2.0, 1), (12.5, 0)))
STAYER = PlacedVehicle("stayer", 2, 500.0, 20.0, 20.0)
ROAD = StraightDescription(vehicles=(EGO, STAYER, MOVER))


def after(folder: Path, description: Any, decisions: int, **traffic: float) -> list[Snapshot]:
    """The snapshots at the reset and after each decision of an ego that keeps lane and speed."""
    write_scenario(folder, description)
    config = Config().with_traffic("calm").updated("traffic", **traffic)
    with closing(Simulation(load_scenario(folder), config)) as simulation:
        found = [simulation.reset(seed=0, vehicles=2)]
        ego = Command(float(found[0].speed_m_s[0]), float(found[0].y_m[0]), 0.0)
        return found + [simulation.advance([ego] * 2)[0] for _ in range(decisions)]


def test_a_vehicle_changes_lanes_at_the_first_decision_at_or_after_each_set_time(
    tmp_path: Path,
) -> None:
    shots = after(tmp_path / "road", ROAD, 20, random_lane_changes_per_s=0.0)
    lateral_m = np.array([shot.y_m[2] for shot in shots])
    assert lateral_m[:3] == pytest.approx(7.6)  # until 2 s
    assert lateral_m[3] == pytest.approx(7.6 - 0.76)  # SUMO moves 0.76 m/s aside
    assert lateral_m[9:14] == pytest.approx(3.8)  # at 12.5 s no decision begins, but at 13 s
    assert lateral_m[14] == pytest.approx(3.8 - 0.76)
    assert lateral_m[-1] == pytest.approx(0.0)
    assert [shot.y_m[1] for shot in shots] == pytest.approx([7.6] * 21)  # the other one stays


def test_a_change_is_due_once_from_its_time_on_in_each_episode(tmp_path: Path) -> None:
    write_scenario(tmp_path / "road", ROAD)
    config = Config().with_traffic("calm").updated("traffic", random_lane_changes_per_s=0.0)
    fleet = Fleet(load_scenario(tmp_path / "road"), config)
    in_lane_2, in_lane_1 = [3.8, 7.6, 7.6], [3.8, 7.6, 3.8]
    for _ in range(2):
        fleet.draw(seed=0, vehicles=2)
        assert fleet.lane_changes(1.9, in_lane_2) == []
        assert fleet.lane_changes(2.0, in_lane_2) == [(2, -1)]
        assert fleet.lane_changes(3.0, in_lane_2) == []
        assert fleet.lane_changes(60.0, in_lane_1) == [(2, -1)]


def test_a_placed_vehicle_leaves_an_open_road_305_m_beyond_its_end(tmp_path: Path) -> None:
    # it passes 600 m after 4 s and 905 m after 10.2 s; SUMO's own road ends at 1,100 m
    fast = PlacedVehicle("fast", 2, 400.0, 50.0, 50.0)
    mover = replace(MOVER, position_m=300.0, lane_changes=((12.0, 1),))
    road = StraightDescription(length_m=300.0, speed_limit_m_s=60.0, vehicles=(EGO, fast, mover))
    shots = after(tmp_path / "road", road, 16, random_lane_changes_per_s=0.3)
    ids = [shot.ids for shot in shots]
    assert ids[10] == ("ego", "fast", "mover")
    assert ids[11:] == [("ego", "mover")] * 6
    assert shots[-1].s_m[1] > 500.0  # the right vehicle has left


def test_the_file_says_the_changes_and_only_those_that_there_are(tmp_path: Path) -> None:
    path = tmp_path / "road.toml"
    path.write_text('kind = "straight"\n' + ROAD.to_toml())
    assert read_description(path) == ROAD
    assert path.read_text().count("lane_changes") == 1
    short = path.read_text().partition("lane_changes")[0] + "lane_changes = [[2, 1], [12.5, 0]]\n"
    path.write_text(short)
    assert read_description(path) == ROAD


@pytest.mark.parametrize(
    ("changes", "reason"),
    [
        (3, r"lane_changes is 3, but must be pairs \[time, lane\]"),
        ([[1.0]], r"lane_changes is \[\[1.0\]\], but must be pairs"),
        ([["1", 1]], "but must be pairs"),
        ([[1.0, 1.0]], "but must be pairs"),
        ([[10**400, 1]], "but must be pairs"),
        ([[float("nan"), 1]], "has nan s to lane 1, but each change must"),
        ([[-0.5, 1]], "has -0.5 s to lane 1, but .* from 0 to 86400 s"),
        ([[86401, 1]], "from 0 to 86400 s"),
        ([[1, 0]], "has 1 s to lane 0, but .* lead to a lane beside it, here 2"),
        ([[1, 1], [1, 0]], "has 1 s to lane 0, but each change must come after the one before"),
        ([[1, 1], [2, 1]], "has 2 s to lane 1, but .* beside it, here 1"),
    ],
)
def test_changes_that_cannot_be_are_refused(changes: Any, reason: str) -> None:
    with pytest.raises(ScenarioError, match=rf"^Vehicle 'mover': .*{reason}"):
        PlacedVehicle("mover", 2, 400.0, 20.0, 20.0, changes)


def test_the_ego_and_lanes_that_are_not_there_are_refused() -> None:
    with pytest.raises(ScenarioError, match=r"^The ego has lane_changes, but its driver decides"):
        PlacedVehicle("ego", 1, 300.0, 20.0, 30.0, ((1.0, 2),))
    left = PlacedVehicle("mover", 2, 400.0, 20.0, 20.0, ((1.0, 3),))
    with pytest.raises(ScenarioError, match=r"'mover' changes to lane 3 at 1 s, .*: 0, 1, 2\.$"):
        replace(ROAD, vehicles=(EGO, left))
    right = PlacedVehicle("mover", 1, 400.0, 20.0, 20.0, ((1.0, 0),))
    with pytest.raises(ScenarioError, match=r"changes to lane 0 .*: 1, 2\.$"):
        ScenarioDescription(vehicles=(replace(EGO, lane=2), right), barricaded_lanes=(0,))
    with pytest.raises(ScenarioError, match=r"changes to lane 0 .*: 1, 2, 3\.$"):
        MergeDescription(vehicles=(EGO, right))  # lane 0 is the ramp, which ends
