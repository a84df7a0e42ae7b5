"""Plans of photos: what they promise holds, and robots and turntables get the poses that were planned."""

import json
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import calib
from calib.cameras import project
from calib.core.se3 import angles_between, exp_rotation, invert, make_pose, transform
from calib.judge.hand_eye_file import HAND_EYE, HandEye
from calib.judge.planned_views import TriedPlan, calibration_before, held_by_hand
from calib.judge.views import shape_of
from calib.observe.observations import known_points
from calib.observe.robot_poses import read_robot_poses
from designer.base.errors import InputError
from designer.builds.design import Design
from designer.kinds.sizing import size_job
from designer.page.blocks import Gallery, Headline
from tests.support.designs import SMALL, asked_for, small
from tests.support.solver_scenes import CAMERAS

CAMERA = CAMERAS["opencv"]
BOARD = small("board").target
NEAR_MM = (80.0, 250.0)
GOAL_PX = 0.5


def _placed(x: float, y: float, z: float, *turn: float) -> np.ndarray[tuple[int, ...], np.dtype[np.float64]]:
    return make_pose(exp_rotation(np.array(turn)), np.array([x, y, z]))


CAM = _placed(30, -20, 60, 0.1, -0.2, 1.0)
AWAY = _placed(400, 100, 50, 0.3, 0.1, -0.4)


def _hand(carried: str, frame: str, frame_from_cam: object = CAM, carrier_from_target: object = AWAY) -> HandEye:
    return HandEye(
        carried, frame, np.asarray(frame_from_cam), np.array([0.0, 0.0, 0.0, 1.0]), None,
        np.asarray(carrier_from_target), 1e-4, 0.05, 1.0, 0.0,
    )  # fmt: skip


@pytest.fixture(scope="module")
def planned() -> calib.PhotoPlan:
    """Of a small board that is as drawn, held by a person."""
    return calib.plan(BOARD, CAMERA, made="exact", distance_mm=NEAR_MM, within_px=GOAL_PX)


def headline_of(found: calib.PhotoPlan) -> Headline:
    """The answer, on its page."""
    headline = found.page().headline
    assert headline is not None
    return headline


def test_the_promise_is_what_the_tries_came_to(planned: calib.PhotoPlan) -> None:
    """Reached is what every try reached; the headline quotes the worst of them."""
    record = planned
    assert record.is_reached
    assert record.worst_px == max(one.stated_px for one in record.tried) <= GOAL_PX
    assert len(record.tried) > 2
    assert len({one.stated_px for one in record.tried}) == len(record.tried)
    assert headline_of(record).word == f"{len(record.photos)} photos"
    assert NEAR_MM[0] * 0.99 <= record.distance_mm.min() <= record.distance_mm.max() <= NEAR_MM[1] * 1.01


def test_a_harder_goal_takes_more_photos(planned: calib.PhotoPlan) -> None:
    """Photos are added for a goal."""
    goal_px = planned.worst_px / 1.3
    harder = calib.plan(BOARD, CAMERA, made="exact", distance_mm=NEAR_MM, within_px=goal_px)
    assert harder.is_reached
    assert len(harder.photos) > len(planned.photos)


def test_what_is_in_the_way_is_said(planned: calib.PhotoPlan) -> None:
    """The target's making is in the promise, and named where it is most of it; else photos that were not enough."""
    made = calib.plan(BOARD, CAMERA, made="hand-stickers", distance_mm=NEAR_MM, within_px=0.02, most=6)
    assert not made.is_reached
    assert min(one.by_target_px for one in made.tried) > 0
    assert {one.by_target_px for one in planned.tried} == {0.0}
    short = replace(planned, goal_px=0.02, settings={"target": "board.target.json"})
    assert not short.is_reached
    assert "--most" in headline_of(short).sentence
    badly = replace(short, tried=(TriedPlan(0.1, 0.01, 0.0995),) * 2)
    assert "made better" in headline_of(badly).sentence
    for record, commands in ((short, ["run"]), (planned, ["run"]), (badly, ["detect", "measure", "run"])):
        steps = [step.line for step in record.page().next_steps]
        assert [step.split()[1] for step in steps] == commands
    assert steps[-1].startswith("calib run measured/board.target.json ")


