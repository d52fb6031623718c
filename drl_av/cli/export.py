"""The verb ``export``: writes a trained driver as an ONNX file for other programs."""

import argparse
from pathlib import Path


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of ``drl-av export`` to its parser."""
    from drl_av.drivers.onnx import described

    parser.add_argument(
        "run",
        metavar="RUN",
        help="folder of a run, its policy.safetensors, or a driver that ships, such as pretrained",
    )
    parser.add_argument("out", type=Path, metavar="FILE.onnx", help="file to write")
    parser.epilog = described()


def export(options: argparse.Namespace) -> int:
    """Write the ONNX file, and describe its inputs and outputs; return the exit status 0."""
    from drl_av.config.functions import is_factory
    from drl_av.drivers.learned import is_actor, load_actor
    from drl_av.drivers.onnx import ACTOR_INPUTS, ACTOR_OUTPUTS, INPUTS, OUTPUTS, export_actor
    from drl_av.drivers.onnx import export as write
    from drl_av.drivers.policy_file import SHIPPED, find_policy, load_run
    from drl_av.drivers.registry import driver_names
    from drl_av.driving.observation_scale import ObservationScale
    from drl_av.errors import ConfigError
    from drl_av.files.atomic import require_suffix, require_writable
    from drl_av.scenarios.folder import find_scenario, load_scenario

    require_suffix(options.out, ".onnx")
    require_writable(options.out, inputs=[options.run])
    if options.run in {*driver_names()} - {*SHIPPED} or is_factory(options.run):
        raise ConfigError(
            f"{options.run} is not a driver that drl-av trained, and has no network to export: "
            "give a run's folder, or pretrained, the shipped driver."
        )
    run = SHIPPED.get(options.run, Path(options.run))
    if is_actor(find_policy(run)):
        export_actor(options.out, *load_actor(run))
        ports = {"input": ACTOR_INPUTS, "output": ACTOR_OUTPUTS}
    else:
        network, config = load_run(run)
        road = load_scenario(find_scenario(config.simulation.scenario)).road
        scale = ObservationScale(config.observation, config.ego.max_speed_m_s, road)
        write(options.out, network, config, scale)
        ports = {"input": INPUTS, "output": OUTPUTS}
    for kind, port in ((kind, port) for kind, of_kind in ports.items() for port in of_kind):
        print(f"{options.out}: {kind} {port}, {port.meaning}")
    return 0
