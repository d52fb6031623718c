"""The planner's limits are those of the safety checks, for the neighbours that it looks at."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from worlds import LEFT, ahead, behind, scene

from drl_av.config import Config
from drl_av.drivers.planner.limits import NextVehicle, limits_of
from drl_av.driving.actions import Action, Lateral, Longitudinal
from drl_av.driving.scene import Scene
from drl_av.safety import named_check

GAPS = st.floats(1, 120)
SPEEDS = st.floats(0, 30)
CONFIGS = [Config().updated("safety", check=check) for check in ("paper", "strict")]


def near(gap_m: float, speed: float) -> NextVehicle:
    return NextVehicle(np.array([gap_m]), np.array([speed]))


@given(st.sampled_from(CONFIGS), SPEEDS, GAPS, SPEEDS)
def test_the_largest_acceleration_is_what_the_check_makes_of_accelerate(
    config: Config, speed: float, gap_m: float, leader: float
) -> None:
    world = scene(ahead(gap_m, speed_m_s=leader), speed_m_s=speed)
    front = world.affordances.own_front
    assert front is not None
    found = limits_of(config).fastest(
        np.array([speed]), near(front.gap_m, speed + front.relative_speed_m_s)
    )
    verdict = named_check(config)(world, Action(Lateral.KEEP, Longitudinal.ACCELERATE))
    assert found[0] == verdict.action.longitudinal.acceleration_m_s2(config.ego)


def changes(config: Config, world: Scene, longitudinal: Longitudinal) -> bool:
    proposed = Action(Lateral.LEFT, longitudinal)
    return named_check(config)(world, proposed).action.lateral is Lateral.LEFT


@given(
    st.sampled_from([Longitudinal.MAINTAIN, Longitudinal.BRAKE]),
    *(SPEEDS, GAPS, SPEEDS, GAPS, SPEEDS, GAPS, SPEEDS),
)
def test_a_lane_change_is_permitted_where_the_check_permits_it(
    longitudinal: Longitudinal,
    speed: float,
    own_m: float,
    own: float,
    front_m: float,
    front: float,
    rear_m: float,
    rear: float,
) -> None:
    world = scene(
        ahead(own_m, speed_m_s=own),
        ahead(front_m, LEFT, front),
        behind(rear_m, LEFT, rear),
        speed_m_s=speed,
    )

    def permits(config: Config, margin_m: float) -> bool:
        limits, at = limits_of(config), np.array([speed])
        fronts, rate = (near(own_m, own), near(front_m, front)), longitudinal.acceleration_m_s2
        how = margin_m, rate(config.ego)
        ahead_is_clear = [limits.clear_ahead(at, each, *how)[0] for each in fronts]
        return bool(all(ahead_is_clear) and limits.clear_behind(at, near(rear_m, rear), *how))

    if permits(CONFIGS[0], 0.01):
        assert changes(CONFIGS[0], world, longitudinal)
    elif not permits(CONFIGS[0], -0.01):
        assert not changes(CONFIGS[0], world, longitudinal)
    if permits(CONFIGS[1], 0.01):
        # more careful than the check: it does not know when the ego crosses the line
        assert changes(CONFIGS[1], world, longitudinal)
