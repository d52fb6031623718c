"""Writes videos of scenes, and interpolates a scene between two decisions."""

import math
import os
from collections.abc import Iterable, Iterator
from contextlib import closing, contextmanager
from itertools import chain, pairwise
from pathlib import Path
from types import ModuleType

import numpy as np
from PIL import Image

from drl_av.arrays import FloatArray
from drl_av.drawing.picture import Picture
from drl_av.errors import RecordingError, needed_by
from drl_av.files.atomic import replacing
from drl_av.road.road import Road
from drl_av.road.snapshot import Snapshot

GIF_FPS = 50
"""Most frames a second of a .gif file: programs show a frame of less than 20 ms for 100 ms."""


def interpolated(a: Snapshot, b: Snapshot, fraction: float, road: Road) -> Snapshot:
    """Return the scene at a fraction of the time from snapshot ``a`` (0) to snapshot ``b`` (1).

    The scene contains the vehicles that are in both snapshots. On a loop, a vehicle may have driven
    whole laps between the snapshots. Of the possible distances, the function uses the one that is
    nearest to the vehicle's mean speed times the time between them.
    """
    a, b = _rows(a, b.ids), _rows(b, a.ids)
    expected_m = (a.speed_m_s + b.speed_m_s) / 2 * (b.time_s - a.time_s)
    travel_m = expected_m + road.ahead_m(0.0, b.s_m - a.s_m - expected_m)
    s_m = (a.s_m + fraction * travel_m) % road.lap_m
    return a._replace(
        time_s=a.time_s + fraction * (b.time_s - a.time_s),
        s_m=np.where(s_m < road.lap_m, s_m, 0.0),
        y_m=_between(a.y_m, b.y_m, fraction),
        speed_m_s=_between(a.speed_m_s, b.speed_m_s, fraction),
        lateral_speed_m_s=_between(a.lateral_speed_m_s, b.lateral_speed_m_s, fraction),
    )


def _between(a: FloatArray, b: FloatArray, fraction: float) -> FloatArray:
    """Return the linear interpolation between two arrays."""
    return a + fraction * (b - a)


def _rows(snapshot: Snapshot, wanted: tuple[str, ...]) -> Snapshot:
    """Return the snapshot of the ``wanted`` vehicles; if that is not all, sorted by id."""
    if snapshot.ids == wanted:
        return snapshot
    kept = [row for row, name in enumerate(snapshot.ids) if name in set(wanted)]
    kept.sort(key=lambda row: (row > 0, snapshot.ids[row]))
    return snapshot.of_rows(kept)


def write_video(path: str | os.PathLike[str], frames: Iterable[Picture], fps: float) -> int:
    """Write pictures to an .mp4 or .gif file, and return their number.

    ``frames`` are uint8 arrays, all of one shape (H, W, 3). The file gets its name only when it is
    complete. An .mp4 file is written frame by frame (H.264, yuv420p, padded to even sizes). A .gif
    file should be short, because its frames are kept in memory.

    Raises:
        RecordingError: the name, the folder or ``fps`` is wrong, there are no frames, or writing
            fails.
    """
    path = Path(path)
    require_film(path, fps)
    write = _write_gif if path.suffix.lower() == ".gif" else _write_mp4
    with replacing(path, RecordingError) as temporary:
        temporary.touch()
        return write(temporary, path, iter(frames), fps)