def test_the_files_and_the_page_are_the_plan(planned: calib.PhotoPlan, tmp_path: Path) -> None:
    """The page shows each photo as it is told; poses of a person are the camera's own, and no robot's."""
    planned.save(tmp_path)
    record = json.loads((tmp_path / "plan.json").read_text())
    assert np.array_equal(record["photos"][0]["cam_from_target"], planned.photos[0].cam_from_target)
    assert (record["worst_px"], record["is_reached"]) == (planned.worst_px, True)
    page = planned.page()
    (gallery,) = [block for section in page.sections for block in section.blocks if isinstance(block, Gallery)]
    assert len(gallery.pictures) == len(planned.photos)
    assert all(
        planned.photos[k].sentence.lower().startswith(one.caption.lower()) for k, one in enumerate(gallery.pictures)
    )
    lines = (tmp_path / "plan.csv").read_text().splitlines()[3:]
    place = np.array([[float(cell) for cell in line.split(",")[1:4]] for line in lines])
    assert np.allclose(place, [one.cam_from_target[:3, 3] for one in planned.photos], atol=1e-6)
    with pytest.raises(InputError, match="no rotation"):  # it is no robot's
        read_robot_poses(tmp_path / "plan.csv")


def test_a_first_photo_need_not_determine_the_camera(planned: calib.PhotoPlan) -> None:
    """One photo of a board squarely leaves the focal length open: null in the file, and a word in the table."""
    first = replace(planned.photos[0], sigma_px_after=math.inf)
    odd = replace(planned, photos=(first, *planned.photos[1:]))
    assert json.loads(json.dumps(odd.document(), allow_nan=False))["photos"][0]["sigma_px_after"] is None
    assert "not determined" in str(odd.page().sections[-1])


@pytest.mark.parametrize("frame", ["flange", "base"])
def test_a_robot_shows_what_was_planned(frame: str, tmp_path: Path) -> None:
    """The flange's poses in plan.csv, taken through the robot's own chain, show the target where the plan has it."""
    hand = _hand("robot, camera in hand" if frame == "flange" else "robot, target in hand", frame)
    (tmp_path / "hand_eye.json").write_bytes(HAND_EYE.text(hand))
    found = calib.plan(BOARD, CAMERA, made="exact", distance_mm=NEAR_MM, within_px=GOAL_PX, hand_eye=tmp_path)
    found.save(tmp_path / "out")
    flange = read_robot_poses(tmp_path / "out" / "plan.csv").base_from_flange
    if frame == "flange":  # cam <- flange <- base <- target
        seen = invert(hand.frame_from_cam) @ invert(flange) @ hand.carrier_from_target
    else:  # cam <- base <- flange <- target
        seen = invert(hand.frame_from_cam) @ flange @ hand.carrier_from_target
    planned = np.stack([one.cam_from_target for one in found.photos])
    assert angles_between(seen[:, :3, :3], planned[:, :3, :3]).max() < 1e-7
    assert np.allclose(seen[:, :3, 3], planned[:, :3, 3], atol=1e-5)
    with pytest.raises(InputError, match="nothing turns"):
        hand.cam_from_target_on_table(np.zeros(1))


