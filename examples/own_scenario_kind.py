"""A kind of scenario of your own: a highway whose right lane ends, with the ego in it.

python examples/own_scenario_kind.py
"""

import tempfile
from dataclasses import dataclass
from pathlib import Path

import gymnasium

import drl_av  # registers the environments
from drl_av.config import Config
from drl_av.config.section import setting
from drl_av.drivers.registry import rule_driver
from drl_av.road.road import OPEN_LAP_M, PartialLane, Road
from drl_av.scenarios.folder import write_scenario
from drl_av.scenarios.layout import Edge, OpenPlan, OpenStart
from drl_av.scenarios.open_road import BEYOND_M, OpenDescription
from drl_av.scenarios.road_types import ROAD_TYPES


@dataclass(frozen=True)
class LaneDropDescription(OpenDescription):
    """A highway whose right lane ends.

    drop_m: where the right lane ends, metres (this example)
    """

    meaning = "a highway whose right lane ends"
    drop_m: float = setting(800.0, low=600, high=9000)

    def plan(self) -> OpenPlan:
        """Return the plan of the road: all lanes up to ``drop_m``, then all but the right one."""
        end_m, others = self.drop_m + 300.0, range(1, self.lanes)
        right = PartialLane(0, 0.0, self.drop_m, joined_from_m=0.0, joined_to_m=self.drop_m)
        return OpenPlan(
            edges=(
                Edge("before", 0.0, self.drop_m, range(self.lanes)),
                Edge("after", self.drop_m, end_m, others),
            ),
            routes={"road": ("before", "after")},
            road=Road(OPEN_LAP_M, self.lane_width_m, (True,) * self.lanes, end_m, (right,)),
            start=OpenStart(
                lanes=tuple(others),
                span_m=end_m + BEYOND_M,
                flow_per_h=self.flow_per_h,
                ego_lane=0,
                ego_front_m=400.0,
                ego_speed_m_s=20.0,
            ),
        )


ROAD_TYPES["lane_drop"] = LaneDropDescription


def main() -> None:
    """Write a scenario of the kind, and let the gap rule drive it under the check strict."""
    print("drl-av", drl_av.__version__)
    config = Config().updated("safety", check="strict")
    driver = rule_driver("gap-mobil", config)
    with tempfile.TemporaryDirectory() as home:
        folder = Path(home, "lane_drop")
        write_scenario(folder, LaneDropDescription(flow_per_h=400.0))
        env = gymnasium.make("drl_av/Highway-v0", scenario=folder, config=config).unwrapped
        observation, info = env.reset(seed=7, options={"vehicles": 20})
        terminated = truncated = False
        while not (terminated or truncated):
            action = driver.act(env.scene, observation)  # type: ignore[attr-defined]
            observation, _, terminated, truncated, info = env.step(action.number)
        place = env.scene.snapshot  # type: ignore[attr-defined]
        print(f"at {place.s_m[0]:.0f} m, y = {place.y_m[0]:.1f} m, {info['speed_m_s']:.0f} m/s")
        env.close()


if __name__ == "__main__":
    main()
