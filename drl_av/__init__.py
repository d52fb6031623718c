"""Learning to drive on a highway, safely, in SUMO.

The rooms, each importing only from those before it:

    config, errors   every number (settings, presets), and every error
    traffic          the road: the only room that touches SUMO
    driving          affordance indicators, actions, reward, safety check, maneuvers, rule drivers
    drawing          a scene as a picture
    env              ``drl_av/Highway-v0``, the gymnasium environment
    learning         double DQN with two buffers: the only room that imports torch
    studies          evaluation, replay, figures
    cli              the ``drl-av`` command
"""

from gymnasium.envs.registration import register

__version__ = "0.1.0"

register(
    id="drl_av/Highway-v0",
    entry_point="drl_av.env:HighwayEnv",
    kwargs={"action_mask": True},
)