def test_a_turntable_gets_angles() -> None:
    """A table shows the target only as it can turn it, and says so in degrees."""
    target = small("ico").target
    cam_from_table = make_pose(np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]]), np.array([5.0, 4.0, 58.0]))
    hand = _hand("turntable", "table", invert(cam_from_table), np.eye(4))
    found = calib.plan(target, CAMERA, made="exact", within_px=1.0, hand_eye=hand)
    assert found.is_reached
    assert found.table_deg is not None
    seen = hand.cam_from_target_on_table(np.radians(found.table_deg))
    assert np.allclose(seen, [one.cam_from_target for one in found.photos])
    assert f"turn the table to {found.table_deg[0]:g} deg" in found.photos[0].sentence
    assert len(set(found.table_deg.tolist())) == len(found.photos)
    with pytest.raises(InputError, match="leave it out"):
        calib.plan(target, CAMERA, hand_eye=hand, distance_mm=NEAR_MM)
    far = replace(hand, frame_from_cam=hand.frame_from_cam @ _placed(0, 0, -5000, 0, 0, 0))
    with pytest.raises(InputError, match="not read at any angle"):
        calib.plan(target, CAMERA, hand_eye=far)


@pytest.mark.parametrize(
    ("wish", "said"),
    [({"distance_mm": (300.0, 100.0)}, "smaller comes first"), ({"distance_mm": (5000.0, 9000.0)}, "no photo from")],
)
def test_wishes_that_cannot_be(wish: dict[str, object], said: str) -> None:
    """One line with the value and the rule."""
    with pytest.raises(InputError, match=said) as told:
        calib.plan(BOARD, CAMERA, **wish)  # type: ignore[arg-type]
    assert "\n" not in str(told.value)


def test_a_solid_is_tried_with_any_side_to_the_camera() -> None:
    """What is said is what is tried: each try shows other sides, and no two photos are told alike."""
    target = small("ico").target
    record = calib.plan(target, CAMERA, made="exact", within_px=0.6)
    sentences = [photo.sentence.partition(":")[0] for photo in record.photos]
    assert all("side to the camera" in one for one in sentences)
    poses = np.stack([one.cam_from_target for one in record.photos])
    before = calibration_before(CAMERA, known_points(target), 0.05)
    shape = shape_of(before)
    assert shape is not None
    held = [held_by_hand(poses, shape, np.random.default_rng(seed)) for seed in range(2)]
    turned = angles_between(held[0][:, :3, :3], held[1][:, :3, :3])
    assert np.median(turned) > 1.0
    away = np.linalg.norm(transform(held[0], shape.center_mm) - transform(poses, shape.center_mm), axis=1)
    assert (away <= 4 * 0.1 * record.distance_mm).all()


def test_of_a_board_with_two_sides_the_front_is_planned() -> None:
    """As of a board with one: it is held level and tilted, and its back is seen in no photo."""
    target = Design(size_job(asked_for("board", {**SMALL["board"], "two_sided": True})).job).target
    record = calib.plan(target, CAMERA, made="exact", distance_mm=NEAR_MM, within_px=GOAL_PX)
    assert np.isfinite(record.tilt_deg).all()
    normal = np.stack([one.cam_from_target[:3, :3] @ target.target_from_face[0, :3, 2] for one in record.photos])
    place = np.stack([one.cam_from_target[:3, 3] for one in record.photos])
    assert ((normal * place).sum(axis=1) < 0).all()
    assert any("front" in one for one in record.remarks)


def test_an_image_circle_is_filled_and_not_the_image() -> None:
    """A lens that lights a small part of the image is planned for by that part."""
    narrow = replace(CAMERA, field_rad=0.35)
    record = calib.plan(BOARD, narrow, made="exact", within_px=2.0, most=8)
    assert record.distance_mm.min() > 1.5 * NEAR_MM[0]


def test_planned_photos_show_the_target(planned: calib.PhotoPlan) -> None:
    """Most of the board's rings are inside of each image."""
    width, height = CAMERA.image_size
    for one in planned.photos:
        pixel = project(CAMERA, transform(one.cam_from_target, BOARD.center_mm))
        inside = ((pixel > 0) & (pixel < [width - 1, height - 1])).all(axis=1)
        assert inside.mean() > 0.5
