"""Robots' bags from the command's function to the result: a run, a rig, a camera on a flange, and CameraInfo."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

import calib
from calib.core.se3 import exp_rotation, invert, look_at, make_pose, steps_between
from calib.renderer.options import RenderOptions
from calib.renderer.view import render_view
from calib.rigs.motion import Trajectory
from designer.base.arrays import Array
from designer.base.errors import InputError
from tests.support.bags import START_NS, Said, camera_info, image, pose_stamped, transforms, write_bag
from tests.support.calibrations import board, camera, poses_around

BOARD = board(7, 5, "12mm")
CAMERA = camera("opencv", (640, 480), 700.0)
RIGHT_FROM_LEFT = make_pose(exp_rotation(np.array([0.0, -0.1, 0.01])), np.array([-20.0, 0.0, 1.0]))
FLANGE_FROM_CAM = make_pose(exp_rotation(np.array([0.1, -0.2, 1.5])), np.array([40.0, -25.0, 90.0]))
BASE_FROM_TARGET = make_pose(exp_rotation(np.array([0.02, 0.01, 0.3])), np.array([600.0, 100.0, -50.0]))
BEHIND_S, STEP_S, COUNT = 0.03, 0.2, 24
OPTIONS = RenderOptions(blur_px=0.6, contrast_to_noise=80)


def track() -> Trajectory:
    """cam_from_target of a robot that never stops, turning about all axes."""
    at = np.linspace(0, 2 * np.pi, 12)
    eye = 170 * np.stack([0.5 * np.sin(at), 0.5 * np.sin(2 * at + 0.5), 0.9 + 0.15 * np.cos(at)], axis=1)
    return Trajectory(np.linspace(0, 6.0, 12), look_at(eye, np.zeros((12, 3)), 1.2 * np.sin(3 * at)))


@pytest.fixture(scope="module")
def moving(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A camera on a robot that moves, whose clock is behind; tf over two joints, and the flange's pose as a topic."""
    rng, way = np.random.default_rng(4), track()

    def said() -> Iterator[Said]:
        link = make_pose(exp_rotation(np.array([0.3, 0.0, 0.1])), np.array([0.0, 50.0, 300.0]))
        yield transforms("/tf_static", START_NS, {("world", "base_link"): link, ("base_link", "link1"): link})
        for k in range(COUNT):
            for j in range(20):
                at_s = 0.4 + k * STEP_S + j * STEP_S / 20
                stamp = START_NS + round(1e9 * (at_s - BEHIND_S))
                base_from_flange = BASE_FROM_TARGET @ invert(way.at(np.array([at_s]))[0]) @ invert(FLANGE_FROM_CAM)
                yield transforms("/tf", stamp, {("link1", "tool0"): invert(link) @ base_from_flange})
                yield pose_stamped("/tool_pose", stamp, base_from_flange)
            at_s = 0.4 + k * STEP_S
            shown = render_view(BOARD, CAMERA, way.at(np.array([at_s]))[0], OPTIONS, rng).image.astype(np.uint8)
            yield image("/cam/image_raw", START_NS + round(1e9 * at_s), shown)
        k = [700.0, 0, 323, 0, 701, 238, 0, 0, 1]
        yield camera_info("/cam/camera_info", START_NS, (640, 480), k, [-0.1, 0.05, 0.001, -0.0005, 0])

    return write_bag(tmp_path_factory.mktemp("bags") / "moving.mcap", said())


def off_mm(found: Array, true: Array) -> float:
    """How far a place is off."""
    return float(np.linalg.norm((found @ invert(true))[:3, 3]))


