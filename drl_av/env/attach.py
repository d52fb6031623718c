"""A driver and a safety check for one vehicle of the user's own SUMO simulation (ours)."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from drl_av.config import Config
from drl_av.drivers.checked import SteadyDriver
from drl_av.drivers.driver import Driver, ask
from drl_av.drivers.external import require_driver
from drl_av.drivers.registry import DriverSpec, driving_config, find_driver, make_drivers
from drl_av.drivers.rule_based import IdmSumoDriver, SumoDriver
from drl_av.driving.affordances import compute_indicators
from drl_av.driving.maneuver import plan
from drl_av.driving.observation_scale import ObservationScale
from drl_av.driving.scene import LaneChange, Scene
from drl_av.env.custom import custom_check, with_check
from drl_av.env.observation import default_groups, observation_function
from drl_av.errors import ConfigError, SimulationError
from drl_av.road.road import CENTERED_M, Road
from drl_av.road.snapshot import EGO, Command, Snapshot
from drl_av.road.vehicle_types import LENGTHS_M, VehicleType, VehicleTypes
from drl_av.safety import named_check
from drl_av.safety.assumptions import FALLBACK_CHECK
from drl_av.safety.check import SafetyCheck, apply_check
from drl_av.safety.reachability import FASTEST_M_S, cut_in_gap, required_travel
from drl_av.scenarios.imported.net_file import TRUE
from drl_av.simulation.surroundings import Surroundings

DECISION_S = 1.0
"""Time between two decisions, seconds (Sec. IV-A)."""


def attach(
    connection: Any,
    vehicle: str,
    driver: str | Path | Driver = "pretrained",
    safety_check: str | SafetyCheck | None = None,
    config: Config | Mapping[str, Any] | str | Path | None = None,
) -> "AttachedEgo":
    """Let a driver and a safety check drive one vehicle of a SUMO simulation of the user's own.

    Call ``step`` of the result after each ``simulationStep``. The vehicle drives its route, and
    first to the centre of its lane where there are several; all others stay as they are. SUMO must
    run with ``--lateral-resolution``, because a lane change of the ego takes 5 s.

    Args:
        connection: The module libsumo or traci, or a connection of traci, in which SUMO runs.
        vehicle: The id of a vehicle on the road.
        driver: A driver's name, file, run folder or factory, as for ``load_driver``, or a driver.
        safety_check: ``paper``, ``strict``, ``permit_all``, ``module:function``, or a function; by
            default the driver's.
        config: As for ``load_driver``.

    Raises:
        ConfigError: the step length does not divide a second, SUMO has no lateral resolution, moves
            vehicles ballistically or may remove the ego where it stops, the vehicle is faster than
            ``ego.max_speed_m_s``, the driver is SUMO itself or no driver, or an assumption of
            ``strict`` does not hold here.
        SimulationError: SUMO does not run, there is no such vehicle, or its lanes differ in width.
    """
    if not hasattr(connection, "simulation"):
        raise ConfigError(
            f"connection is {connection!r}, but must be the module libsumo or traci, or a "
            "connection of traci, in which SUMO runs."
        )
    if not getattr(connection, "isLoaded", lambda: True)():  # a connection of traci lacks it
        raise SimulationError("SUMO does not run in this connection: start it first.")
    step_s = float(connection.simulation.getDeltaT())
    resolution_m = float(connection.simulation.getOption("lateral-resolution"))
    if resolution_m <= 0.0:
        raise ConfigError(
            "SUMO runs without the sublane model, in which a lane change takes time: start it with "
            "--lateral-resolution, best with the width of a lane."
        )
    steps = round(DECISION_S / step_s)
    if steps < 1 or abs(steps * step_s - DECISION_S) > 1e-9:
        raise ConfigError(
            f"SUMO's step length is {step_s:g} s, but must divide one second, the time between two "
            "decisions: start it with --step-length 0.5."
        )
    _require_options(connection.simulation.getOption)
    specs, settings = _specs(driver, config)
    settings = settings.updated(
        "simulation", step_length_s=step_s, lateral_resolution_m=resolution_m
    )
    settings, own_check = with_check(settings, safety_check)
    around = Surroundings(connection, vehicle, _sight_m(settings))
    speed_m_s = float(connection.vehicle.getSpeed(vehicle))
    if speed_m_s > settings.ego.max_speed_m_s:
        raise ConfigError(
            f"The vehicle drives {speed_m_s:g} m/s, but ego.max_speed_m_s is "
            f"{settings.ego.max_speed_m_s:g}: raise that, as in "
            f'config={{"ego": {{"max_speed_m_s": {math.ceil(speed_m_s) + 1}}}}}.'
        )
    judge: Callable[[], None] = _nothing
    if own_check is None:
        check, judge = _named_check(around, settings)
    else:
        check = custom_check(own_check, settings)
    if isinstance(driver, str | Path):
        [driver] = make_drivers(specs, settings, check).values()
    if isinstance(driver, SumoDriver | IdmSumoDriver):
        raise ConfigError(
            "sumo, sumo-tuned and idm-sumo leave lane changes to SUMO, which no longer drives the "
            "vehicle: attach gap-mobil, idm-mobil or a learned driver."
        )
    if settings.driver.hold_s and not isinstance(driver, SteadyDriver):
        driver = SteadyDriver(driver, check, settings)
    return AttachedEgo(around, driver, check, judge, settings, connection.simulation.getTime)


def _sight_m(config: Config) -> float:
    """Return how far the ego must see: as its driver, and as a check that lets it stop in time.

    ``strict`` must also see each vehicle behind that could not stop behind an ego at rest.
    """
    strict, ego, times = config.strict, config.ego, config.simulation
    fastest = ego.max_speed_m_s, ego.accelerate_m_s2, 0.0
    sights_m = [float(cut_in_gap(*fastest, strict, ego, times))]
    if config.safety.check == "strict":
        delay_s = strict.follower_response_s + times.decision_interval_s
        behind = strict.clearance_m, False, FASTEST_M_S, delay_s
        sights_m.append(required_travel(*behind, strict, times.step_length_s) + strict.clearance_m)
    return max(config.observation.range_m, max(sights_m) + LENGTHS_M[1])


def _require_options(option: Callable[[str], str]) -> None:
    """Raise ConfigError if an option of SUMO moves the ego otherwise than it is commanded."""
    if option("step-method.ballistic").lower() in TRUE:
        raise ConfigError(
            "SUMO runs with --step-method.ballistic, in which the ego needs a longer way to stop "
            "than its driver and its check expect: start it without."
        )
    action = option("collision.action")
    if action in ("teleport", "remove") and float(option("collision.mingap-factor")) != 0.0:
        raise ConfigError(
            f"SUMO would {action} the ego where it stops closer behind a vehicle than its minGap: "
            "start it with --collision.mingap-factor 0."
        )


def _specs(
    driver: str | Path | Driver, config: Config | Mapping[str, Any] | str | Path | None
) -> tuple[list[DriverSpec], Config]:
    """Return what is to be loaded, if anything, and the config with which the driver drives."""
    specs: Sequence[DriverSpec] = ()
    if isinstance(driver, str | Path):
        specs = [find_driver(driver)]
    else:
        require_driver(driver, "driver", type(driver).__name__)
    settings = driving_config(specs, config)
    if any(spec.is_planner for spec in specs):
        raise ConfigError(
            "The planner tries its actions in the twin, which has no copy of your road: attach "
            "pretrained, or another driver."
        )
    for spec in specs:
        settings = spec.config(settings)  # with the check of a name such as pretrained@paper
    return [replace(spec, under=None) for spec in specs], settings


def _named_check(around: Surroundings, config: Config) -> tuple[SafetyCheck, Callable[[], None]]:
    """Return the check that the config names, and a function that judges what has changed since.

    Both raise ConfigError if ``strict`` does not hold: SUMO may load types, and change the route.
    """
    is_strict = config.safety.check == "strict"
    if is_strict:
        _require_right_of_way(around)
    route, judged = around.route, set[VehicleType]()
    _, road = around.read()

    def check_on(types: VehicleTypes) -> SafetyCheck:
        try:
            check = named_check(config, types, road)
        except ConfigError as error:
            text = str(error)
            for name, option in OF_SUMO.items():
                text = text.replace(f"simulation.{name}", f"SUMO's option {option}")
            raise ConfigError(text) from error
        judged.update(types.others.values())
        return check

    def judge() -> None:
        nonlocal route
        if around.route != route:
            _require_right_of_way(around)
            route = around.route
        types = around.vehicle_types(config.ego)
        if not judged.issuperset(types.others.values()):
            check_on(types)

    return check_on(around.vehicle_types(config.ego)), judge if is_strict else _nothing


def _nothing() -> None:
    """Judge nothing, for a check that assumes nothing."""


def _require_right_of_way(around: Surroundings) -> None:
    if lane := around.lane_that_gives_way():
        raise ConfigError(
            f"Under the check strict no lane of the route may give way or have a light, because "
            f"crossing vehicles keep to no bound, and {lane} does: take {FALLBACK_CHECK}."
        )


OF_SUMO = {
    "step_length_s": "--step-length",
    "lateral_resolution_m": "--lateral-resolution",
}
"""The settings [simulation] that SUMO has, not the user's config, and the option of each."""


