"""A scenario of your own: a longer loop with a closed lane, and a story of three vehicles.

python examples/own_scenario.py
"""

import tempfile
from pathlib import Path

import gymnasium

import drl_av  # registers the environment
from drl_av.scenarios.folder import PlacedVehicle, ScenarioDescription, write_scenario

MAINTAIN = 0
CALM = {"traffic": {"kind": "calm"}}
"""SUMO drives all other vehicles."""

ROADWORKS = ScenarioDescription(circumference_m=800.0, barricaded_lanes=(0,))
"""Any number of vehicles, at random places; lane 0, on the right, is closed."""

STORY = ScenarioDescription(
    circumference_m=800.0,
    vehicles=(
        PlacedVehicle("ego", lane=1, position_m=50.0, speed_m_s=25.0, desired_speed_m_s=30.0),
        PlacedVehicle("slow", lane=1, position_m=120.0, speed_m_s=15.0, desired_speed_m_s=15.0),
        PlacedVehicle("left", lane=2, position_m=40.0, speed_m_s=28.0, desired_speed_m_s=28.0),
    ),
)
"""The same vehicles at the same places in every episode."""


def main() -> None:
    """Write both scenarios, and drive in them; the ego never proposes to brake, the check does."""
    with tempfile.TemporaryDirectory() as folder:
        for name, description in (("roadworks", ROADWORKS), ("story", STORY)):
            write_scenario(Path(folder) / name, description)
            env = gymnasium.make("drl_av/Highway-v0", scenario=Path(folder) / name, config=CALM)
            _, info = env.reset(seed=800_000)
            for _ in range(10):
                _, _, _, _, info = env.step(MAINTAIN)
            print(f"{name}: {info['vehicles']} vehicles, {info['speed_m_s']:.1f} m/s after 10 s")
            env.close()


if __name__ == "__main__":
    main()
