"""Pictures of a scene, moments between decisions, and videos."""

import math
import sys
from collections.abc import Iterator
from pathlib import Path

import imageio_ffmpeg
import numpy as np
import pytest
from PIL import Image, ImageSequence
from programs import python
from worlds import BARRICADED_ROAD, LEFT, RIGHT, ROAD, Car, snapshot

from drl_av.drawing.canvas import ALARM, AMBER, ASPHALT, EGO_COLOR, GROUND, speed_color
from drl_av.drawing.film import interpolated, write_video
from drl_av.drawing.panels import Caption
from drl_av.drawing.picture import Picture, draw
from drl_av.drawing.road_view import CLOSE_UP, OVERVIEW, RoadStrip
from drl_av.errors import RecordingError
from drl_av.road.road import OPEN_LAP_M, PartialLane, Road

BANDS = pytest.mark.parametrize("band", [CLOSE_UP, OVERVIEW], ids=["close-up", "overview"])


def places_of(
    picture: Picture, color: tuple[int, int, int], band: RoadStrip
) -> tuple[float, float]:
    """Mean (column, row) of the pixels of a colour inside a band."""
    stretch = picture[band.top - 10 : band.top + 3 * band.lane_px + 10]
    rows, columns = np.nonzero((stretch == color).all(axis=2))
    assert len(rows) > 20, "the colour is not in the band"
    return float(columns.mean()), float(rows.mean()) + band.top - 10


@BANDS
@pytest.mark.parametrize("y_m", [0.0, 3.8, 7.6])
def test_ego_is_in_its_own_colour_on_the_centre_row_of_its_lane(
    band: RoadStrip, y_m: float
) -> None:
    picture = draw(snapshot(y_m=y_m), ROAD, Caption())
    _, row = places_of(picture, EGO_COLOR, band)
    lane_from_left = 2 - round(y_m / 3.8)
    assert row == pytest.approx(band.top + (lane_from_left + 0.5) * band.lane_px, abs=2)


@BANDS
def test_vehicle_50_m_ahead_in_the_left_lane_is_right_of_and_above_the_ego(band: RoadStrip) -> None:
    picture = draw(snapshot(Car(50.0, LEFT), s_m=480.0), ROAD, Caption())
    ego_column, ego_row = places_of(picture, EGO_COLOR, band)
    column, row = places_of(picture, speed_color(20.0), band)
    assert column - ego_column == pytest.approx(50 * band.px_per_m, abs=3)
    assert row - ego_row == pytest.approx(-band.lane_px, abs=2)


def test_rightmost_lane_is_outermost_on_the_loop_and_a_quarter_on_is_at_the_top() -> None:
    picture = draw(snapshot(s_m=125.0, y_m=RIGHT), ROAD, Caption())[384:, :352]
    rows, columns = np.nonzero((picture == EGO_COLOR).all(axis=2))
    assert columns.mean() == pytest.approx(186, abs=1)
    outermost_lane_px = 146 - 8
    assert rows.mean() + 384 == pytest.approx(548 - outermost_lane_px, abs=1)


def test_same_scene_twice_is_the_same_bytes_whatever_was_drawn_between() -> None:
    caption = Caption("idm", 1, 7, 3, "brake", "brake", "in lane", -0.5, -0.5, 0.0, -1.0)
    before = draw(snapshot(Car(30.0, RIGHT)), ROAD, caption)
    draw(snapshot(Car(-67.0, LEFT), s_m=77.0, y_m=RIGHT), ROAD, Caption("other"))
    assert before.tobytes() == draw(snapshot(Car(30.0, RIGHT)), ROAD, caption).tobytes()


def test_barricaded_lane_looks_different_and_the_open_ones_do_not() -> None:
    shot = snapshot(y_m=LEFT)
    opened, barred = (draw(shot, road, Caption()) for road in (ROAD, BARRICADED_ROAD))
    differs = (opened != barred).any(axis=2)[:, CLOSE_UP.left : CLOSE_UP.right]
    right_lane = CLOSE_UP.top + 2 * CLOSE_UP.lane_px
    assert differs[right_lane + 3 : right_lane + CLOSE_UP.lane_px - 3].mean() > 0.9
    assert not differs[CLOSE_UP.top : right_lane - 3].any()


