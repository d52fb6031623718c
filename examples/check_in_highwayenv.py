"""The safety checks in another environment, HighwayEnv's highway-v0, without SUMO.

pip install '.[train,benchmark]'
python examples/check_in_highwayenv.py 20
python examples/check_in_highwayenv.py 50 figure.png

An agent that accelerates and changes lanes at random, and never brakes, drives the given number of
episodes without a check, under ``paper`` and under ``strict``. For the figure so does a DQN that
learns in highway-fast-v0 with HighwayEnv's own settings, for minutes; ``highway_dqn.zip`` keeps it.

The argument of ``strict`` does not hold here, so that it is one more rule whose hits are counted: a
lane change of HighwayEnv crosses the line after half a second, and no decision is left to abort it
(``named_check`` refuses such an ego, ``Strict`` itself takes it); a speed controller stands for
constant accelerations; and other vehicles cut in without regard to bound 3.
"""

import sys
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from itertools import product, repeat
from pathlib import Path

import gymnasium
import highway_env  # registers highway-v0
import numpy as np
from matplotlib.figure import Figure
from stable_baselines3 import DQN

from drl_av.config import Config
from drl_av.driving.actions import ACTIONS, Lateral, Longitudinal
from drl_av.driving.scene import LaneChange, Scene
from drl_av.safety.check import SafetyCheck, permit_all
from drl_av.safety.paper import Paper
from drl_av.safety.strict import Strict

SLOWER = 4
"""The last meta action of HighwayEnv; the random agent draws one of those before it."""
Agent = Callable[[np.ndarray, np.random.Generator], int]
"""A function from an observation and an episode's generator to a meta action."""
AGENT_FILE = Path("highway_dqn.zip")
DECISIONS = 5_000
"""Number of decisions of the training."""
LANES, LANE_M, NEAR_M = 4, 4.0, 0.2
"""Number of lanes, their width, and how near the centre of its lane the ego changes no lane."""
SETTINGS = {
    "lanes_count": LANES,
    "vehicles_count": 20,
    "action": {"type": "DiscreteMetaAction", "target_speeds": np.linspace(0, 30, 7)},
}
CONFIG = (
    Config()
    .updated("ego", accelerate_m_s2=5.0, brake_m_s2=4.0, lane_change_duration_s=1.5)
    # IDMVehicle brakes with at most ACC_MAX; 5 m/s sideways is measured, 4 m need 1.5 s
    .updated("strict", braking_m_s2=6.0, acceleration_m_s2=3.0, lateral_speed_m_s=5.0)
)
CHECKS: dict[str, SafetyCheck] = {
    "no check": permit_all,
    "paper": Paper(CONFIG.safety),
    "strict": Strict(CONFIG.strict, CONFIG.ego, CONFIG.simulation),
}
TO_OURS = {"LANE_LEFT": 8, "IDLE": 0, "LANE_RIGHT": 4, "FASTER": 1, "SLOWER": 3}
ACROSS = {Lateral.LEFT: "LANE_LEFT", Lateral.KEEP: "IDLE", Lateral.RIGHT: "LANE_RIGHT"}
ALONG = {Longitudinal.ACCELERATE: "FASTER", Longitudinal.MAINTAIN: "IDLE"}


