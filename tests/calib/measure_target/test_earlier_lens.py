"""What a lens that is not the measured one did to centres is known, and is in what is told."""

from dataclasses import replace

import cv2
import numpy as np
import pytest

from calib.cameras.camera import Camera
from calib.core.se3 import transform
from calib.measure_target.earlier_lens import is_another_lens, seen_through, with_shared_error
from calib.measure_target.result import AsBuilt
from calib.measure_target.solve import measure
from tests.support.as_built_scenes import RIGID, frame_errors, mahalanobis, photos, plate, printed, random_shape, solid
from tests.support.solver_scenes import CAMERAS

MANY = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT, 100, 1e-13)


@pytest.fixture(scope="module")
def found() -> AsBuilt:
    """A print, measured."""
    rng = np.random.default_rng(4)
    return measure([photos(printed(solid(), random_shape(solid(), rng)), rng)], solid(), "opencv")


def test_the_measured_lens_moves_no_centre(found: AsBuilt) -> None:
    """Nor does the shape, where the target is as designed."""
    as_designed = replace(found, nominal=replace(found.target, source="nominal"))
    (seen,) = seen_through(as_designed, found.cameras)
    assert np.abs(seen.center_px - found.observations[0].center_px).max() < 1e-5
    assert not is_another_lens(found, found.cameras)


def test_another_lens_moves_centres_as_ovals_through_it_lie() -> None:
    """Of a board square to the camera: middles of ellipses fitted by OpenCV to circles that its lens straightened."""
    board, camera = plate(), CAMERAS["opencv"]
    other = Camera("opencv", camera.params * np.where(np.arange(len(camera.params)) == 4, 3.0, 1.0), camera.image_size)
    pose = np.array([[1.0, 0, 0, 0], [0, -1, 0, 0], [0, 0, -1, 400], [0, 0, 0, 1]])
    shown = measure([photos(board, np.random.default_rng(3), 8, half_angle_deg=40)], board, "opencv", RIGID)
    seen = replace(
        shown.observations[0], point=np.arange(board.ring_count), view=np.zeros(board.ring_count, dtype=np.int64),
        center_px=np.zeros((board.ring_count, 2)),
    )  # fmt: skip
    print_ = replace(board, source="measured")
    (moved,) = seen_through(
        replace(shown, target=print_, observations=(seen,), cameras=(camera,), poses=(pose[None],)), [other]
    )
    matrices, lenses = [], []
    for one in (camera, other):
        fx, fy, cx, cy, *lens = one.params
        matrices.append(np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1]]))
        lenses.append(np.array(lens))
    radius = np.sqrt((board.radius_outer_mm**2 + board.radius_inner_mm**2) / 2)
    angle = np.linspace(0, 2 * np.pi, 72, endpoint=False)
    around = np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=1)
    for ring in range(0, board.ring_count, 7):
        place = transform(pose, board.center_mm[ring] + radius[ring] * around)
        nowhere = np.zeros(3)
        circle = cv2.projectPoints(place, nowhere, nowhere, matrices[0], lenses[0])[0]
        straight = cv2.undistortPoints(circle, matrices[1], lenses[1], criteria=MANY)
        (u, v), _, _ = cv2.fitEllipseDirect((1000 * straight).astype(np.float32))
        back = cv2.projectPoints(np.array([[u / 1000, v / 1000, 1]]), nowhere, nowhere, matrices[1], lenses[1])[0]
        true = cv2.projectPoints(transform(pose, board.center_mm[[ring]]), nowhere, nowhere, matrices[0], lenses[0])[0]
        assert moved.center_px[ring] == pytest.approx((back - true).ravel(), abs=2e-4), ring


def test_what_another_lens_gives_is_within_what_is_told(found: AsBuilt) -> None:
    """Camera, faces and whole print lie within one deviation, however far off they are; what else is known stays."""
    rng = np.random.default_rng(9)
    camera = found.cameras[0]
    off = Camera(camera.model, camera.params + 20 * np.sqrt(np.diagonal(found.param_covariance[0])), camera.image_size)
    turned = np.array(found.target.target_from_face)
    turned[:, :3, 3] += rng.normal(0, 0.5, (len(turned), 3))
    moved = replace(
        found, cameras=(off,), motion=found.motion + rng.normal(0, 0.1, found.motion.shape),
        target=replace(found.target, target_from_face=turned),
    )  # fmt: skip
    told = with_shared_error(found, moved)
    assert is_another_lens(found, [off])
    assert not is_another_lens(told, [off])
    covariance = told.target.face_covariance
    assert covariance is not None
    assert (mahalanobis(frame_errors(moved.target, found.target), covariance) <= 1).all()
    assert np.array_equal(told.cameras[0].params, camera.params)
    assert np.array_equal(told.bow_covariance, found.bow_covariance)
    assert (told.offset_sigma_mm >= found.offset_sigma_mm).all()