@pytest.mark.parametrize("given", [{"tf": ("base_link", "tool0")}, {"robot": "#/tool_pose"}])
def test_a_moving_robot_by_another_clock_tells_where_its_camera_sits(moving: Path, given: dict[str, object]) -> None:
    """The offset of the clocks is solved of the motion, and told; without it the place would be off by millimetres."""
    if "robot" in given:
        given = {"robot": f"{moving}{given['robot']}"}
    found = calib.hand_eye(BOARD, moving, **given, camera=CAMERA, made="exact")
    assert off_mm(found.hand_eye.flange_from_cam, FLANGE_FROM_CAM) < 0.05
    (line,) = [one for one in found.calibration.observations.remarks if "clocks" in one]
    ahead = float(line.partition("is ahead by ")[2].split()[0])
    assert ahead == pytest.approx(1e3 * BEHIND_S, abs=0.2)
    step = steps_between(found.rig.cam_from_rig[0], invert(FLANGE_FROM_CAM))
    rows = found.rig.pose_rows(0)
    covariance = found.rig.covariance[rows, rows]
    assert step @ np.linalg.solve(covariance, step) < 22.5  # chi-square of 6, at .999


def test_poses_with_stamps_are_interpolated_at_photos_named_by_theirs(moving: Path, tmp_path: Path) -> None:
    """A table of time_s and a folder of photos give what the bag gives."""
    import cv2

    from calib.images.bag import Bag
    from calib.observe.bag_photos import photos_in
    from calib.observe.transforms import transforms_in

    poses = transforms_in(Bag(moving)).poses("base_link", "tool0")
    photos = photos_in(str(moving)).photos
    for photo in photos:
        cv2.imwrite(str(tmp_path / f"{photo.path.name}.png"), photo.read().pixels)
    rows = [
        ",".join(map(repr, [time_s, *pose[:3].ravel().tolist()]))
        for time_s, pose in zip(poses.time_s.tolist(), poses.base_from_flange, strict=True)
    ]
    names = ",".join(f"m{row}{column}{'_mm' * (column == 3)}" for row in range(3) for column in range(4))
    (tmp_path / "robot.csv").write_text("\n".join([f"time_s,{names}", *rows]) + "\n")
    found = calib.hand_eye(BOARD, tmp_path, robot=tmp_path / "robot.csv", camera=CAMERA, made="exact")
    assert len(found.calibration.observations.frame_names) == len(photos) == COUNT
    assert off_mm(found.hand_eye.flange_from_cam, FLANGE_FROM_CAM) < 0.05


def test_a_bag_is_as_good_as_its_images_as_files(moving: Path, tmp_path: Path) -> None:
    """A run of the only topic, the run's folder written whole."""
    run = calib.run(BOARD, moving, model="opencv", made="exact", out=tmp_path / "run")
    assert len(run.best.calibration.observations.view_names) == COUNT
    assert run.best.camera.params[0] == pytest.approx(700, rel=2e-3)
    assert run.best.calibration.observations.view_names[0] == f"{START_NS + 400_000_000}"
    same = calib.run(BOARD, f"{moving}#/cam/image_raw", model="opencv", made="exact")
    np.testing.assert_array_equal(same.best.camera.params, run.best.camera.params)