class AttachedEgo:
    """The ego of ``attach``: it observes, decides, checks and commands once a second."""

    def __init__(
        self,
        around: Surroundings,
        driver: Driver,
        check: SafetyCheck,
        judge: Callable[[], None],
        config: Config,
        clock: Callable[[], float],
    ) -> None:
        self._around, self._driver, self._config = around, driver, config
        self._check, self._judge = check, judge
        self._groups = default_groups(config.observation)
        self._commands: list[Command] = []
        self._lane_change: LaneChange | None = None
        self._planned_m, self._clock, self._last_s = 0.0, clock, math.nan
        self.scene: Scene | None = None
        """What the driver saw at its last decision; None before the first."""
        driver.start(0)
        around.take_control(config.ego)

    def step(self) -> dict[str, Any] | None:
        """Carry on after a ``simulationStep``: command the next one, and decide once a second.

        Raises SimulationError unless SUMO has made one step since the last call, or if it has
        teleported the vehicle, which then is on another edge.

        Returns:
            The decision, with the keys ``proposed_action``, ``executed_action``, ``rule``,
            ``indicators`` and ``speed_m_s`` as in the environment's ``info``, and ``words``, which
            says what the ego does; None between decisions and once the vehicle has left the road.
        """
        step_s = self._config.simulation.step_length_s
        try:
            now_s = self._clock()
        except Exception as error:  # each client of SUMO has its own class
            raise SimulationError(f"SUMO has ended ({error}): attach to one that runs.") from error
        if abs(now_s - self._last_s - step_s) > 1e-6 and not math.isnan(self._last_s):
            raise SimulationError(
                f"SUMO's time is {now_s:g} s, but was {self._last_s:g} s when step was called "
                f"before: call step once after each simulationStep, {step_s:g} s later."
            )
        self._last_s = now_s
        if self._around.is_teleported:
            raise SimulationError(
                f"SUMO has teleported the vehicle {self._around.name!r}, which has collided or "
                "waited for too long: start SUMO with --collision.action warn and "
                "--time-to-teleport -1."
            )
        if not self._around.is_on_the_road:
            return None
        decision = None if self._commands else self._decide()
        command = self._commands.pop(0)
        self._around.command(command.speed_m_s, command.y_m - self._planned_m)
        self._planned_m = command.y_m
        return decision

    def _decide(self) -> dict[str, Any]:
        """Observe, decide and check; store the commands of the SUMO steps of this second."""
        config, (shot, road) = self._config, self._around.read()
        self._judge()
        seen = compute_indicators(shot, road, config.observation.range_m)
        scene = Scene(shot, seen, self._lane_change_on(shot, road), road)
        affordances = scene.affordances
        scale = ObservationScale(config.observation, config.ego.max_speed_m_s, road)
        observation = observation_function(self._groups, scale)(scene)
        proposed = ask(self._driver, scene, observation)
        verdict = apply_check(self._check, scene, proposed)
        planned = plan(scene, verdict.action, config.ego, config.simulation)
        self._commands, self._lane_change = planned
        self.scene, self._planned_m = scene, affordances.ego_y_m
        instead = f" instead of {proposed} ({verdict.rule})" if verdict.rule else ""
        return {
            "proposed_action": proposed.number,
            "executed_action": verdict.action.number,
            "rule": str(verdict.rule),
            "indicators": scene.indicators.values[:27].copy(),
            "speed_m_s": affordances.ego_speed_m_s,
            "words": f"{verdict.action}{instead}",
        }

    def _lane_change_on(self, shot: Snapshot, road: Road) -> LaneChange | None:
        """Return the lane change in progress by the lanes of ``road``.

        They may have other indices than at the last decision, on another edge.
        """
        change = self._lane_change
        if self.scene is None:
            return _to_the_centre(shot, road)
        if change is None:
            return None
        left_m = change.target * road.lane_width_m - self._planned_m
        target = round((float(shot.y_m[EGO]) + left_m) / road.lane_width_m)
        return change._replace(origin=target - change.sign, target=target)


def _to_the_centre(shot: Snapshot, road: Road) -> LaneChange | None:
    """Return the lane change that ends on the centre of the ego's lane; None if it is there.

    A lane change has an origin, so on a single lane it is None, too.
    """
    y_m = float(shot.y_m[EGO])
    target = road.lane_of(y_m)
    aside_m = y_m - road.center_m(target)
    side = 1 if aside_m > 0 else -1
    lanes = [lane for lane in (target + side, target - side) if 0 <= lane < len(road.open_lanes)]
    return LaneChange(lanes[0], target) if lanes and abs(aside_m) > CENTERED_M else None
