"""What is expected of a print, what little data may change, and what another lens did to its centres."""

from dataclasses import replace
from typing import get_args

import cv2
import numpy as np
import pytest

from calib.cameras.camera import Camera
from calib.core.se3 import transform
from calib.core.types import Observations, keep_sightings
from calib.draw.measured_picture import face_label
from calib.measure_target.cross_validation import CrossValidation, Gain, cross_validate
from calib.measure_target.datum import few_views
from calib.measure_target.deviations import Verdict, face_verdicts
from calib.measure_target.earlier_lens import is_another_lens, seen_through, with_shared_error
from calib.measure_target.expected import with_expected_deviations
from calib.measure_target.result import AsBuilt, face_shift_mm
from calib.measure_target.solve import measure
from calib.measure_target.unknowns import KINDS, AsBuiltOptions, Unknowns, unknowns_of
from designer.target import TargetGeometry
from designer.tolerance.error_file import error_model
from designer.tolerance.model import ErrorModel, perturb
from designer.tolerance.source import Amount
from tests.support.as_built_scenes import RIGID, frame_errors, mahalanobis, photos, plate, printed, random_shape, solid
from tests.support.perturbed_targets import made_with
from tests.support.solver_scenes import CAMERAS

FEW = (2, 9)


def found_sigma(found: Unknowns, kind: str) -> float:
    """Of the unknowns of one kind; of a strain its tensor's length, which no axes matter to."""
    sigma = {name: found.sigma[found.kind == number] for number, name in enumerate(KINDS)}
    if kind == "strain":
        return float(np.sqrt((sigma["stretch"] ** 2).sum() + 2 * (sigma["shear"] ** 2).sum()))
    assert np.ptp(sigma[kind]) < 0.4 * sigma[kind].mean()
    return float(sigma[kind].mean())


@pytest.mark.parametrize(
    ("target", "source", "amount", "kind", "expected"),
    [
        (solid(), "axis_scale", 1e-3, "strain", 1e-3 * np.sqrt(2)),  # of three axes, the mean taken off: the size
        (solid(), "skew", 2e-3, "strain", 2e-3 * np.sqrt(1.5)),  # the other half is a rotation
        (solid(), "face_tilt", 2e-3, "tilt", 2e-3),
        (solid(), "face_rotation", 1e-3, "turn", 1e-3),
        (solid(), "face_shift", 0.1, "shift", 0.1),
        (solid(), "face_offset", 0.1, "lift", 0.1),
    ],
)
def test_the_way_of_making_is_what_is_expected(
    target: TargetGeometry, source: str, amount: float, kind: str, expected: float
) -> None:
    """Each error source becomes the unknown that does the same, about as large; a person's number stays."""
    errors = ErrorModel("one", "", ((source, Amount("normal", amount)),))
    made = made_with(errors, target)
    found = with_expected_deviations(unknowns_of(target, AsBuiltOptions()), AsBuiltOptions(made=made))
    # Of a face that moves alone a twentieth is a motion and a strain of the whole.
    assert found_sigma(found, kind) == pytest.approx(expected, rel=0.2)
    chosen = AsBuiltOptions(made=made, strain_sigma=0.02, face_sigma_rad=0.03, face_sigma_mm=4.0, bow_sigma_mm=5.0)
    given = unknowns_of(target, chosen)
    assert np.array_equal(with_expected_deviations(given, chosen).sigma, given.sigma)


def seldom_seen(seen: Observations) -> Observations:
    """Some faces are seen in one or two photos only."""
    face = solid().ring_face[seen.point]
    keep = np.ones(len(face), dtype=bool)
    for number, few in enumerate(FEW, 1):
        keep &= (face != few) | np.isin(seen.view, np.unique(seen.view[face == few])[:number])
    return keep_sightings(seen, keep)


def print_with_faces_seen_seldom() -> tuple[TargetGeometry, AsBuilt]:
    """A print, and what is measured of it."""
    rng = np.random.default_rng(1)
    errors = error_model("fdm-dual").only(
        "axis_scale", "skew", "face_offset", "face_shift", "face_rotation", "face_tilt"
    )
    print_ = perturb(solid(), errors, rng)
    return print_, measure([seldom_seen(photos(print_, rng, 20, noise_px=0.02))], solid(), "opencv", RIGID)


