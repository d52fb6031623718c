"""A story: the ego behind a slow vehicle, and a fast one that comes up on the left.

python examples/story.py
"""

import tempfile
from pathlib import Path

import gymnasium

import drl_av
from drl_av.driving.actions import ACTIONS
from drl_av.scenarios.folder import PlacedVehicle, ScenarioDescription, write_scenario

STORY = ScenarioDescription(
    circumference_m=1000.0,
    vehicles=(
        PlacedVehicle("ego", lane=1, position_m=200.0, speed_m_s=25.0, desired_speed_m_s=30.0),
        PlacedVehicle("slow", lane=1, position_m=280.0, speed_m_s=18.0, desired_speed_m_s=18.0),
        PlacedVehicle("fast", lane=2, position_m=150.0, speed_m_s=30.0, desired_speed_m_s=30.0),
    ),
)

CALM = {"traffic": {"kind": "calm"}}
"""SUMO drives all other vehicles."""


def main(decisions: int = 10) -> None:
    """Print the shipped driver's action in each decision."""
    driver = drl_av.load_driver("pretrained")
    with tempfile.TemporaryDirectory() as folder:
        write_scenario(Path(folder) / "story", STORY)
        env = gymnasium.make("drl_av/Highway-v0", scenario=Path(folder) / "story", config=CALM)
        observation, _ = env.reset(seed=800_000)
        driver.start(800_000)
        for second in range(1, decisions + 1):
            scene = env.unwrapped.scene
            front = scene.affordances.own_front
            ahead = "nothing" if front is None else f"{front.gap_m:.0f} m"
            action = driver.act(scene, observation)
            observation, _, _, _, info = env.step(action.number)
            executed = ACTIONS[info["executed_action"]]
            print(f"{second:2d} s, {info['speed_m_s']:.1f} m/s, ahead {ahead}: {executed}")
        env.close()


if __name__ == "__main__":
    main()
