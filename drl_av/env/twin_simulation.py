"""One world of the compiled twin in the place of SUMO: the same episodes, step by step."""

from collections.abc import Callable, Mapping, Sequence

import numpy as np

from drl_av.config import Config
from drl_av.env.twin_episodes import advance, read_scene
from drl_av.env.world_arrays import exchange_vehicles, leaving_and_entering
from drl_av.errors import ConfigError
from drl_av.road.road import road_numbers
from drl_av.road.snapshot import NO_COMMANDS, Collision, Command, Snapshot, TrafficCommands
from drl_av.road.sweep import HIT_EDGE, KINDS, NO_CONTACT
from drl_av.scenarios.folder import Scenario
from drl_av.simulation.fleet import Fleet
from drl_av.simulation.gui_camera import Color
from drl_av.simulation.vehicle_calls import EgoModel
from drl_av.twin.commands import REQUEST_STEPS, request_change
from drl_av.twin.following import STEP_S
from drl_av.twin.traffic import net_of, place_vehicles
from drl_av.twin.worlds import COUNT, STEP, WISH_M_S2, World, empty_worlds


class TwinSimulation:
    """Simulates like ``Simulation``, in the twin: SUMO is neither started nor asked.

    Raises:
        ConfigError: the twin cannot do what the settings ask.
    """

    def __init__(
        self, scenario: Scenario, config: Config, gui: bool, sumo_options: str | Sequence[str]
    ) -> None:
        if gui or sumo_options:
            raise ConfigError(
                "The twin has neither sumo-gui nor options and outputs of SUMO: drive in SUMO "
                '(simulation.world = "sumo"), or film it (replay --video, render mode rgb_array).'
            )
        self._net = net_of(scenario, config)
        self.fleet = Fleet(scenario, config)
        self.scenario, self.road, self._config = scenario, scenario.road, config
        self._road = road_numbers(scenario.road)
        self.after_step: Callable[[Snapshot], None] | None = None
        """A function that the simulation calls after each step, or None."""

    def reset(self, seed: int, vehicles: int) -> Snapshot:
        """Place the ego and ``vehicles`` others drawn with ``seed``, as in SUMO.

        Raises:
            ScenarioError: the vehicles do not fit on the road.
        """
        self.fleet.draw(seed, vehicles)
        self._make_room(len(self.fleet.ids))
        its = self.fleet.population, self.fleet.driver_models, self.scenario, self._config
        place_vehicles(self.world, self._net, *its)
        read_scene(self.world, self._net, self._scene)
        return self._snapshot()

    def advance(
        self, commands: Sequence[Command], traffic_commands: TrafficCommands = NO_COMMANDS
    ) -> tuple[Snapshot, Collision | None]:
        """Execute one command for the ego in each step, until it collides.

        Return the snapshot after the last step, and the ego's collision or None.
        """
        for row, side in self.fleet.lane_changes(0.0, self._scene[1]):
            request_change(self.world, self._net, row, side, REQUEST_STEPS)
        self.world.x[WISH_M_S2, traffic_commands.rows] = traffic_commands.acceleration_m_s2
        for row, side in traffic_commands.lane_changes():
            request_change(self.world, self._net, row, side, len(commands))
        collision = None
        for command in commands:
            kind, row = advance.fast(
                self.world, self._net, self._road, self._scene, self._before, *command
            )
            if kind != NO_CONTACT:
                other = None if kind == HIT_EDGE else self.fleet.ids[row]
                collision = Collision(KINDS[kind], other)
            if self.after_step is not None and kind != HIT_EDGE:
                self.after_step(self._snapshot())
            if collision is not None:
                break
        if not self.road.is_loop:
            self._exchange()
        return self._snapshot(), collision

    def _make_room(self, vehicles: int) -> None:
        """Make the arrays of a world for so many vehicles, without any yet."""
        worlds = empty_worlds(1, vehicles, self._net.lanes)
        self.world = World(*(array[0] for array in worlds))
        self._scene, self._before = np.zeros((6, vehicles)), np.zeros((2, vehicles))

    def _exchange(self) -> None:
        """Remove the vehicles that have left an open road, and add those that enter it."""
        exchanged = leaving_and_entering(self.world, self.fleet, self._scene)
        if exchanged is None:
            return
        entered = len(self.fleet.ids) - len(exchanged[0])
        before, needed = self.world, int(self.world.near[COUNT]) + entered
        if needed > self._scene.shape[1]:
            self._make_room(2 * needed)
            for old, new in zip(before, self.world, strict=True):
                new[..., : old.shape[-1]] = old
        exchange_vehicles(self.world, self._net, self.fleet, *exchanged)
        read_scene(self.world, self._net, self._scene)

    def hand_over(self, model: EgoModel) -> None:
        """Refuse that SUMO drives the ego.

        Raises:
            ConfigError: always.
        """
        raise ConfigError(
            "SUMO does not drive the ego of the twin: leave simulation.world at sumo for this "
            "driver."
        )

    def show(self, text: str, colors: Mapping[str, Color]) -> None:
        """Do nothing, as there is no window."""

    def close(self) -> None:
        """Do nothing, as there is no SUMO to end."""

    def _snapshot(self) -> Snapshot:
        time_s = float(self.world.near[STEP] * STEP_S)
        n = len(self.fleet.ids)
        return Snapshot(time_s, self.fleet.ids, *self._scene[:, :n].copy())
