"""Traffic that drives by our own drivers through SUMO."""

from collections.abc import Callable
from contextlib import ExitStack, closing
from pathlib import Path

import numpy as np
import pytest
from drives import hash_of, printed_by_a_fresh_process
from programs import python
from worlds import CENTER, LEFT, RIGHT, ROAD, seen_from

from drl_av.config import Config
from drl_av.drivers.background.level_k import level_k, load_level_k
from drl_av.drivers.background.traffic import TrafficDrivers
from drl_av.drivers.rule_based import RandomDriver
from drl_av.driving.affordances import compute_indicators
from drl_av.env.highway import HighwayEnv
from drl_av.evaluation.replay import ReplaySession
from drl_av.road.snapshot import Command, Snapshot, TrafficCommands
from drl_av.scenarios.folder import (
    PlacedVehicle,
    ScenarioDescription,
    load_scenario,
    write_scenario,
)
from drl_av.simulation.population import DriverModel
from drl_av.simulation.simulation import Simulation

TESTS = Path(__file__).parents[2]
OTHER = 1


KINDS = ("finite_state", "level_0", "level_1", "hard_braking", "level_2")


def mixed(*shares: float) -> Config:
    """Short episodes with these shares of the kinds of drivers, in their order."""
    none = {f"{kind}_share": 0.0 for kind in KINDS}
    given = dict(zip(none, shares, strict=False))
    config = Config().updated("simulation", decisions_per_episode=60)
    return config.updated("traffic", **none | given)


MIX = mixed(0.2, 0.2, 0.2, 0.1, 0.1)

# Commands, carried out by SUMO

Placed = Callable[..., tuple[Simulation, Snapshot]]


@pytest.fixture
def placed(tmp_path: Path, stack: ExitStack) -> Placed:
    """Vehicles placed by a test and driven by commands; the ego is far behind them."""

    def place(*vehicles: PlacedVehicle, **traffic: float) -> tuple[Simulation, Snapshot]:
        ego = PlacedVehicle("ego", 0, 300.0, 0.0, 30.0)
        folder = tmp_path / "scenario"
        write_scenario(folder, ScenarioDescription(vehicles=(ego, *vehicles)))
        still = {"finite_state_share": 1.0, "random_lane_changes_per_s": 0.0} | traffic
        config = Config().with_traffic("calm").updated("traffic", **still)
        simulation = stack.enter_context(closing(Simulation(load_scenario(folder), config)))
        return simulation, simulation.reset(0, len(vehicles))

    return place


def decide(simulation: Simulation, *wishes: tuple[int, float, int]) -> Snapshot:
    """One decision in which the ego stands; a wish is a row, an acceleration and a side."""
    rows, wanted_m_s2, sides = map(np.array, zip(*wishes, strict=True))
    traffic_commands = TrafficCommands(rows, wanted_m_s2, sides)
    return simulation.advance([Command(0.0, RIGHT, 0.0)] * 2, traffic_commands)[0]


@pytest.mark.parametrize(
    ("wished_m_s2", "gained_m_s"),
    [(1.0, 1.0), (0.0, 0.0), (-2.0, -2.0), (3.0, 1.5), (-8.0, -4.0)],
    ids=["faster", "as it is", "slower", "at most its accel of 1.5", "at most its decel of 4"],
)
def test_alone_a_vehicle_changes_its_speed_as_wished_within_the_bounds_of_its_type(
    placed: Placed, wished_m_s2: float, gained_m_s: float
) -> None:
    simulation, shot = placed(PlacedVehicle("other", 1, 50.0, 15.0, 40.0))
    speed = float(decide(simulation, (OTHER, wished_m_s2, 0)).speed_m_s[OTHER])
    # SUMO's IDM approaches even a far desired speed a little more gently than accel
    assert speed - float(shot.speed_m_s[OTHER]) == pytest.approx(gained_m_s, abs=0.05)


def test_a_vehicle_brakes_to_a_stop_and_drives_off_again(placed: Placed) -> None:
    simulation, _ = placed(PlacedVehicle("other", 1, 50.0, 6.0, 30.0))
    for _ in range(3):
        shot = decide(simulation, (OTHER, -4.0, 0))
    assert shot.speed_m_s[OTHER] == 0.0
    assert decide(simulation, (OTHER, 1.0, 0)).speed_m_s[OTHER] == pytest.approx(1.0, abs=0.05)