def require_film(path: Path, fps: float) -> None:
    """Check before any drawing that ``write_video`` can write to ``path``.

    Raises:
        RecordingError: the suffix is not .mp4 or .gif, the folder does not exist, ``path`` is a
            folder, ``fps`` is not positive or too large for a .gif file, or the encoder of .mp4 is
            not installed.
    """
    if path.suffix.lower() not in (".mp4", ".gif"):
        given = f"not in {path.suffix}" if path.suffix else "and it has no suffix"
        raise RecordingError(f"Cannot write {path}: its name must end in .mp4 or .gif, {given}.")
    if not path.parent.is_dir():
        raise RecordingError(
            f"Cannot write {path}: the folder {path.parent} does not exist; create it first."
        )
    if path.is_dir():
        raise RecordingError(f"Cannot write {path}: it is a folder; choose another name.")
    if not 0 < fps < math.inf:
        raise RecordingError(f"Cannot write {path} at {fps:g} frames a second: choose more than 0.")
    if path.suffix.lower() == ".mp4":
        _ffmpeg()
    elif fps > GIF_FPS:
        raise RecordingError(
            f"Cannot write {path} at {fps:g} frames a second, because a .gif file shows at most "
            f"{GIF_FPS}: choose a lower rate, or name an .mp4 file."
        )


def _ffmpeg() -> ModuleType:
    install = "imageio-ffmpeg, or name a .gif file"
    with needed_by("A film in .mp4", "imageio-ffmpeg", install, RecordingError):
        import imageio_ffmpeg
    return imageio_ffmpeg  # type: ignore[no-any-return]


@contextmanager
def _encoding(path: Path) -> Iterator[None]:
    """Raise RecordingError with one sentence if the encoder fails inside the ``with`` block."""
    try:
        yield
    except (OSError, RuntimeError) as error:
        reason = getattr(error, "strerror", None) or "the video encoder stopped early"
        raise RecordingError(
            f"{path} cannot be written ({reason}): check that the disk has room and that the "
            "folder is writable."
        ) from error


def _first(frames: Iterator[Picture], path: Path) -> Picture:
    """Return the first frame; raise RecordingError if there is none."""
    for frame in frames:
        return frame
    raise RecordingError(f"Cannot write {path}: there are no frames; record an episode first.")


def _write_mp4(temporary: Path, path: Path, frames: Iterator[Picture], fps: float) -> int:
    """Write an .mp4 file (H.264) to ``temporary``; return the number of frames.

    Errors name ``path``.
    """
    first = _even(_first(frames, path))
    encoder = _ffmpeg().write_frames(
        str(temporary),
        first.shape[1::-1],
        fps=fps,
        codec="libx264",
        pix_fmt_out="yuv420p",
        macro_block_size=1,
        ffmpeg_log_level="quiet",
        output_params=["-crf", "20", "-preset", "fast", "-movflags", "+faststart"],
    )
    count = 0
    with closing(encoder):
        with _encoding(path):
            encoder.send(None)
        for frame in chain([first], map(_even, frames)):
            with _encoding(path):
                encoder.send(np.ascontiguousarray(frame))
            count += 1
    with _encoding(path):
        if _ffmpeg().count_frames_and_secs(str(temporary))[0] != count:
            raise RuntimeError("frames are missing from the file")
    return count


def _even(frame: Picture) -> Picture:
    """Return the frame padded to even width and height, by repeating its last row or column."""
    height, width = frame.shape[:2]
    return np.pad(frame, ((0, height % 2), (0, width % 2), (0, 0)), mode="edge")


def _write_gif(temporary: Path, path: Path, frames: Iterator[Picture], fps: float) -> int:
    """Write a .gif file to ``temporary``; return the number of frames. Errors name ``path``."""
    images = [_indexed(_first(frames, path)), *map(_indexed, frames)]
    ends_cs = [round(100 * count / fps) for count in range(len(images) + 1)]  # GIF's unit is 10 ms
    durations_ms = [10 * (end - begin) for begin, end in pairwise(ends_cs)]
    with _encoding(path):
        images[0].save(
            temporary, save_all=True, append_images=images[1:], duration=durations_ms, loop=0
        )
    return len(images)


def _indexed(frame: Picture) -> Image.Image:
    """Return the frame as an image of 256 colours, which a .gif file needs."""
    return Image.fromarray(frame).quantize(256, dither=Image.Dither.NONE)
