"""Either lateral plant and any longitudinal reference in real SUMO, by the config alone."""

import pytest
from drives import Place
from worlds import CENTER, LANE_M

from drl_av.config import Config
from drl_av.driving.actions import ACTIONS
from drl_av.driving.maneuver import plan
from drl_av.env.highway import HighwayEnv
from drl_av.scenarios.folder import PlacedVehicle

KEEP, ACCELERATE, RIGHT, LEFT = 0, 1, 4, 8
STEERED = Config().updated("ego", lateral_plant="steering")


def test_sumo_drives_the_ego_where_the_steering_plant_says() -> None:
    with HighwayEnv(config=STEERED) as env:
        env.reset(seed=0, options={"vehicles": 0})
        origin = env.scene.affordances.lane
        there, back = (LEFT, RIGHT) if origin < 2 else (RIGHT, LEFT)
        for action in (there, KEEP, KEEP, back, KEEP, KEEP, KEEP, KEEP, there, *[KEEP] * 4):
            wanted = plan(env.scene, ACTIONS[action], STEERED.ego, STEERED.simulation)
            info = env.step(action)[4]
            assert info["indicators"][25] == pytest.approx(wanted.commands[-1].y_m, abs=1e-9)
            assert info["indicators"][26] == wanted.commands[-1].lateral_speed_m_s
            assert env.scene.lane_change == wanted.lane_change
    # aborted once, and then carried out in five decisions
    assert env.scene.lane_change is None
    sign = ACTIONS[there].lateral.sign
    assert env.scene.affordances.ego_y_m == pytest.approx((origin + sign) * LANE_M, abs=1e-9)


@pytest.mark.parametrize(("reference", "gap_m"), [("acc", 22.0), ("idm", 22.72)])
def test_accelerate_follows_a_slower_vehicle_under_a_longitudinal_reference(
    place: Place, reference: str, gap_m: float
) -> None:
    # gaps as worked out in test_car_following; by number, accelerate would run into it
    slow = PlacedVehicle("slow", 1, 150.0, 15.0, 15.0)
    ego = PlacedVehicle("ego", 1, 50.0, 25.0, 30.0)
    quiet = Config().with_traffic("calm").updated("traffic", random_lane_changes_per_s=0.0)
    config = quiet.updated("ego", longitudinal_reference=reference)
    env = place(ego, slow, config=config)
    env.reset(seed=0)
    for _ in range(90):
        terminated, info = env.step(ACCELERATE)[2::2]
        assert not terminated
    assert info["speed_m_s"] == pytest.approx(15.0, abs=0.1)
    assert env.scene.affordances.ego_y_m == pytest.approx(CENTER)
    assert info["indicators"][0] == pytest.approx(gap_m, abs=0.6)