class Checked(gymnasium.Wrapper):
    """Executes HighwayEnv's meta actions only as a safety check permits them."""

    def __init__(self, env: gymnasium.Env, check: SafetyCheck) -> None:
        super().__init__(env)
        self._check = check

    def scene(self) -> Scene:
        """Return HighwayEnv's vehicles as a scene: its y axis points to the right."""
        ego = self.unwrapped.vehicle
        vehicles = [ego, *(each for each in self.unwrapped.road.vehicles if each is not ego)]
        x_m, right_m = np.array([each.position for each in vehicles]).T
        forward_m_s, right_m_s = np.array([each.velocity for each in vehicles]).T
        target = LANES - 1 - ego.target_lane_index[2]
        y_m = (LANES - 1) * LANE_M - right_m
        left_m = target * LANE_M - y_m[0]
        going = LaneChange(target - int(np.sign(left_m)), target)
        return Scene.from_arrays(
            x_m,
            y_m,
            forward_m_s,
            -right_m_s,
            width_m=2.0,
            lanes=LANES,
            lane_width_m=LANE_M,
            lane_change=going if abs(left_m) > NEAR_M else None,
        )

    def step(self, action: int):
        """Execute what the check makes of a meta action: its change of speed, then of lane."""
        names, scene = self.unwrapped.action_type.actions, self.scene()
        proposed = ACTIONS[TO_OURS[names[int(action)]]]
        change = scene.lane_change
        if change is not None and proposed.lateral.sign == change.sign:
            proposed = proposed._replace(lateral=Lateral.KEEP)  # it goes on; not one lane more
        executed = self._check(scene, proposed).action
        across, along = ACROSS[executed.lateral], ALONG.get(executed.longitudinal, "SLOWER")
        if across != "IDLE" and along != "IDLE":
            self.unwrapped.vehicle.act(along)
        final = along if across == "IDLE" else across
        return self.env.step(self.unwrapped.action_type.actions_indexes[final])


def at_random(observation: np.ndarray, rng: np.random.Generator) -> int:
    """Accelerate, keep or change lanes, but never brake."""
    return int(rng.integers(SLOWER))


def trained() -> Agent:
    """Return the agent of ``AGENT_FILE``, which is trained (in minutes) if there is none."""
    if not AGENT_FILE.exists():
        env = gymnasium.make("highway-fast-v0", config=SETTINGS)
        agent = DQN(
            "MlpPolicy",
            env,
            policy_kwargs={"net_arch": [256, 256]},
            learning_rate=5e-4,
            buffer_size=15_000,
            learning_starts=200,
            gamma=0.8,
            target_update_interval=50,
            seed=0,
        )
        agent.learn(DECISIONS).save(AGENT_FILE)
    model = DQN.load(AGENT_FILE)
    return lambda observation, rng: int(model.predict(observation, deterministic=True)[0])


def hits(check: SafetyCheck, episodes: int, agent: Agent = at_random) -> tuple[int, float]:
    """Drive; return the number of episodes with a crash of the ego, and its mean speed, m/s."""
    env = Checked(gymnasium.make("highway-v0", config=SETTINGS), check)
    crashes, speeds = 0, []
    for seed in range(episodes):
        observation, _ = env.reset(seed=seed)
        rng, over = np.random.default_rng(seed), False
        while not over:
            observation, _, terminated, truncated, info = env.step(agent(observation, rng))
            speeds.append(info["speed"])
            over = terminated or truncated
        crashes += info["crashed"]
    env.close()
    return crashes, float(np.mean(speeds))


def cell(named: tuple[str, str], episodes: int) -> tuple[int, float]:
    """Return the hits of an agent under a check, both by name."""
    agent = trained() if named[0] == "DQN" else at_random
    return hits(CHECKS[named[1]], episodes, agent)


if __name__ == "__main__":
    number = int(sys.argv[1]) if sys.argv[1:] else 20
    agents = ["random", "DQN"] if sys.argv[2:] else ["random"]
    if "DQN" in agents:
        trained()
    cells = [*product(agents, CHECKS)]
    figure = Figure(figsize=(6.4, 2.8), layout="constrained")
    axes = figure.subplots()
    with ProcessPoolExecutor(len(cells)) as pool:
        results = pool.map(cell, cells, repeat(number))
        for row, ((agent, check), (crashes, speed)) in enumerate(zip(cells, results, strict=True)):
            text = f"{crashes} of {number} episodes with a crash, {speed:.1f} m/s"
            print(f"{agent}, {check}: {text}")
            share, color = 100 * crashes / number, f"C{row % len(CHECKS)}"
            axes.barh(row, share, color=color)
            axes.text(share + 1, row, f"{speed:.1f} m/s", va="center")
    axes.set_yticks(range(len(cells)), [", ".join(named) for named in cells])
    axes.set(xlabel="episodes of highway-v0 with a crash of the ego, %", xlim=(0, 125))
    axes.set_xticks(range(0, 101, 20))
    axes.invert_yaxis()
    if sys.argv[2:]:
        figure.savefig(sys.argv[2], dpi=150)
