"""The trajectories of a recorded episode: data frame, Parquet file and time-space diagram."""

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from drl_av.driving.actions import ACTIONS
from drl_av.errors import needed_by
from drl_av.evaluation.figure_style import label_axes, panels
from drl_av.evaluation.recording import COLUMNS, Recording, load_recording
from drl_av.files.atomic import write_atomic
from drl_av.road.snapshot import EGO

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def import_pandas(caller: str) -> Any:
    """Return the module pandas; raise DrlAvError, which names the caller, if it is missing."""
    with needed_by(caller, "pandas", "'drl-av[parquet]'"):
        import pandas
    return pandas


def episode_frame(recording: Recording | str | Path) -> Any:
    """Return a recorded episode as a pandas DataFrame: one row for each vehicle and second (ours).

    Args:
        recording: A file of ``drl-av replay --record`` or ``drl-av evaluate --record``.

    Returns:
        The columns ``time_s``, ``id``, ``lane`` (0 is the rightmost), ``s_m``, ``y_m``,
        ``speed_m_s``, ``lateral_speed_m_s``, ``acceleration_m_s2`` (the mean until the vehicle's
        next row; NaN in its last), and for the ego ``decision``, the action that it executes from
        then on, and ``rule``, the rule of the safety check that changed the action, or ``none``;
        both are empty for the other vehicles. Last ``length_m`` and ``width_m``.

    Raises:
        RecordingError: the file is no recording, or is damaged.
        ScenarioError: the scenario of the episode cannot be read.
        DrlAvError: pandas is not installed.
    """
    pandas = import_pandas("episode_frame")
    if not isinstance(recording, Recording):
        recording = load_recording(Path(recording))
    states, time_s = recording.states, recording.time_s
    duration_s = np.diff(time_s, append=np.nan)[:, None]
    acceleration = np.diff(states[:, :, 2], axis=0, append=np.nan) / np.where(
        duration_s > 0.0, duration_s, np.nan
    )
    decision, rule = np.full((2, *states.shape[:2]), "", dtype=object)
    decision[:-1, EGO] = [str(ACTIONS[number]) for number in recording.executed]
    rule[:-1, EGO] = recording.rules
    shown = ~np.isnan(states[:, :, 0])
    if time_s[-1:] == time_s[-2:-1]:  # the ego left the lanes in the first SUMO step
        shown[-1] = False
    moment, vehicle = there = np.nonzero(shown)
    frame = {
        "time_s": time_s[moment],
        "id": recording.ids[vehicle],
        "lane": _lanes(recording)[there],
        **dict(zip(COLUMNS, states[there].T, strict=True)),
        "acceleration_m_s2": acceleration[there],
        "decision": decision[there],
        "rule": rule[there],
        **dict(zip(("length_m", "width_m"), recording.sizes_m[vehicle].T, strict=True)),
    }
    return pandas.DataFrame(frame)


def _lanes(recording: Recording) -> Any:
    """Return the index of each vehicle's lane, shape (T + 1, 1 + N); -1 where it is not there."""
    width_m = recording.road.lane_width_m
    return np.nan_to_num(np.floor(recording.states[:, :, 1] / width_m + 0.5), nan=-1).astype(int)


def require_parquet() -> None:
    """Raise DrlAvError unless the packages that write a Parquet file are installed."""
    frame = import_pandas("--parquet").DataFrame({"column": [0]})
    with needed_by("--parquet", "fastparquet", "'drl-av[parquet]'"):
        frame.to_parquet(None)


def write_parquet(recording: Recording, path: Path) -> None:
    """Write ``episode_frame`` as a Parquet file, atomically; DrlAvError if that is impossible."""
    require_parquet()
    write_atomic(path, episode_frame(recording).to_parquet(None, index=False))


def time_space_figure(recording: Recording) -> "Figure":
    """Draw position along the road against time, a panel for each lane, with speed as colour.

    The ego has a black border.
    """
    from matplotlib.collections import LineCollection

    road, lanes, s_m = recording.road, _lanes(recording), recording.states[:, :, 0]
    speeds = recording.states[:, :, 2]
    goes_on = np.abs(np.diff(s_m, axis=0)) < road.lap_m / 2  # False at NaN and where a lap begins
    count = len(road.open_lanes)
    figure, axes = panels((7, 1 + 1.9 * count), count, 1, sharex=True, sharey=True, squeeze=False)
    for lane, panel in zip(reversed(range(count)), axes[:, 0], strict=True):
        moment, vehicle = np.nonzero(goes_on & (lanes[:-1] == lane))
        ends = [(recording.time_s[each], s_m[each, vehicle]) for each in (moment, moment + 1)]
        lines = np.stack([np.stack(end, axis=1) for end in ends], axis=1)
        panel.add_collection(
            LineCollection([*lines[vehicle == EGO]], colors="black", linewidths=3.5)
        )
        colored = LineCollection([*lines], array=speeds[moment, vehicle], cmap="turbo_r")
        colored.set_clim(0.0, float(np.nanmax(speeds)))
        panel.add_collection(colored)
        panel.autoscale_view()
        label_axes(panel, y=f"lane {lane}")
    label_axes(axes[-1, 0], "time, s")
    figure.supylabel("position along the road, m", fontsize="medium")
    figure.colorbar(colored, ax=axes, label="speed, m/s (the ego: black border)")
    return figure
