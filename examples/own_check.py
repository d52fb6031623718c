"""A safety check of your own: the paper's check, and no acceleration close behind a vehicle.

python examples/own_check.py
"""

import gymnasium

import drl_av  # registers the environment
from drl_av.config import SafetyConfig
from drl_av.driving.actions import Action, Longitudinal
from drl_av.driving.scene import Scene
from drl_av.safety.check import Rule, Verdict
from drl_av.safety.paper import paper

HEADWAY_S = 2.0
ACCELERATE = 1


def two_seconds(scene: Scene, proposed: Action) -> Verdict:
    """Return the paper's verdict, but refuse to accelerate within 2 s of the vehicle ahead."""
    verdict = paper(scene, proposed, SafetyConfig())
    front, action = scene.affordances.own_front, verdict.action
    close = front is not None and front.gap_m < HEADWAY_S * scene.affordances.ego_speed_m_s
    if close and action.longitudinal == Longitudinal.ACCELERATE:
        slower = Action(action.lateral, Longitudinal.MAINTAIN)
        return Verdict(slower, Rule.IN_LANE)
    return verdict


def main() -> None:
    """Count how often each check changes the action of a driver that always accelerates."""
    for check in ("paper", two_seconds):
        env = gymnasium.make("drl_av/Highway-v0", safety_check=check)
        _, info = env.reset(seed=800_000, options={"vehicles": 20})
        changed, over = 0, False
        while not over:
            _, _, terminated, truncated, info = env.step(ACCELERATE)
            changed += info["rule"] != "none"
            over = terminated or truncated
        env.close()
        print(f"{check if isinstance(check, str) else check.__name__}: {changed} actions changed")


if __name__ == "__main__":
    main()
