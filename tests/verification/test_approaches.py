"""SUMO and the kinematic simulator report the same collisions of random approaches."""

import numpy as np
import pytest
from runs import Capsys

from verification import approaches
from verification.adversary import Mover, Orders
from verification.approaches import Case, compare, start
from verification.families import placed


@pytest.mark.parametrize(
    ("plant", "road", "step_s"),
    [
        *(("kinematic", "loop", 1.0), ("kinematic", "straight", 0.5), ("kinematic", "loop", 0.25)),
        *(("steering", "straight", 1.0), ("steering", "loop", 0.5), ("steering", "straight", 0.25)),
    ],
)
def test_sumo_and_the_simulator_agree_on_random_approaches(
    plant: str, road: str, step_s: float
) -> None:
    row = compare(Case(plant, road, step_s), 30, seed=11)
    assert row["collisions"] >= 3
    assert row["unlike_the_simulator"] == 0


def test_the_program_by_itself_drives_every_plant_and_road(
    monkeypatch: pytest.MonkeyPatch, capsys: Capsys
) -> None:
    monkeypatch.setattr("sys.argv", ["approaches", "--scenes", "1"])
    monkeypatch.setattr(approaches, "STEPS_S", (1.0,))
    assert not approaches.main()
    rows = [line.split()[:2] for line in capsys.readouterr().out.splitlines()]
    for plant in ("kinematic", "steering"):
        for road in ("loop", "straight"):
            assert [plant, road] in rows


def test_the_steering_plant_moves_the_ego_on_another_path_than_the_kinematic_one() -> None:
    steered, kinematic = (Mover(Case(plant).config) for plant in ("steering", "kinematic"))
    y_m = []
    for mover in (steered, kinematic):
        world = placed(*(np.array(values) for values in ([0], [20.0], [[99.0]], [[2]], [[20.0]])))
        left = Orders(np.array([8]), np.zeros((1, 1)), np.zeros((1, 1)))
        for _ in range(2):
            mover.decision(world, left.proposal, left)
        y_m.append(world.y_m[0, 0])
        scene = world.scene(0)
        assert (scene.lane_change.heading_rad > 0.01) == (mover is steered)
    assert y_m[1] == pytest.approx(2 * 0.76)
    # 40 m of a lane change of 100 m: 3.8 (3 0.4^2 - 2 0.4^3), which the steps follow within 2 cm
    assert y_m[0] == pytest.approx(1.338, abs=0.02)


def test_a_disagreement_is_counted(monkeypatch: pytest.MonkeyPatch) -> None:
    class Blind(approaches.SumoWorld):
        """SUMO in which no collision is reported."""

        def play(self, *scene):  # type: ignore[no-untyped-def]
            return None, *super().play(*scene)[1:]

    monkeypatch.setattr(approaches, "SumoWorld", Blind)
    row = compare(Case(), 25, seed=11)
    assert row["unlike_the_simulator"] >= 3
    assert row["collisions"] == 0


def test_a_position_that_differs_is_counted(monkeypatch: pytest.MonkeyPatch) -> None:
    class Shifted(approaches.SumoWorld):
        """SUMO in which a vehicle is a millimetre from its place."""

        def play(self, *scene):  # type: ignore[no-untyped-def]
            return *super().play(*scene)[:2], 1e-3

    monkeypatch.setattr(approaches, "SumoWorld", Shifted)
    assert compare(Case("steering"), 5, seed=11)["unlike_the_simulator"] == 5


def test_no_approach_starts_with_bodies_that_touch() -> None:
    rng = np.random.default_rng(0)
    for _ in range(500):
        world = start(rng)
        along_m, across_m = np.abs(world.x_m[0] - 5000.0)[1], np.abs(np.diff(world.y_m[0]))[0]
        assert along_m > 5.0 or across_m >= 3.8
