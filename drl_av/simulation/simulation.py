"""One simulation in SUMO: it loads a scenario, places vehicles, and advances by one decision."""

import math
import weakref
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from types import ModuleType

import numpy as np

from drl_av.arrays import FloatArray
from drl_av.config import Config
from drl_av.errors import SimulationError
from drl_av.road.road import holds
from drl_av.road.snapshot import (
    EGO,
    EGO_ID,
    NO_COMMANDS,
    Collision,
    CollisionKind,
    Command,
    Snapshot,
    TrafficCommands,
)
from drl_av.road.sweep import KINDS, LATERAL_SPEED_M_S, NO_CONTACT, swept_collision, within_reach
from drl_av.scenarios.folder import Scenario
from drl_av.simulation.fleet import Fleet
from drl_av.simulation.gui_camera import Color, GuiCamera
from drl_av.simulation.population import DriverModel, Population
from drl_av.simulation.speed_requests import SpeedRequests
from drl_av.simulation.start_sumo import acquire, connection, require_display, start
from drl_av.simulation.sumo_options import (
    option_words,
    require_nothing_unseen,
    require_what_the_ego_sees,
)
from drl_av.simulation.vehicle_calls import (
    EgoModel,
    StateReader,
    clear_the_road,
    hand_over,
    is_centered,
    leave_to_commands,
    spawn,
)

CROSSES_LINES = "ignoring"
"""SUMO's class of an ego that we drive: the safety check obeys forbidden lines, SUMO does not."""
LANE_CHANGE_S = 5.0
"""Time for which SUMO tries to execute a lane change, a random one or one of the scenario."""


