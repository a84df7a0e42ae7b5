"""The whole detector on rendered views: bad input, recall, accuracy, and the same answer twice."""

import math
import re
from dataclasses import replace

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from calib.cameras.camera import camera_or_preset
from calib.core.types import Detections
from calib.detector.pipeline import INVERTED, MIRRORED, detect, find
from calib.renderer import RenderOptions, View, render_view
from designer.base.arrays import Array
from designer.target import TargetGeometry
from tests.support.ring_views import CAMERA, USUAL, board, ellipse_of, ico, misplaced, scene_of, view_of
from tests.support.sightings import view_from


def chi_square(found: Detections, view: View) -> Array:
    """Squared errors in units of the reported covariance; 2 on average.  # (N,)"""
    error = found.center_px - view.center_px[found.ring]
    return np.asarray(np.einsum("ni,nij,nj->n", error, np.linalg.inv(found.cov_px2), error))


def rmse(found: Detections, view: View, steepest_rad: float = 1.2) -> float:
    """Root-mean-square error per axis of the rings that are not seen too flat."""
    mine = view.incidence_rad[found.ring] < steepest_rad
    return float(np.sqrt(((found.center_px - view.center_px[found.ring])[mine] ** 2).mean()))


def same(a: Detections, b: Detections) -> bool:
    """Whether two detections are equal to the last bit."""
    arrays = all(
        np.array_equal(getattr(a, name), getattr(b, name))
        for name in ("ring", "center_px", "cov_px2", "ellipse_px", "rejected_px")
    )
    return arrays and a.faces == b.faces and a.remarks == b.remarks


@pytest.mark.parametrize("pixels", [np.zeros((50, 60, 3), np.uint8), np.zeros(50, np.uint8), np.uint8(3)])
def test_only_grey_images_are_taken(pixels: NDArray[np.uint8]) -> None:
    """Colour images and rows of pixels are refused with one line that says what is wanted."""
    with pytest.raises(ValueError, match="height x width") as caught:
        detect(np.asarray(pixels), board(), name="x")
    assert "\n" not in str(caught.value)


def test_camera_of_other_images_is_refused() -> None:
    """A camera belongs to images of its size; both sizes are named."""
    with pytest.raises(ValueError, match="1024 x 768") as caught:
        detect(np.zeros((800, 1000), np.uint8), board(), name="x", camera=camera_or_preset("wide-webcam"))
    assert "1000" in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("target", [board(), ico(), board(dots=False)], ids=["board", "ico", "plain"])
@pytest.mark.parametrize("shape", [(1, 1), (1, 4000), (16, 16), (200, 300)])
@pytest.mark.parametrize("kind", [np.uint8, np.uint16, np.float32])
def test_empty_images_give_no_rows_but_a_reason(
    target: TargetGeometry, shape: tuple[int, int], kind: type[np.generic]
) -> None:
    """Black, white and tiny images hold nothing, and the remark is one line."""
    for level in (0, 255):
        found = detect(np.full(shape, level, dtype=kind), target, name="empty.png")
        assert len(found.ring) == len(found.center_px) == len(found.cov_px2) == len(found.ellipse_px) == 0
        assert found.image == "empty.png"
        assert found.image_size == (shape[1], shape[0])
        assert (found.layout_id, found.geometry_id) == (target.layout_id, target.geometry_id)
        assert len(found.remarks) == 1
        assert "\n" not in found.remarks[0]