def test_lanes_on_either_side_are_drawn_where_they_are_and_end_at_a_bar() -> None:
    # the two lanes on the right end 20 m ahead of the ego, the left one 10 m behind it
    right = [PartialLane(lane, 0.0, 120.0, 0.0, 120.0) for lane in (0, 1)]
    left = PartialLane(4, 0.0, 90.0, 0.0, 90.0)
    road = Road(OPEN_LAP_M, 3.8, (True,) * 5, 900.0, (*right, left))
    picture = draw(snapshot(y_m=LEFT), road, Caption())

    def at(s_m: float, y_m: float) -> tuple[int, ...]:
        row = round(CLOSE_UP.y(road, y_m))
        return tuple(picture[row, round(CLOSE_UP.x(s_m - 100.0))].tolist())

    assert [at(80.0, lane * 3.8) for lane in range(5)] == [ASPHALT] * 5
    assert [at(110.0, lane * 3.8) for lane in range(5)] == [ASPHALT] * 4 + [GROUND]
    assert [at(130.0, lane * 3.8) for lane in range(5)] == [GROUND] * 2 + [ASPHALT] * 2 + [GROUND]
    assert [at(120.0, 0.0), at(120.0, 3.8), at(90.0, 15.2)] == [ALARM] * 3
    edge_m = 4 * 3.8 - 1.9
    assert {at(95.0 + step, edge_m) for step in range(30)} == {AMBER}
    assert {at(122.0 + step, 1.9) for step in range(30)} == {GROUND}  # no dashes in the meadow


def test_ego_moving_left_signals_on_its_left_side_only() -> None:
    straight, left = (draw(snapshot(v_y=v_y), ROAD, Caption()) for v_y in (0.0, 0.76))
    changed = (straight != left).any(axis=2)
    ego_row = CLOSE_UP.top + CLOSE_UP.lane_px + CLOSE_UP.lane_px // 2
    assert changed[CLOSE_UP.top : ego_row - 2].any()
    assert not changed[ego_row + 2 : OVERVIEW.top - 10].any()


@pytest.mark.parametrize(
    "caption",
    [
        Caption(rule="in lane: the gap is too short " * 10),
        Caption(collision="ego hit the vehicle ahead"),
        Caption(proposed="accelerate", executed="brake"),
        Caption(reward=-0.5, r_v=-1.0, r_y=-0.5, r_x=0.0),
        Caption(speed_history=(20.0, 25.0), trigger_history=(False, True)),
        Caption(driver="x" * 500),
    ],
)
def test_the_caption_is_drawn_below_or_above_the_road(caption: Caption) -> None:
    plain = draw(snapshot(), ROAD, Caption())
    differs = (draw(snapshot(), ROAD, caption) != plain).any(axis=2)
    assert differs.any()
    assert not differs[48:384].any()
    assert not differs[:, :18].any()
    assert not differs[:, 1262:].any()
    assert not differs[:, :364][384:].any()


@pytest.mark.parametrize("size", [(640, 360), (1920, 1080), (600, 600)])
def test_picture_has_the_size_asked_for(size: tuple[int, int]) -> None:
    picture = draw(snapshot(), ROAD, Caption(), size)
    assert picture.shape == (size[1], size[0], 3)
    assert picture.dtype == np.uint8
    assert (picture == EGO_COLOR).all(axis=2).any()


@pytest.mark.parametrize("lanes", [1, 2, 5])
def test_ego_is_on_the_asphalt_with_other_numbers_of_lanes(lanes: int) -> None:
    road = Road(150.0, 3.2, (True,) * lanes)
    picture = draw(snapshot(y_m=3.2 * (lanes - 1)), road, Caption())
    _, row = places_of(picture, EGO_COLOR, CLOSE_UP)
    assert CLOSE_UP.top < row < CLOSE_UP.top + 3 * CLOSE_UP.lane_px


def test_halfway_over_the_seam_goes_the_short_way_on() -> None:
    a = snapshot(Car(105.0), s_m=495.0, y_m=RIGHT, time_s=3.0)
    b = snapshot(Car(105.0), s_m=15.0, time_s=4.0)
    middle = interpolated(a, b, 0.75, ROAD)
    np.testing.assert_allclose(middle.s_m, [10.0, 115.0])
    np.testing.assert_allclose(middle.y_m, [2.85, 3.8])
    assert middle.time_s == 3.75


def test_vehicle_goes_forward_even_where_backward_is_shorter_on_a_small_loop() -> None:
    small = Road(50.0, 3.8, (True,))
    a, b = (snapshot(s_m=30.0 * t, y_m=RIGHT, speed_m_s=30.0, time_s=t) for t in (0.0, 1.0))
    assert interpolated(a, b, 0.5, small).s_m[0] == pytest.approx(15.0)


def test_vehicles_are_matched_by_name_when_their_rows_differ() -> None:
    a = snapshot(Car(100.0), Car(200.0, LEFT), s_m=0.0, time_s=3.0)
    b = snapshot(Car(200.0, LEFT), Car(280.0), s_m=20.0, time_s=4.0)
    middle = interpolated(a, b._replace(ids=("ego", "vehicle2", "vehicle9")), 0.5, ROAD)
    assert middle.ids == ("ego", "vehicle2")
    np.testing.assert_allclose(middle.s_m, [10.0, 210.0])


