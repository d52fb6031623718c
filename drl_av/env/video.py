"""Films episodes: a video with several pictures for each decision."""

import glob
import math
from collections.abc import Callable, Iterator
from dataclasses import replace
from itertools import repeat
from numbers import Real
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np

from drl_av.config.functions import require_function
from drl_av.drawing.film import interpolated, require_film, write_video
from drl_av.drawing.panels import Caption
from drl_av.drawing.picture import Picture, draw
from drl_av.env.highway import HighwayEnv
from drl_av.env.renderer import next_caption
from drl_av.env.scene_values import Observation
from drl_av.env.transition import Transition
from drl_av.errors import ConfigError, RecordingError
from drl_av.files.atomic import refusals
from drl_av.road.road import Road
from drl_av.road.snapshot import Snapshot


class Film:
    """Collects the scenes of an episode, and writes a video with pictures between two decisions."""

    def __init__(self, driver: str, road: Road, seed: int) -> None:
        self._road, self._caption = road, Caption(driver=driver, seed=seed)
        self._moves: list[tuple[Snapshot, Snapshot, Caption]] = []

    @property
    def decisions(self) -> int:
        """Number of decisions so far."""
        return len(self._moves)

    def add(self, decision: Transition) -> None:
        """Add the next decision of the episode."""
        self._caption = next_caption(self._caption, decision, self._road)
        before, after = decision.scene.snapshot, decision.next_scene.snapshot
        self._moves.append((before, after, self._caption))

    def pictures(self, per_decision: int, first: int = 0) -> Iterator[Picture]:
        """Yield ``per_decision`` pictures of each decision, from decision ``first`` on.

        If the episode ends with a collision, the last picture alone says so, and stays as long as
        two decisions.
        """
        for before, after, caption in self._moves[first:]:
            for step in range(1, per_decision + 1):
                scene = interpolated(before, after, step / per_decision, self._road)
                shown = caption if step == per_decision else replace(caption, collision="")
                picture = draw(scene, self._road, shown)
                yield picture
        if self._caption.collision and self._moves[first:]:
            yield from repeat(picture, 2 * per_decision)

    def write(self, path: Path, fps: int = 20, rate: float = 2.0) -> int:
        """Write the video at ``rate`` times real time; return the number of pictures.

        It has about ``fps`` pictures a second, because each decision has a whole number of them.
        """
        per_decision = max(1, round(fps / rate))
        return write_video(path, self.pictures(per_decision), rate * per_decision)


def cubic_schedule(episode: int) -> bool:
    """Return whether to film an episode: 0, 1, 8, 27, ... and from 1,000 on each 1,000th.

    This is gymnasium's default, whose own function cannot be imported without moviepy.
    """
    if episode >= 1000:
        return episode % 1000 == 0
    root = round(math.cbrt(episode))
    return root**3 == episode


class RecordVideo(
    gymnasium.Wrapper[Observation, np.int64, Observation, np.int64],
    gymnasium.utils.RecordConstructorArgs,
):
    """Films episodes, with several pictures for each decision.

    gymnasium's wrapper of the same name films one picture for each step, that is, for each second.
    This wrapper needs neither a render mode nor moviepy. It writes the film
    ``FOLDER/PREFIX-episode-N.mp4`` when the episode ends or the environment is closed. If the
    folder has such films of an earlier run, it warns that they may be overwritten.

    Args:
        env: The environment, which other wrappers may wrap; each step must be one decision.
        video_folder: The folder of the films, created if it is missing.
        episode_trigger: The function that returns whether to film an episode, given the episode's
            number from 0; the default is ``cubic_schedule``, like gymnasium's.
        name_prefix: The beginning of the files' names.
        fps: Pictures per second of the film.
        rate: Speed of the film as a multiple of real time.

    Raises:
        ConfigError: ``env`` is not drl-av's environment, ``fps`` or ``rate`` is not a number above
            0, or ``episode_trigger`` is not a function.
        RecordingError: the folder cannot be created.
    """

    def __init__(
        self,
        env: gymnasium.Env[Observation, np.int64],
        video_folder: str | Path,
        episode_trigger: Callable[[int], bool] = cubic_schedule,
        name_prefix: str = "rl-video",
        fps: int = 20,
        rate: float = 1.0,
    ) -> None:
        gymnasium.utils.RecordConstructorArgs.__init__(
            self,
            video_folder=video_folder,
            episode_trigger=episode_trigger,
            name_prefix=name_prefix,
            fps=fps,
            rate=rate,
        )
        super().__init__(env)
        if not isinstance(env.unwrapped, HighwayEnv):
            raise ConfigError(
                f"RecordVideo films drl-av's environments, not {env.unwrapped}: take gymnasium's."
            )
        for name, value in (("fps", fps), ("rate", rate)):
            if not isinstance(value, Real) or not 0 < value < math.inf:
                raise ConfigError(f"{name} is {value!r}, but must be a number above 0.")
        require_function(episode_trigger, "episode_trigger", "episode")
        self._highway = env.unwrapped
        self._prefix = Path(video_folder) / name_prefix
        with refusals(f"The folder {video_folder} cannot be made", "name another", RecordingError):
            self._prefix.parent.mkdir(parents=True, exist_ok=True)
        names = f"{glob.escape(self._prefix.name)}-episode-*.mp4"
        if any(self._prefix.parent.glob(names)):
            gymnasium.logger.warn(
                "Films of an earlier run in %s may be overwritten: name another video_folder or "
                "name_prefix to keep them.",
                self._prefix.parent,
            )
        self._fps, self._rate, self._trigger = fps, rate, episode_trigger
        self._episode = -1
        self._film: Film | None = None
        require_film(self._file, fps)

    @property
    def _file(self) -> Path:
        return self._prefix.with_name(f"{self._prefix.name}-episode-{self._episode}.mp4")

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observation, dict[str, Any]]:
        """Write the film of an unfinished episode, if there is one, and start the next episode."""
        self._write()
        started = self.env.reset(seed=seed, options=options)
        self._episode += 1
        if self._trigger(self._episode):
            self._film = Film("", self._highway.road, self._highway.seed)
        return started

    def step(self, action: np.int64) -> tuple[Observation, float, bool, bool, dict[str, Any]]:
        """Execute one decision; write the film if the episode ends."""
        scene = getattr(self._highway, "scene", None)
        observation, reward, terminated, truncated, info = self.env.step(action)
        if self._film is not None and scene is not None:
            made = self._highway.transition
            self._film.add(made._replace(scene=scene, reward=float(reward)))
            if terminated or truncated:
                self._write()
        return observation, float(reward), terminated, truncated, info

    def close(self) -> None:
        """Write the film of an unfinished episode, if there is one, and close the environment."""
        try:
            self._write()
        finally:
            self.env.close()

    def _write(self) -> None:
        film, self._film = self._film, None
        if film is not None and film.decisions:
            film.write(self._file, self._fps, self._rate)
