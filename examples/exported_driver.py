"""Exports the shipped driver, and drives 60 decisions with onnxruntime alone."""

import gymnasium
import onnxruntime

import drl_av  # registers the environment
from drl_av.cli import main

main(["export", "pretrained", "driver.onnx"])
session = onnxruntime.InferenceSession("driver.onnx", providers=["CPUExecutionProvider"])

env = gymnasium.make("drl_av/Highway-v0", observation="wide", safety_check="strict")
observation, info = env.reset(seed=800_000, options={"vehicles": 15})
speeds = []
for _ in range(60):
    scene = {"observation": observation[None], "action_mask": info["action_mask"][None] == 1}
    [action] = session.run(["action"], scene)[0]
    observation, _, terminated, _, info = env.step(int(action))
    speeds.append(info["speed_m_s"])
    if terminated:
        break
env.close()
print(f"mean speed {sum(speeds) / len(speeds):.1f} m/s")