def test_faces_seen_seldom_are_named_held_and_not_judged() -> None:
    """The table names them, they stay near the design, and photos held out are as well explained as without them."""
    print_, found = print_with_faces_seen_seldom()
    verdicts = face_verdicts(found)
    assert {verdicts[few] for few in FEW} <= {"few photos", "not known"}
    assert found.target.face_covariance is not None
    shift = np.linalg.norm(found.target.target_from_face[:, :3, 3] - print_.target_from_face[:, :3, 3], axis=1)
    assert shift[list(FEW)].max() < 0.3  # mm; three times the error of making
    held = cross_validate(found, "opencv", RIGID, 4)
    assert held.gains[0].metric == "reprojection"
    assert held.gains[0].measured < 3 * 0.02
    assert held.gains[0].is_better
    assert any("2" in remark and "9" in remark and "not judged" in remark for remark in held.remarks)


def test_what_no_image_shows_is_no_motion() -> None:
    """However sure it is, a shift by a small part of a centre's noise moved no face; by a whole of it, it did."""
    found = measure([photos(solid(), np.random.default_rng(2), 16)], solid(), "opencv", RIGID)
    sure = replace(found, motion_covariance=1e-12 * np.eye(len(found.motion_covariance)))
    for part, verdict in ((0.3, "as designed"), (1.0, "moved")):
        motion = np.zeros_like(found.motion)
        motion[:, 3] = part * found.centre_noise_mm
        assert face_shift_mm(solid(), motion[:, :, None] * motion[:, None]) == pytest.approx(motion[:, 3] / np.sqrt(3))
        verdicts = face_verdicts(replace(sure, motion=motion))
        assert {verdicts[face] for face in np.flatnonzero(~few_views(found.face_views))} == {verdict}


def test_one_photo_tells_nothing_of_chance() -> None:
    """However much less its error is, one held-out photo judges no target; no error with either is no gain."""
    one = Gain("reprojection", "px", 20, 1.0, 0.5, None)
    sure = replace(one, metric="intersection", least_factor=1.2)
    assert one.is_better is None
    assert CrossValidation(2, (one,), (), ()).judged_by is None
    assert CrossValidation(2, (one, sure), (), ()).judged_by == sure
    assert [replace(one, nominal=a, measured=b).is_better for a, b in ((1.0, 0.0), (0.0, 0.0), (0.0, 1.0))] == [
        True, False, False,
    ]  # fmt: skip


def test_photos_held_out_are_weighed_as_those_measured_from() -> None:
    """Of two cameras one knows its covariances: nothing is weighed by them, neither the print nor its judgement."""
    rng = np.random.default_rng(6)
    plain = [photos(solid(), rng, 4, noise_px=0.1) for _ in range(2)]
    uneven = rng.uniform(0.01, 1.0, len(plain[0].view))[:, None, None] * np.eye(2)
    found = [
        measure(sets, solid(), "pinhole", RIGID) for sets in ([replace(plain[0], cov_px2=uneven), plain[1]], plain)
    ]
    mixed, without = (cross_validate(one, "pinhole", RIGID, 2).gains[0] for one in found)
    assert mixed.nominal == pytest.approx(without.nominal, rel=1e-6)
    assert mixed.measured == pytest.approx(without.measured, rel=1e-6)


@pytest.mark.parametrize("verdict", get_args(Verdict))
def test_a_face_in_the_picture_has_its_own_verdict(verdict: Verdict) -> None:
    """What is not judged is not drawn as designed."""
    assert face_label(3, verdict).splitlines() == ["3", *([] if verdict == "moved" else [verdict])]


def test_a_perfect_print_is_no_better_measured() -> None:
    """Where the drawing is right, nothing is gained on photos held out, and it is not said to be."""
    seen = photos(solid(), np.random.default_rng(3), 8)
    found = measure([seen], solid(), "opencv", RIGID)
    held = cross_validate(found, "opencv", RIGID, 4)
    assert not held.judged_by.is_better


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