def test_who_wants_to_continue_into_a_vehicle_that_brakes_to_a_stop_is_stopped_by_sumo(
    placed: Placed,
) -> None:
    # 35 m behind it, which comes to rest after 25 m more; 20 m/s need 50 m at 4 m/s2
    ahead = PlacedVehicle("ahead", 1, 90.0, 15.0, 40.0)
    simulation, shot = placed(PlacedVehicle("behind", 1, 50.0, 20.0, 40.0), ahead)
    hardest = 0.0
    for _ in range(12):
        before = shot.speed_m_s[1]
        shot = decide(simulation, (1, 2.0, 0), (2, -4.0, 0))
        hardest = max(hardest, float(before - shot.speed_m_s[1]))
        assert shot.s_m[2] - shot.s_m[1] > 5.0
    assert shot.speed_m_s[1:].max() == 0.0
    assert 3.5 < hardest <= 4.0 + 1e-6


@pytest.mark.parametrize("ours", [True, False], ids=["one of ours", "one of SUMO's"])
def test_behind_a_vehicle_that_brakes_fully_all_stop_without_touching_it(
    placed: Placed, ours: bool
) -> None:
    # 50 m behind, SUMO's IDM brakes so late that its 4 m/s2 end 1 m too far
    behind = PlacedVehicle("behind", 1, 50.0, 20.0, 40.0)
    ahead = PlacedVehicle("ahead", 1, 105.0, 20.0, 40.0)
    brisk = {"headway_min_s": 0.8, "headway_max_s": 0.8}
    brisk |= {"acceleration_min_m_s2": 2.0, "acceleration_max_m_s2": 2.0}
    simulation, _ = placed(behind, ahead, **brisk, finite_state_share=float(ours))
    for second in range(15):
        wishes = [(1, 2.0, 0)] if ours else []
        shot = decide(simulation, *wishes, (2, -2.0 if second < 2 else -4.0, 0))
    assert shot.speed_m_s[1:].max() == 0.0
    assert 1.5 < shot.s_m[2] - shot.s_m[1] - 5.0 < 2.5 + 1e-6


@pytest.mark.parametrize(("side", "end_m"), [(1, LEFT), (-1, RIGHT)], ids=["left", "right"])
def test_a_lane_change_takes_5_s_at_0_76_m_s_and_ends_on_the_centre(
    placed: Placed, side: int, end_m: float
) -> None:
    simulation, _ = placed(PlacedVehicle("other", 1, 50.0, 20.0, 40.0))
    shots = [decide(simulation, (OTHER, 0.0, side))]
    shots += [decide(simulation, (OTHER, 0.0, 0)) for _ in range(9)]
    y_m = np.array([CENTER, *(float(shot.y_m[OTHER]) for shot in shots)])
    assert np.abs(np.diff(y_m)).max() <= 0.76 + 1e-9
    assert y_m[:3] == pytest.approx([CENTER, CENTER + side * 0.76, CENTER + side * 1.52])
    assert y_m[-5:] == pytest.approx([end_m] * 5, abs=0.01)


@pytest.mark.parametrize("ahead_m", [5.0, 2.0, 0.0, -2.0, -5.0])
def test_a_lane_change_into_another_vehicle_waits_until_there_is_room(
    placed: Placed, ahead_m: float
) -> None:
    beside = PlacedVehicle("beside", 2, 50.0 + ahead_m, 20.0, 40.0)
    simulation, _ = placed(PlacedVehicle("other", 1, 50.0, 20.0, 40.0), beside)
    for second in range(10):
        shot = decide(simulation, (1, 0.0, 1), (2, 0.0, 0))
        between_m, aside_m = abs(shot.s_m[2] - shot.s_m[1]), shot.y_m[2] - shot.y_m[1]
        assert aside_m > 1.8 or between_m > 5.0
        assert second > 1 or shot.y_m[1] == CENTER
    assert shot.y_m[1:].tolist() == pytest.approx([LEFT, LEFT], abs=0.01)


def test_on_the_way_to_another_lane_no_lane_change_is_asked_for_by_wish_or_at_random(
    placed: Placed, monkeypatch: pytest.MonkeyPatch
) -> None:
    # one that SUMO broke off half-way would continue, even into the vehicle in its way
    simulation, _ = placed(PlacedVehicle("other", 0, 50.0, 20.0, 40.0))
    decide(simulation, (OTHER, 0.0, 1))
    asked: list[tuple[str, int]] = []
    vehicle = simulation._sumo.vehicle
    monkeypatch.setattr(vehicle, "changeLaneRelative", lambda *a: asked.append(a[:2]))
    for second in range(2, 9):
        monkeypatch.setattr(simulation.fleet, "lane_changes", lambda time_s, y_m: [(OTHER, -1)])
        centered = abs(decide(simulation, (OTHER, 0.0, 1)).y_m[OTHER] - CENTER) < 0.1
        assert bool(asked) is (second >= 7), second
    assert centered
    assert set(asked) == {("other", -1), ("other", 1)}