def noisy_images() -> dict[str, NDArray[np.generic]]:
    """Images of noise of all kinds."""
    rng = np.random.default_rng(1)
    salt = np.where(rng.random((500, 600)) < 0.1, 255, 0)
    return {
        "gauss": rng.normal(128, 30, (500, 600)).clip(0, 255).astype(np.uint8),
        "bits": (255 * rng.integers(0, 2, (500, 600))).astype(np.uint8),
        "salt": salt.astype(np.uint8),
        "sixteen": rng.integers(0, 65536, (500, 600)).astype(np.uint16),
        "floats": rng.normal(0, 1e-3, (500, 600)).astype(np.float32),
        "checkers": (255 * (np.add.outer(np.arange(250), np.arange(300)) % 2)).astype(np.uint8),
        "stripes": np.tile((255 * (np.arange(600) // 5 % 2)).astype(np.uint8), (500, 1)),
    }


@pytest.mark.parametrize("kind", noisy_images())
@pytest.mark.parametrize("target", [board(), ico()], ids=["board", "ico"])
def test_noise_holds_no_target(kind: str, target: TargetGeometry) -> None:
    """Noise, checkers and stripes give no rows, and a remark."""
    found = detect(noisy_images()[kind], target, name="noise")
    assert len(found.ring) == 0
    assert found.remarks


def test_sheet_of_blobs_is_no_target() -> None:
    """Hundreds of lone rings without order are rejected, not named."""
    rng = np.random.default_rng(2)
    image = np.full((700, 900), 200, dtype=np.uint8)
    v, u = np.mgrid[:700, :900]
    for _ in range(120):
        at, radius = rng.uniform((20, 20), (880, 680)), rng.uniform(6, 12)
        distance = np.hypot(u - at[0], v - at[1])
        image[(distance < radius) & (distance > 0.45 * radius)] = 30
    for target in (board(), ico()):
        assert len(detect(image, target, name="blobs").ring) == 0


@pytest.mark.parametrize("target", [board(), board("triangular"), ico()], ids=["square", "triangular", "ico"])
def test_clean_views_are_found_whole_exact_and_with_true_covariances(target: TargetGeometry) -> None:
    """All rings that show well, errors below 0.02 px, and chi-square per degree of freedom near 1, over four views."""
    chi = []
    for seed in range(4):
        view = view_of(target, 10 + seed, distance_mm=330 if target.face_count == 1 else 400)
        found = detect(view.image, target, name="view")
        assert (misplaced(found, view) < 1).all()
        due = view.clean & (view.incidence_rad < 1.1) & (view.minor_radius_px > 5)
        assert np.isin(np.flatnonzero(due), found.ring).all()
        assert rmse(found, view, steepest_rad=1.0) < 0.02
        mine = view.incidence_rad[found.ring] < 1.2
        chi.append(chi_square(found, view)[mine])
    assert 0.7 < np.concatenate(chi).mean() / 2 < 1.4
    assert np.mean(np.concatenate(chi) > 25) < 0.01


def test_result_is_ordered_and_whole() -> None:
    """Rows ascend without repeats, covariances are positive, ellipses lie around their centres, records add up."""
    view = view_of(ico(), 20)
    found = detect(view.image, ico(), name="photo.png")
    assert (np.diff(found.ring) > 0).all()
    assert (np.linalg.eigvalsh(found.cov_px2) > 0).all()
    assert found.cov_px2.transpose(0, 2, 1) == pytest.approx(found.cov_px2, rel=1e-9)
    assert not found.center_px.flags.writeable
    for record in found.faces:
        assert record.face is not None
        mine = found.ring[ico().ring_face[found.ring] == record.face]
        assert record.rings_found == len(mine)
        assert record.rings_expected == 21
        assert sum(count for _, count in record.missing) == 21 - len(mine)
        if record.code_read and "unreadable" not in record.code_read:
            assert record.code_read.count("dot") == 3
    assert sum(record.rings_found for record in found.faces) == len(found.ring)


def test_ellipses_are_the_rims() -> None:
    """Reported ellipses are the outer contours: major before minor, and the angle is the major axis's."""
    scene = scene_of(board(), 21, distance_mm=330)
    rng = np.random.default_rng(21)
    view = render_view(board(), CAMERA, scene.cam_from_target, USUAL, rng)
    found = detect(view.image, board(), name="view")
    assert len(found.ring) > 90
    ellipse = found.ellipse_px
    assert (ellipse[:, 2] >= ellipse[:, 3]).all()
    for row, (u, v, large, small, angle) in zip(found.ring, ellipse, strict=True):
        true = ellipse_of(scene.truth.rim_px[row])
        shape = np.array([[true[2], 0.0], [true[3], true[4]]])
        along = np.array([math.cos(angle), math.sin(angle)])
        across = np.array([-along[1], along[0]])
        assert np.linalg.norm(shape @ along) * large == pytest.approx(1, abs=0.03)
        assert np.linalg.norm(shape @ across) * small == pytest.approx(1, abs=0.03)
        assert (u, v) == pytest.approx(true[:2], abs=0.5)


def test_known_camera_is_no_worse_than_an_estimated_lens() -> None:
    """With a wide webcam's lens known, centres are at least as good as with a lens from the grids.

    What a search without it has found serves the search with it: the same to the last bit.
    """
    camera = camera_or_preset("wide-webcam")
    known: list[Array] = []
    estimated: list[Array] = []
    for seed in range(3):
        view = view_of(board(), 30 + seed, distance_mm=190, camera=camera)
        with_camera = detect(view.image, board(), name="view", camera=camera)
        found = find(view.image, board())
        without = detect(view.image, board(), name="view", found=found)
        assert same(detect(view.image, board(), name="view", camera=camera, found=found), with_camera)
        assert (misplaced(with_camera, view) < 1).all()
        assert (misplaced(without, view) < 1).all()
        both = np.intersect1d(with_camera.ring, without.ring)
        assert len(both) > 0.95 * view.clean.sum()
        for seen, errors in ((with_camera, known), (without, estimated)):
            mine = np.isin(seen.ring, both)
            errors.append((seen.center_px - view.center_px[seen.ring])[mine].ravel())
        assert 0.6 < chi_square(with_camera, view).mean() / 2 < 1.5
    rms_known, rms_estimated = (np.sqrt((np.concatenate(errors) ** 2).mean()) for errors in (known, estimated))
    assert rms_known < 0.03
    assert rms_known < 1.05 * rms_estimated


def test_known_camera_straightens_what_few_rings_cannot() -> None:
    """Fifteen rings show no lens: with the camera known, their centres are several times better, and known to be."""
    camera, target = camera_or_preset("wide-webcam"), board(columns=5, rows=3)
    square: dict[bool, list[Array]] = {True: [], False: []}
    chi = []
    for seed, eye in enumerate([(40.0, 30.0, 110.0), (60.0, -20.0, 120.0), (-50.0, 40.0, 110.0)]):
        pose = view_from(eye, (0.7 * eye[0], 0.7 * eye[1], 0.0))
        view = render_view(target, camera, pose, USUAL, np.random.default_rng(seed))
        for is_known in (True, False):
            found = detect(view.image, target, name="view", camera=camera if is_known else None)
            assert len(found.ring) == 15
            square[is_known].append(((found.center_px - view.center_px[found.ring]) ** 2).ravel())
            if is_known:
                chi.append(chi_square(found, view))
    known, unknown = (math.sqrt(np.concatenate(square[way]).mean()) for way in (True, False))
    assert known < 0.007
    assert known < 0.4 * unknown
    assert 0.6 < np.concatenate(chi).mean() / 2 < 1.5


@pytest.mark.parametrize("target", [board(), ico()], ids=["board", "ico"])
def test_floats_see_what_bytes_see(target: TargetGeometry) -> None:
    """The same levels as floats give the same names and the same centres."""
    view = view_of(target, 40)
    base, other = (detect(pixels, target, name="x") for pixels in (view.image, view.image.astype(np.float32)))
    _, a, b = np.intersect1d(base.ring, other.ring, return_indices=True)
    assert len(a) > 0.98 * len(base.ring)
    apart = np.abs(base.center_px[a] - other.center_px[b])
    assert np.median(apart) < 1e-3
    assert apart.max() < 0.05


def test_dim_and_deep_images_are_found() -> None:
    """A 16-bit image that uses the lowest hundredth of its range is as good as a bright one."""
    view = view_of(board(), 41, options=replace(USUAL, bits=16))
    dim = (view.image // 60).astype(np.uint16)
    found = detect(dim, board(), name="dim")
    assert len(found.ring) >= view.clean.sum() - 1
    assert rmse(found, view) < 0.03


@pytest.mark.parametrize("target", [board(), ico()], ids=["board", "ico"])
def test_two_runs_agree_to_the_last_bit(target: TargetGeometry) -> None:
    """Nothing random, and no order of threads, is left in the result; the image is not written to."""
    view = view_of(target, 50, options=replace(USUAL, clutter=20))
    pixels = view.image.copy()
    pixels.setflags(write=False)
    first = detect(pixels, target, name="view")
    assert len(first.ring) > 30
    assert same(first, detect(pixels, target, name="view"))
    assert same(first, detect(np.asfortranarray(pixels), target, name="view"))


def test_moving_the_image_moves_the_centres() -> None:
    """Whole pixels of background added at two sides shift the centres by that, and nothing else."""
    view = view_of(board(), 60)
    base = detect(view.image, board(), name="view")
    moved = detect(np.pad(view.image, ((11, 5), (24, 8)), mode="edge"), board(), name="view")
    _, a, b = np.intersect1d(base.ring, moved.ring, return_indices=True)
    assert len(a) > 0.98 * len(base.ring)
    assert moved.center_px[b] - (24, 11) == pytest.approx(base.center_px[a], abs=5e-3)


def test_uneven_light_costs_no_ring() -> None:
    """Where the light falls off to a third across the board, all rings are still found, and exact."""
    view = view_of(board(), 70, options=replace(USUAL, light_gradient=1.0, vignetting=0.3))
    found = detect(view.image, board(), name="view")
    assert len(found.ring) >= view.clean.sum() - 1
    assert rmse(found, view) < 0.03
    assert (misplaced(found, view) < 1).all()


def test_large_image_is_searched_small_and_measured_full() -> None:
    """An image of more than eight million pixels loses no accuracy by the reduced search."""
    camera = replace(CAMERA, params=np.append(3.4 * CAMERA.params[:4], np.zeros(5)), image_size=(3400, 2720))
    view = view_of(
        board(), 80, camera=camera, distance_mm=330, options=RenderOptions(blur_px=0.8, contrast_to_noise=50)
    )
    found = detect(view.image, board(), name="view")
    assert len(found.ring) >= view.clean.sum() - 1
    assert rmse(found, view) < 0.01
    assert 0.6 < chi_square(found, view).mean() / 2 < 1.5


LOSSLESS = RenderOptions(blur_px=0.8, contrast_to_noise=40, glare=0.6, clutter=20)


def turned_back(center_px: Array, size: tuple[int, int]) -> Array:
    """Places in the image of a size (width, height) of those in the same image turned a quarter to the left."""
    return np.stack([size[0] - 1 - center_px[:, 1], center_px[:, 0]], axis=1)


@pytest.mark.parametrize("target", [board(), ico()], ids=["board", "ico"])
def test_turning_the_image_by_right_angles_turns_the_centres(target: TargetGeometry) -> None:
    """The same rings are found, well within a thousandth of a pixel and a twentieth of their standard deviation."""
    image = np.asarray(view_of(target, 3, options=LOSSLESS, distance_mm=350).image)
    plain = detect(image, target, name="x")
    assert len(plain.ring) > 90
    sigma = np.sqrt(np.linalg.eigvalsh(plain.cov_px2)[:, 1])
    sizes = [image.shape[::-1]]
    for quarters in (1, 2, 3):
        turned = np.ascontiguousarray(np.rot90(image, quarters))
        found = detect(turned, target, name="x")
        center = found.center_px
        for size in reversed(sizes):
            center = turned_back(center, (size[0], size[1]))
        sizes.append(turned.shape[::-1])
        assert np.array_equal(found.ring, plain.ring)
        apart = np.linalg.norm(center - plain.center_px, axis=1)
        assert (apart < 1e-6 + 0.05 * sigma).all()
        assert np.median(apart) < 1e-6
        assert (apart[sigma < 0.03] < 1e-3).all()


@pytest.mark.parametrize("step", [256, 257])
def test_sixteen_bits_of_an_eight_bit_photo_are_that_photo(step: int) -> None:
    """A copy in 16 bits, bytes moved up or written twice, gives the same to the last bit."""
    image = np.asarray(view_of(ico(), 3, options=LOSSLESS).image)
    copy = image.astype(np.uint16) * np.uint16(step)
    assert same(detect(image, ico(), name="x"), detect(copy, ico(), name="x"))


def test_rings_beyond_the_edge_are_not_said_to_be_hidden() -> None:
    """Of a board that a clean image cuts, rings outside and rings that its edge cuts are told apart, none expected."""
    target = board()
    view = view_of(target, 2)
    right = view.center_px[:, 0]
    column = int(right[right > right[target.is_dot].max() + 40].min()) + 5
    found = detect(np.ascontiguousarray(view.image[:, :column]), target, name="x")
    missing = dict(found.faces[0].missing)
    assert missing["outside the image"] > 5
    assert missing["cut by the image's edge"] > 0
    assert set(missing) <= {"outside the image", "cut by the image's edge"}
    assert found.faces[0].measurable == len(found.ring)


HARD_LIGHT = replace(USUAL, shading=0.95, contrast_to_noise=120, white=0.9, black=0.05, background=0.1)


@pytest.mark.parametrize("seed", [3, 5])
def test_faces_in_shadow_are_measured(seed: int) -> None:
    """On faces with a twentieth of the others' light, rings well above their noise are found, placed and weighed."""
    view = view_of(ico(), seed, options=HARD_LIGHT)
    found = detect(view.image, ico(), name="x")
    assert not np.setdiff1d(np.flatnonzero(view.clean & (view.incidence_rad < 1.1)), found.ring).size
    assert np.nanmax(misplaced(found, view)) < 0.3
    assert chi_square(found, view).mean() < 2.6
    assert not found.remarks


def test_a_face_without_light_is_told() -> None:
    """A face that shows nothing but its own dark is remarked, not passed over; what has light is found."""
    view = view_of(ico(), 3, options=replace(HARD_LIGHT, shading=1.0, contrast_to_noise=40, background=0.5))
    found = detect(view.image, ico(), name="x")
    assert len(found.ring) >= 21
    assert any("dark" in remark for remark in found.remarks)


def test_a_faint_ring_among_its_like_is_refused() -> None:
    """A ring with a fifth of its neighbours' contrast, under something that lets light through, is not measured."""
    view = view_of(board(), 1)
    row = int(np.argmin(np.linalg.norm(view.center_px - np.array([500, 400]), axis=1)))
    u, v = np.rint(view.center_px[row]).astype(int)
    patch = view.image[v - 14 : v + 15, u - 14 : u + 15]
    patch[:] = 150 + 0.2 * (patch.astype(float) - 150)
    assert row not in detect(view.image, board(), name="x").ring


@pytest.mark.parametrize("target", [board(), ico()], ids=["board", "ico"])
def test_inverted_images_are_found_and_told(target: TargetGeometry) -> None:
    """White on black is found like black on white, of bytes, words and floats, and said; mirrored, it is refused."""
    view = view_of(target, 2)
    found = detect(view.image, target, name="x")
    negative = 255 - view.image
    for image in (negative, negative.astype(np.uint16) * 17 + 3, (negative / 255).astype(np.float32)):
        other = detect(image, target, name="x")
        assert np.array_equal(other.ring, found.ring)
        assert np.abs(other.center_px - found.center_px).max() < 1e-3
        assert other.remarks == (INVERTED, *found.remarks)
        assert same(detect(image, target, name="x", found=find(image, target)), other)
    flipped = detect(np.ascontiguousarray(negative[:, ::-1]), target, name="x")
    assert not len(flipped.ring)
    assert flipped.remarks == (INVERTED, MIRRORED)


@pytest.mark.parametrize(("length_px", "is_told"), [(0, False), (1, False), (5, True)])
def test_motion_blur_is_told_with_its_length_and_direction(length_px: int, is_told: bool) -> None:
    """Edges smeared to one side are said to be so; the length is right to a pixel. What is out of focus is none."""
    view = view_of(ico(), 2, options=replace(USUAL, contrast_to_noise=100))
    # Down to the right by 45 degrees.
    weights = np.eye(max(1, round(length_px / math.sqrt(2))) + 1 if length_px else 1, dtype=np.float64)
    smeared = cv2.filter2D(view.image, -1, weights / weights.sum())
    found = detect(smeared, ico(), name="x")
    assert (found.motion_px > 0) == is_told
    assert any("motion" in remark for remark in found.remarks) == is_told
    if is_told:
        assert abs(found.motion_px - length_px) < 1.5
        assert re.search(r"about \d px along (4\d|5\d) deg", found.remarks[0])


def test_out_of_focus_is_no_motion() -> None:
    """A blur alike in all directions, wide and of slanted rings, is not said to be a motion."""
    for seed in range(3):
        view = view_of(board(), seed, options=replace(USUAL, blur_px=2.2))
        found = detect(view.image, board(), name="x")
        assert len(found.ring) > 90
        assert found.motion_px == 0