def test_two_topics_are_a_rig(tmp_path: Path) -> None:
    """Joined by their stamps, named by what tells the topics apart."""
    rng = np.random.default_rng(5)
    said = []
    for k, pose in enumerate(poses_around(6, rng, half_angle_rad=0.7, distance_mm=160.0)):
        for side, one, late_ns in (("left", pose, 0), ("right", RIGHT_FROM_LEFT @ pose, 3_000_000)):
            shown = render_view(BOARD, CAMERA, one, OPTIONS, rng).image.astype(np.uint8)
            said.append(image(f"/{side}/image_raw", START_NS + k * 10**8 + late_ns, shown))
    bag = write_bag(tmp_path / "run.bag", said)
    lenses = {"left": CAMERA, "right": CAMERA}
    found = calib.rig(BOARD, bag, topics="/left/image_raw,/right/image_raw", cameras=lenses, made="exact")
    assert found.rig.names == ("left", "right")
    assert off_mm(found.rig.cam_from_rig[1], RIGHT_FROM_LEFT) < 0.05
    assert any("3 ms apart (median)" in one for one in found.calibration.observations.remarks)
    found.save(tmp_path / "rig")
    told = calib.check(tmp_path / "rig", BOARD, [f"{bag}#/{side}/image_raw" for side in ("left", "right")])
    assert "no change is seen" in told.reason
    with pytest.raises(InputError, match=r"topics A,B; there are /left/image_raw \(sensor_msgs/Image, 6\), /right"):
        calib.rig(BOARD, bag)
    with pytest.raises(InputError, match=r"several topics of type Image, name one with run.bag#TOPIC; there are /left"):
        calib.run(BOARD, bag)
    with pytest.raises(InputError, match="two are the same"):
        calib.rig(BOARD, bag, topics=["/left/image_raw", "left/image_raw"])
    with pytest.raises(InputError, match="topics: are of one robot's bag"):
        calib.rig(BOARD, tmp_path, topics="/a,/b")


def test_camera_info_is_a_camera(moving: Path, tmp_path: Path) -> None:
    """With a region and binning as a file's; the only topic needs no name."""
    found = calib.load_camera(f"{moving}#/cam/camera_info")
    assert found.image_size == (640, 480)
    np.testing.assert_array_equal(found.params[:6], [700, 701, 323, 238, -0.1, 0.05])
    np.testing.assert_array_equal(calib.load_camera(str(moving)).params, found.params)
    told = {"binning_x": 2, "binning_y": 2, "roi": {"x_offset": 0, "y_offset": 0, "width": 640, "height": 480}}
    half = [camera_info("/a", START_NS, (640, 480), [700, 0, 323, 0, 701, 238, 0, 0, 1], [0] * 5, **told)]
    half += [camera_info("/a", START_NS + 1, (640, 480), [800, 0, 323, 0, 801, 238, 0, 0, 1], [0] * 5)]
    made = calib.convert(str(write_bag(tmp_path / "half.db3", half)), "opencv")
    assert made.camera.image_size == (320, 240)
    np.testing.assert_allclose(made.camera.params[:4], [350, 350.5, 161.25, 118.75])
    assert any("1 of 2 messages say something else" in one for one in made.remarks)
    with pytest.raises(InputError, match=r"#TOPIC '/b': no such topic; there are /a \(sensor_msgs/CameraInfo, 2\)"):
        calib.load_camera(f"{tmp_path / 'half.db3'}#/b")


def test_what_does_not_go_together_is_a_line(moving: Path, tmp_path: Path) -> None:
    """Options of a bag without one, frames that are not there, and poses twice."""
    (tmp_path / "photos").mkdir()
    for given, line in (
        ({}, "no robot poses; give"),
        ({"tf": ("base_link", "tool0"), "robot": "robot.csv"}, "and so does robot; leave one out"),
        ({"tf": ("base_link", "tool1")}, r"no frame 'tool1'; did you mean 'tool0'\?"),
        ({"tf": ("base_link", "tool0"), "unit": "mm"}, "unit: a bag's poses are in metres and quaternions"),
        ({"tf": ("base_link", "tool0"), "image": "/cam/image"}, "image '/cam/image': no such topic; there are /cam/im"),
        ({"robot": f"{moving}#/tf"}, r"robot '/tf': is of type tf2_msgs/msg/TFMessage; there are /tool_pose"),
    ):
        with pytest.raises(InputError, match=line):
            calib.hand_eye(BOARD, moving, **given)
    with pytest.raises(InputError, match="tf: is of a robot's bag, which the photos have to be"):
        calib.hand_eye(BOARD, tmp_path / "photos", tf=("a", "b"))
    with pytest.raises(InputError, match="topic '/a': is of a robot's bag, and none is given"):
        calib.run(BOARD, tmp_path / "photos", topic="/a")