def frames(number: int, height: int = 90, width: int = 160) -> Iterator[Picture]:
    for shade in range(number):
        yield np.full((height, width, 3), 20 * shade, dtype=np.uint8)


def test_mp4_has_every_frame_at_even_size_and_nothing_is_left_beside_it(tmp_path: Path) -> None:
    path = tmp_path / "ride.mp4"
    assert write_video(path, frames(7, height=91, width=161), fps=5) == 7
    assert imageio_ffmpeg.count_frames_and_secs(str(path))[0] == 7
    about = next(imageio_ffmpeg.read_frames(str(path)))
    assert about["size"] == (162, 92)
    assert about["fps"] == 5
    assert about["codec"] == "h264"
    assert about["pix_fmt"].startswith("yuv420p")
    assert list(tmp_path.iterdir()) == [path]


def test_gif_has_every_frame_and_its_time(tmp_path: Path) -> None:
    path = tmp_path / "ride.gif"
    assert write_video(path, frames(4), fps=10) == 4
    with Image.open(path) as image:
        found = getattr(image, "n_frames", 1), image.size, image.info["duration"]
    assert found == (4, (160, 90), 100)
    assert list(tmp_path.iterdir()) == [path]


def test_a_gif_is_as_long_as_its_episode_though_it_counts_in_hundredths(tmp_path: Path) -> None:
    path = tmp_path / "ride.gif"
    write_video(path, frames(11), fps=11)  # 90.9 ms each
    with Image.open(path) as image:
        durations = [frame.info["duration"] for frame in ImageSequence.Iterator(image)]
    assert (len(durations), sum(durations)) == (11, 1000)
    assert set(durations) == {90, 100}


@pytest.mark.parametrize("name", ["ride.mp4", "ride.gif"])
def test_frames_that_fail_leave_the_former_video_and_no_pieces(tmp_path: Path, name: str) -> None:
    path = tmp_path / name
    path.write_bytes(b"former")

    def failing() -> Iterator[Picture]:
        yield from frames(2)
        raise KeyError("driver")

    with pytest.raises(KeyError, match="driver"):
        write_video(path, failing(), fps=5)
    assert path.read_bytes() == b"former"
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.parametrize(
    ("name", "fps", "number", "message"),
    [
        ("ride.avi", 5, 1, r"must end in \.mp4 or \.gif, not in \.avi"),
        ("ride", 5, 1, "it has no suffix"),
        ("missing/ride.mp4", 5, 1, "does not exist; create it"),
        ("ride.mp4", 0, 1, "more than 0"),
        ("ride.mp4", math.inf, 1, "more than 0"),
        ("ride.gif", 51, 1, "a .gif file shows at most 50: choose a lower rate, or name an .mp4"),
        ("ride.mp4", 5, 0, "no frames"),
        ("ride.gif", 5, 0, "no frames"),
    ],
)
def test_a_film_that_cannot_be_written_is_reported_in_one_sentence(
    tmp_path: Path, name: str, fps: float, number: int, message: str
) -> None:
    with pytest.raises(RecordingError, match=message) as error:
        write_video(tmp_path / name, frames(number), fps)
    assert name in str(error.value)
    assert "\n" not in str(error.value)
    assert list(tmp_path.iterdir()) == []


FULL_DISK = """
import resource, sys
import numpy as np
from drl_av.errors import RecordingError
from drl_av.drawing.film import write_video
resource.setrlimit(resource.RLIMIT_FSIZE, (20_000, 20_000))
noise = np.random.default_rng(1)
try:
    write_video(sys.argv[1], (noise.integers(0, 255, (360, 640, 3), np.uint8) for _ in range(9)), 5)
except RecordingError as error:
    print(error)
"""


@pytest.mark.parametrize("name", ["ride.mp4", "ride.gif"])
def test_full_disk_is_one_sentence_and_leaves_nothing(tmp_path: Path, name: str) -> None:
    ended = python("-c", FULL_DISK, tmp_path / name)
    assert ended.returncode == 0, ended.stderr
    assert "check that the disk has room" in ended.stdout
    assert ended.stdout.count("\n") == 1
    assert list(tmp_path.iterdir()) == []


def test_without_the_encoder_a_gif_is_written_and_an_mp4_names_the_package(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "imageio_ffmpeg", None)
    frames = [np.zeros((4, 4, 3), np.uint8)] * 2
    assert write_video(tmp_path / "film.gif", frames, 5.0) == 2
    with pytest.raises(RecordingError, match=r"pip install imageio-ffmpeg, or name a \.gif"):
        write_video(tmp_path / "film.mp4", frames, 5.0)