class Simulation:
    """A simulation in SUMO: in this process through libsumo, or in sumo-gui through traci.

    It reserves an instance of libsumo at the first reset, and frees it when it is closed or
    garbage-collected. If ``gui`` is True and there is no screen, it raises DisplayError.
    ``sumo_options`` are SUMO options of the user, beside ours.
    """

    _sumo: ModuleType

    def __init__(
        self,
        scenario: Scenario,
        config: Config,
        gui: bool = False,
        sumo_options: str | Sequence[str] = (),
    ) -> None:
        self._sumo_options = option_words(sumo_options)
        require_what_the_ego_sees(self._sumo_options)
        self.fleet = Fleet(scenario, config)
        if gui:
            require_display()
        self.scenario = scenario
        self._has_files = bool(scenario.description.additional_files)
        self.road = scenario.road
        self._config = config
        self._gui = gui
        library = connection(gui)
        # not library.exceptions: its classes are traci's, but libsumo raises a class of its own
        self._errors = (library.TraCIException, library.FatalTraCIError)
        self._release: weakref.finalize[..., Simulation] | None = None
        self.after_step: Callable[[Snapshot], None] | None = None
        """A function that the simulation calls after each SUMO step, or None."""
        others = scenario.vehicle_types.others.values()
        speeds_m_s = (kind.lateral_speed_m_s for kind in others)
        self._fastest_aside_m_s = max(LATERAL_SPEED_M_S, *speeds_m_s)
        inflow = scenario.layout.start
        self._watched_m = math.inf if inflow is None else inflow.span_m
        self._step_ms = round(1000 * config.simulation.step_length_s)

    def reset(self, seed: int, vehicles: int) -> Snapshot:
        """Remove all vehicles, and place the ego and ``vehicles`` others drawn with ``seed``.

        The episode depends on (scenario, config, seed, vehicles) and the commands alone, and not on
        earlier simulations. If the files of the scenario are as they were written, nothing depends
        on SUMO's clock and random numbers, so SUMO continues to run. Otherwise, and always in
        sumo-gui or with options of the user, SUMO starts again at each reset.

        Raises:
            ScenarioError: the vehicles do not fit on the road.
            SimulationError: SUMO refuses the scenario.
        """
        self.fleet.draw(seed, vehicles)
        try:
            self._put_on_the_road(seed)
        except BaseException as error:
            self.close()  # after an interrupt (Ctrl-C), too: SUMO may have some vehicles only
            if not isinstance(error, (*self._errors, OSError)):
                raise
            raise SimulationError(
                f"SUMO cannot load the scenario {self.scenario.folder} "
                f"({' '.join(str(error).split()).rstrip('.')}): "
                f"{'correct sumo_options, ' if self._sumo_options else ''}"
                f"{'correct its additional_files, ' if self._has_files else ''}write it again, or "
                "undo what was changed in it."
            ) from error
        if self._gui:
            self._window = GuiCamera(self._sumo, self.scenario.layout)
        self._steps = 0
        self.requests: dict[int, tuple[int, float]] = {}
        """By row the last lane change that was requested: the lane, and the time of its end."""
        self._ego_y_m = self.road.center_m(int(self.fleet.population.lane[EGO]))
        self._ego_lateral_speed_m_s: float | None = 0.0
        step_s = self._config.simulation.step_length_s
        self._requests = SpeedRequests(self._sumo, step_s, self.road, self._watched_m)
        self._watch()
        self._read()
        return self._snapshot()

    def _watch(self, kept: Sequence[int] = ()) -> None:
        """Prepare to read the vehicles that are on the road now, and to find their collisions.

        The first of them had the rows ``kept`` before.
        """
        fleet = self.fleet
        self._states.watch(fleet.ids, fleet.length_m)
        self._requests.watch(fleet.ids, fleet.length_m, fleet.width_m, kept)
        largest_m = fleet.length_m.max(), fleet.width_m.max()
        self._bounds = np.array((*largest_m, self._fastest_aside_m_s, self.road.lap_m))

    def _read(self) -> None:
        """Read the state of all vehicles from SUMO."""
        self._state = self._states.state()
        self._places: FloatArray | None = None
        if self._ego_lateral_speed_m_s is not None:
            self._state[3, EGO] = self._ego_lateral_speed_m_s

    def hand_over(self, model: EgoModel) -> None:
        """Let SUMO drive the ego until the next reset; commands for the ego are then ignored."""
        hand_over(self._sumo.vehicle, model, self._config.ego, self.road.lane_width_m)
        self._ego_lateral_speed_m_s = None

    def advance(
        self, commands: Sequence[Command], traffic_commands: TrafficCommands = NO_COMMANDS
    ) -> tuple[Snapshot, Collision | None]:
        """Execute one command for the ego in each SUMO step, until the ego collides.

        Return the snapshot after the last step, and the ego's collision or None. Only this method
        detects collisions, by the motion of the bodies within each SUMO step
        (``road/sweep.py``). SUMO executes the traffic commands as far as they are safe.

        Raises:
            SimulationError: SUMO does not run or ended unexpectedly, for example because the user
                closed sumo-gui.
        """
        if not self._owns_sumo():
            raise SimulationError("SUMO does not run for this simulation: reset it first.")
        collision, timing = None, self._config.simulation
        ids = self.fleet.ids
        try:
            changes = self.fleet.lane_changes(self._time_s, self._state[1])
            self._request_lane_changes(changes, LANE_CHANGE_S)
            wanted = traffic_commands.lane_changes()
            self._request_lane_changes(wanted, timing.decision_interval_s)
            asks = len(traffic_commands.rows) or self._config.traffic.keep_stopping_distance
            if asks:
                self._requests.begin(self._state, traffic_commands)
            near: Sequence[int] = range(EGO + 1, len(ids))
            if self._ego_lateral_speed_m_s is not None:
                near = within_reach(self._state, commands, timing.step_length_s, self._bounds)
            for command in commands:
                if asks:
                    self._requests()
                collision = self._step(command, near)
                if collision is not None:
                    break
            self._read()
            if not self.road.is_loop:
                self._exchange()
            snapshot = self._snapshot()
        except self._errors as error:
            self.close()
            raise SimulationError(
                f"SUMO ended on its own ({str(error).rstrip('.')}): start again."
            ) from error
        return snapshot, collision

    def show(self, text: str, colors: Mapping[str, Color]) -> None:
        """Show a line of text in sumo-gui, and colour the vehicles whose ids ``colors`` holds."""
        self._window.show(text, colors)

    def close(self) -> None:
        """End SUMO if it still runs; the next reset starts it again."""
        if self._release is not None:
            self._release()  # does nothing the second time

    def _owns_sumo(self) -> bool:
        """Return whether this simulation has reserved an instance of SUMO."""
        return self._release is not None and self._release.alive

    def _request_lane_changes(self, changes: Sequence[tuple[int, int]], valid_s: float) -> None:
        """Request lane changes, by row and side; SUMO completes each one that it has begun."""
        vehicle = self._sumo.vehicle
        for row, side in changes:
            name, is_sumo = self.fleet.ids[row], self.fleet.driver_models[row] == DriverModel.SUMO
            if is_sumo or is_centered(vehicle, name):
                vehicle.changeLaneRelative(name, side, valid_s)
                lane = self.road.lane_of(float(self._state[1, row])) + side
                self.requests[row] = lane, self._time_s + valid_s

    def speeds_chosen(self) -> FloatArray:
        """Return the speeds that SUMO's models chose in the last step, and the accelerations.

        A request overrides the choice; the shape is (2, 1 + N).
        """
        vehicle = self._sumo.vehicle
        read = vehicle.getSpeedWithoutTraCI, vehicle.getAcceleration
        return np.array([[*map(one, self.fleet.ids)] for one in read])

    def _exchange(self) -> None:
        """Remove the vehicles that have left an open road, and add those that enter it."""
        exchanged = self.fleet.update_open_road(self._time_s, *self._state[:3])
        if exchanged is None:
            return
        kept, entering = exchanged
        if entering is not None:
            self._populate(entering, len(kept))
        self._watch(kept.tolist())
        asked = self.requests
        self.requests = {row: asked[was] for row, was in enumerate(kept.tolist()) if was in asked}
        entered = self._states.state(len(kept))
        self._state = np.ascontiguousarray(np.hstack((self._state[:, kept], entered)))

    def _put_on_the_road(self, seed: int) -> None:
        """Place the vehicles in the running SUMO, which is three times faster, or start SUMO."""
        own = self._sumo_options or self._has_files
        as_written = self.scenario.as_written and not own
        if self._owns_sumo() and as_written and not self._gui:
            with suppress(*self._errors):  # if SUMO has ended, or another program has changed it
                clear_the_road(self._sumo)
                self._populate(self.fleet.population)
                return
        self.close()
        instance = acquire(self._gui)
        self._release = weakref.finalize(self, instance.release)
        self._release.atexit = False
        self._sumo = instance.sumo
        self._states = StateReader(self._sumo, self.scenario)
        files = (self.scenario.network_file, *self.scenario.additional_files)
        view = self.scenario.view_file if self._gui else None
        timing, limit_m_s = self._config.simulation, self.scenario.description.speed_limit_m_s
        strip_m = timing.strip_width_m(self.road.lane_width_m)
        config = self._config.updated("simulation", lateral_resolution_m=strip_m)
        start(self._sumo, files, seed, config, view, self._sumo_options)
        require_nothing_unseen(self._sumo)
        longest_s = timing.decisions_per_episode * timing.decision_interval_s
        for name in self.scenario.layout.routes:
            self._sumo.route.add(name, self.scenario.layout.route(name, longest_s * limit_m_s))
        self._populate(self.fleet.population)

    def _populate(self, population: Population, first: int = 0) -> None:
        """Add the vehicles of ``population`` to SUMO; ``first`` is the row of the first of them."""
        fleet, layout, traffic = self.fleet, self.scenario.layout, self._config.traffic
        for number, name in enumerate(population.ids):
            type_id = fleet.type_ids[first + number]
            spawn(self._sumo.vehicle, population, number, type_id, layout, traffic)
            if name == EGO_ID and self.road.forbidden_lines:
                self._sumo.vehicle.setVehicleClass(name, CROSSES_LINES)
            if fleet.driver_models[first + number] != DriverModel.SUMO:
                leave_to_commands(self._sumo.vehicle, name)

    def _step(self, command: Command, near: Sequence[int]) -> Collision | None:
        """Execute one SUMO step; return the ego's collision with a row in ``near``, or None."""
        if not self._command(command):
            return Collision(CollisionKind.HIT_EDGE, None)
        self._sumo.simulationStep()
        self._steps += 1
        if self._gui:
            self._window.follow()
        collision = self._collision([EGO, *near]) if near else None
        if self.after_step is not None:
            self._read()
            self.after_step(self._snapshot())
        return collision

    def _collision(self, rows: list[int]) -> Collision | None:
        """Return the ego's collision with one of ``rows`` in the last SUMO step, or None."""
        before = self._state[:2].take(rows, axis=1) if self._places is None else self._places
        self._places = now = np.array([*zip(*map(self._states.position, rows), strict=True)])
        sizes_m = self.fleet.length_m[rows], self.fleet.width_m[rows]
        row, kind, _ = swept_collision.fast(*before, *now, *sizes_m, self.road.lap_m)
        return None if kind == NO_CONTACT else Collision(KINDS[kind], self.fleet.ids[rows[row]])

    def _command(self, command: Command) -> bool:
        """Send the ego's next position and speed to SUMO; return False if it leaves the lanes."""
        if self._ego_lateral_speed_m_s is None:
            return True
        vehicle, changes = self._sumo.vehicle, command.y_m != self._ego_y_m
        front_m = 0.0 if self.road.is_loop else self._front_m(command)
        body = command.y_m, float(self.fleet.width_m[EGO]), front_m
        if (changes or self.road.partial_lanes) and not holds(*body, self.road):
            return False
        if changes:
            vehicle.changeSublane(EGO_ID, command.y_m - self._states.position(EGO)[1])
            self._ego_y_m = command.y_m
        # SUMO stops a vehicle at the end of an edge from which its lane does not follow its route
        if self.road.misses_exit(self.road.lane_of(command.y_m), front_m):
            vehicle.setRouteID(EGO_ID, next(iter(self.scenario.layout.routes)))
        vehicle.setSpeed(EGO_ID, command.speed_m_s)
        self._ego_lateral_speed_m_s = command.lateral_speed_m_s
        return True

    def _front_m(self, command: Command) -> float:
        """Return the position of the ego's front bumper after the next step."""
        further_m = command.speed_m_s * self._config.simulation.step_length_s
        return self._states.position(EGO)[0] + float(self.fleet.length_m[EGO]) / 2 + further_m

    @property
    def _time_s(self) -> float:
        """The time since the reset, seconds."""
        return self._steps * self._step_ms / 1000

    def _snapshot(self) -> Snapshot:
        """Return the state that ``_read`` has read as a snapshot."""
        fleet, wanted = self.fleet, self._states.lane_change(EGO)
        s_m, y_m, speed, lateral = self._state
        sizes_m = fleet.length_m, fleet.width_m
        return Snapshot(self._time_s, fleet.ids, s_m, y_m, speed, lateral, *sizes_m, wanted)
