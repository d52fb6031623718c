"""The measurement of ramps: what counts as merged, taken, forced, waited and lost."""

from collections.abc import Callable, Iterator
from contextlib import closing
from pathlib import Path

import pytest

from drl_av.config import Config
from drl_av.drivers.checked import PolicyDriver
from drl_av.drivers.registry import rule_driver
from drl_av.env.highway import HighwayEnv
from drl_av.scenarios.folder import write_scenario
from drl_av.scenarios.highways import ExitDescription
from drl_av.scenarios.road_description import PlacedVehicle
from drl_av.scenarios.road_types import ROAD_TYPES
from verification.ramps import Trip, drive, interval, line, table, time_lost


def test_wilsons_interval_of_two_in_ten_and_of_all() -> None:
    # Wilson 1927: (0.2 + 0.1921) / 1.3841 = 0.2833, half width 0.2266
    assert interval(2, 10) == "20.0% (5.7% to 51.0%)"
    assert interval(40, 40) == "100.0% (91.2% to 100.0%)"


def test_the_line_counts_what_the_episodes_showed() -> None:
    trips = [
        Trip(success=True, decisions=8, end_s=36.0, flow_per_h=900.0),
        Trip(waits=30, end_s=95.0, flow_per_h=1100.0),
    ]
    shown = line("merge", "gap-mobil", 1000.0, trips, 31.5)
    assert shown.startswith("merge, gap-mobil, 1000 vehicles/h/lane asked, 1000 found: 2 episodes")
    assert "merged 50.0%" in shown
    assert "longest wait 30 s, on the highway after 8.0 s, time lost 4.5 s" in shown
    assert "took the exit 50.0%" in line("exit", "sumo", 1000.0, trips, 31.5)


def test_the_table_of_a_page_has_a_row_for_each_line() -> None:
    trips = [Trip(success=True, waits=2, decisions=8, end_s=36.0, flow_per_h=900.0)]
    lines = [line("merge", "gap-mobil", 1000.0, trips, 31.5), line("exit", "sumo", 0, trips, None)]
    head, rule, *rows = table("\n".join([*lines, "made by python in 3 s"])).splitlines()
    assert head.startswith("| vehicles/h/lane | driver | episodes | success | ego hits | waited |")
    assert set(rule) <= set("| -")
    assert rows == [
        "| 900 | `gap-mobil` | 1 | 100.0% (20.7% to 100.0%) | 0 | 100.0% | 4.5 s | 0.0% | 0.0% |",
        "| 900 | `sumo` | 1 | 100.0% (20.7% to 100.0%) | 0 | 100.0% | unknown | 0.0% | 0.0% |",
    ]


def test_no_time_is_lost_that_nothing_compares_with() -> None:
    driven = [Trip(success=True, end_s=30.0)]
    assert time_lost(driven, None) == time_lost([Trip(end_s=30.0)], 30.0) == "time lost unknown"
    assert time_lost(driven, 32.0) == "time lost -2.0 s"
    assert time_lost(driven, 30.04) == "time lost 0.0 s"


@pytest.fixture(scope="module")
def empty(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Callable[[str], HighwayEnv]]:
    """An empty road of a kind, and 60 s on it."""
    home, made = tmp_path_factory.mktemp("ramps"), list[HighwayEnv]()

    def make(kind: str) -> HighwayEnv:
        folder = Path(home, f"{kind}{len(made)}")
        write_scenario(folder, ROAD_TYPES[kind](flow_per_h=0.0))
        config = Config().updated("safety", check="strict")
        config = config.updated("simulation", scenario=str(folder), decisions_per_episode=60)
        made.append(HighwayEnv(config=config))
        return made[-1]

    yield make
    for env in made:
        env.close()


@pytest.mark.parametrize(("driver", "merged"), [("gap-mobil", True), ("idm", False)])
def test_on_an_empty_highway_the_gap_rule_merges_and_a_driver_that_keeps_its_lane_waits(
    driver: str, merged: bool, empty: Callable[[str], HighwayEnv]
) -> None:
    found = drive(env := empty("merge"), rule_driver(driver, env.config), 0)
    assert found.success is merged
    assert not found.ego_hit
    assert (found.waits > 0) is not merged
    assert (found.decisions is not None) is merged
    assert (found.end_s is not None) is merged


@pytest.mark.parametrize("kind", ["exit", "ramp_to_ramp"])
def test_sumo_takes_the_exit_of_an_empty_highway(
    kind: str, empty: Callable[[str], HighwayEnv]
) -> None:
    found = drive(env := empty(kind), rule_driver("sumo", env.config), 0)
    assert found.success
    assert (found.ego_hit, found.was_hit, found.waits, found.forced) == (False, False, 0, False)
    # 1,100 or 1,450 m at up to 30 m/s, of which it drives 100 m and more on the off-ramp
    assert found.decisions + 100.0 / 30.0 < found.end_s < 60.0


def test_a_driver_that_keeps_its_lane_misses_the_exit_in_time(
    empty: Callable[[str], HighwayEnv],
) -> None:
    found = drive(env := empty("exit"), rule_driver("idm", env.config), 0)
    assert not found.success
    assert found.decisions is None
    assert found.end_s == pytest.approx(1102.5 / 30.0)  # its centre is 2.5 m behind its front
    assert found.waits == 0


def test_vehicles_that_pass_the_off_ramp_are_the_flow() -> None:
    config = Config().updated("simulation", scenario="exit", decisions_per_episode=40)
    with closing(HighwayEnv(config=config)) as env:
        idm = rule_driver("idm", config)
        crowded, calm = (drive(env, idm, 3, vehicles).flow_per_h for vehicles in (60, 6))
    assert crowded > 2 * calm > 0


def test_braking_behind_an_ego_that_is_far_ahead_and_faster_is_not_forced(tmp_path: Path) -> None:
    # a slow vehicle in the left lane, which the one behind the ego may not pass on the right
    slow = PlacedVehicle("slow", 3, 350.0, 17.0, 17.0)
    assert _outcome(tmp_path, slow, PlacedVehicle("rear", 2, 300.0, 30.0, 30.0)) == (True, False)


def test_braking_behind_an_ego_that_cuts_in_is_forced(tmp_path: Path) -> None:
    assert _outcome(tmp_path, PlacedVehicle("rear", 2, 375.0, 30.0, 30.0)) == (True, True)


def _outcome(folder: Path, *others: PlacedVehicle) -> tuple[bool, bool]:
    """Whether there is braking behind an ego that changes lanes at once, and whether forced."""
    ego = PlacedVehicle("ego", 3, 400.0, 22.0, 30.0)
    write_scenario(folder / "placed", ExitDescription(vehicles=(ego, *others)))
    config = Config().updated("simulation", scenario=str(folder / "placed"))
    config = config.updated("simulation", decisions_per_episode=8)
    with closing(HighwayEnv(safety_check="permit_all", config=config)) as env:
        trip = drive(env, PolicyDriver(lambda observation: 4), 0)
    return trip.braking_behind, trip.forced