def test_without_a_command_no_vehicle_leaves_a_slow_lane(placed: Placed) -> None:
    # SUMO's own drivers overtake here
    slow = PlacedVehicle("slow", 1, 80.0, 10.0, 10.0)
    simulation, _ = placed(PlacedVehicle("fast", 1, 50.0, 20.0, 40.0), slow)
    for _ in range(15):
        shot = decide(simulation, (1, 2.0, 0), (2, 0.0, 0))
        assert shot.y_m[1:].tolist() == [CENTER, CENTER]


# Whole episodes


def trajectory(config: Config = MIX, seed: int = 3) -> str:
    session = ReplaySession(config, RandomDriver(), "random", seed, 30)
    return hash_of(session.drive(None)[0])


@pytest.fixture(scope="module")
def hashed() -> str:
    return trajectory()


def test_a_mix_is_the_same_trajectory_in_a_fresh_process_and_not_that_of_idm(hashed: str) -> None:
    program = (
        f"sys.path.insert(0, {str(Path(__file__).parent)!r}); import test_traffic as t; "
        "print(t.trajectory(seed=4) and t.trajectory())"
    )
    assert printed_by_a_fresh_process(program) == [hashed]
    assert trajectory(mixed(0, 0, 0)) != hashed


def test_a_mix_is_one_of_all_kinds_and_decides_on_the_snapshot_that_the_ego_sees(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    env = HighwayEnv(config=MIX)
    env.reset(seed=3, options={"vehicles": 30})
    assert set(env.simulation.fleet.driver_models.tolist()) == set(DriverModel)
    ours = np.flatnonzero(env.simulation.fleet.driver_models != DriverModel.SUMO).tolist()
    given, affordances = [], []
    drivers, advance = env.traffic_drivers, env.simulation.advance
    monkeypatch.setattr(env, "traffic_drivers", lambda s: (affordances.append(s), drivers(s))[1])
    monkeypatch.setattr(env.simulation, "advance", lambda c, w: (given.append(w), advance(c, w))[1])
    for _ in range(3):
        before = env.scene.snapshot
        env.step(0)
        assert affordances.pop() is before
        assert sorted(given.pop().rows.tolist()) == ours
    env.close()


def test_level_2_drives_by_its_own_network() -> None:
    found = []
    for level_1, level_2 in ((1.0, 0.0), (0.0, 1.0)):
        with closing(HighwayEnv(config=mixed(0, 0, level_1, 0, level_2))) as env:
            env.reset(seed=3, options={"vehicles": 30})
            shot = env.scene.snapshot
            found.append(env.traffic_drivers(shot).acceleration_m_s2)
    wanted, driver = [], load_level_k(ROAD, 2)
    units = np.empty((2, driver.units), np.float32)
    for row in range(1, 31):
        values, codes, *_ = compute_indicators(seen_from(shot, row), ROAD, 250.0)
        wanted.append(level_k(values, codes, ROAD.lane_width_m, driver, units)[0])
    assert found[1].tolist() == wanted != found[0].tolist()


def test_the_others_do_not_drive_otherwise_if_the_ego_sees_less_or_brakes_otherwise() -> None:
    found, other = [], MIX.updated("ego", accelerate_m_s2=1.0)
    for config in (MIX, other.updated("observation", range_m=40.0)):
        with closing(HighwayEnv(config=config)) as env:
            env.reset(seed=3, options={"vehicles": 30})
            found.append(env.traffic_drivers(env.scene.snapshot).acceleration_m_s2.tolist())
    assert found[0] == found[1]


def test_traffic_of_sumo_alone_gets_no_commands() -> None:
    with HighwayEnv(config=Config().with_traffic("calm")) as env:
        env.reset(seed=0, options={"vehicles": 30})
        assert len(env.traffic_drivers(env.scene.snapshot).rows) == 0


@pytest.mark.parametrize("mix", ["0,0,0,0", "0.3,0.2,0.2,0.3"])
def test_traffic_alone_never_collides(mix: str) -> None:
    words = ("--episodes", "20", "--vehicles", "30", "10", "--mix", mix)
    done = python("-m", "verification.background_traffic", *words, cwd=TESTS.parent)
    assert done.returncode == 0, done.stdout + done.stderr
    # 10 episodes of 30 vehicles and 10 of 10, of 200 decisions each
    assert done.stdout.startswith(
        f"sumo, {mix}: 20 episodes, 80000 vehicle-decisions, 0 collisions, 0 overlaps"
    )


def test_level_1_drivers_on_a_barricaded_road_keep_off_the_barricade() -> None:
    with HighwayEnv("barricaded_right_lane", config=mixed(0.5, 0, 0.5)) as env:
        env.reset(seed=1, options={"vehicles": 20})
        assert isinstance(env.traffic_drivers, TrafficDrivers)
        assert load_level_k(env.road, 1).range_m == 250.0
        over = False
        while not over:
            *_, terminated, truncated, _ = env.step(0)
            over = terminated or truncated
            assert (env.scene.snapshot.y_m[1:] > CENTER - 1.0 - 1e-6).all()
