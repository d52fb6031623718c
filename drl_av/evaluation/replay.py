"""Watching an episode again: recorded, and followed to the last bit."""

import time
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

from drl_av.config import Config
from drl_av.drawing import Caption, Picture, draw
from drl_av.drawing.film import interpolated, write_video
from drl_av.drivers.driver import Driver
from drl_av.env.highway import HighwayEnv
from drl_av.env.metrics import EpisodeResult
from drl_av.env.rollout import drive
from drl_av.evaluation.recording import Follower, RecordedDriver, Recorder, Recording, Watcher
from drl_av.traffic.road import Road
from drl_av.traffic.snapshot import Snapshot

USUAL_VEHICLES = 15


class Pacer:
    """A watcher that lets an episode run at ``rate`` times real time in sumo-gui."""

    def __init__(self, rate: float) -> None:
        self._pause_s = 1.0 / rate
        self._next_s: float | None = None

    def __call__(self, env: HighwayEnv) -> None:
        """Sleep until the next decision is due."""
        now = time.monotonic()
        if self._next_s is not None and self._next_s > now:
            time.sleep(self._next_s - now)
        self._next_s = max(now, self._next_s or now) + self._pause_s


class Film:
    """A watcher that keeps what a video needs."""

    def __init__(self, driver: str) -> None:
        self._driver = driver
        self._moments: list[tuple[Snapshot, Caption]] = []
        self._road: Road | None = None

    def __call__(self, env: HighwayEnv) -> None:
        """Remember one decision."""
        self._road = env.road
        self._moments.append((env.scene.snapshot, env.caption))

    def write(self, path: Path, fps: int = 20, rate: float = 2.0) -> int:
        """Write the video at ``rate`` times real time; returns the number of frames."""
        return write_video(path, self._frames(max(1, round(fps / rate))), fps)

    def _frames(self, per_decision: int) -> Iterator[Picture]:
        assert self._road is not None
        for (before, _), (after, caption) in zip(self._moments, self._moments[1:], strict=False):
            caption = replace(caption, driver=self._driver)
            for step in range(1, per_decision + 1):
                scene = interpolated(before, after, step / per_decision, self._road)
                yield draw(scene, self._road, caption)


@dataclass(frozen=True)
class ReplaySession:
    """An episode that is about to be watched; ``recording`` is what it must follow, if anything."""

    config: Config
    driver: Driver
    name: str
    seed: int
    vehicles: int | None
    """None: as many as the scenario places, or 15."""
    recording: Recording | None = None

    def drive(self, render_mode: str | None, *watchers: Watcher) -> tuple[Recording, EpisodeResult]:
        """Drive it, shown to the watchers at every decision, and record it.

        Raises:
            RecordingError: it left the recording that it must follow.
        """
        recorder = Recorder()
        follower = Follower(self.recording) if self.recording else None
        env = HighwayEnv(config=self.config, render_mode=render_mode)
        try:
            placed = env.simulation.placed_vehicles
            usual = USUAL_VEHICLES if placed is None else placed
            vehicles = usual if self.vehicles is None else self.vehicles
            every: list[Watcher] = [recorder, *watchers]
            if follower:
                every.insert(0, follower)

            def watch(env: HighwayEnv) -> None:
                for watcher in every:
                    watcher(env)

            result = drive(env, self.driver, self.name, self.seed, vehicles, watch)
            if follower:
                follower.end(env)
            return recorder.recording(env, self.name), result
        finally:
            env.close()


def replay_session(recording: Recording) -> ReplaySession:
    """The recorded episode, to the last bit."""
    driver = RecordedDriver(recording)
    return ReplaySession(
        recording.config, driver, recording.driver, recording.seed, recording.vehicles, recording
    )
