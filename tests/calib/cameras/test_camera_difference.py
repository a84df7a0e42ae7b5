"""The difference of two cameras, against mrcal and by construction."""

from pathlib import Path

import cv2
import numpy as np
import pytest
from scipy.optimize import minimize

from calib.cameras import project, rays
from calib.cameras.camera import Camera
from calib.cameras.refit import camera_difference
from calib.core.se3 import exp_rotation
from calib.draw.fields import difference_picture
from calib.draw.sigma_map import scale_end
from calib.draw.style import WIDTH_PX
from designer.base.errors import InputError
from tests.support.foreign_cameras import CAMERAS, SIZE, ask_mrcal, text_of

A = Camera("opencv", np.array([900.0, 905, 510, 390, -0.12, 0.09, 0.0006, -0.0004, -0.02]), SIZE)
B = Camera("opencv", np.array([902.0, 906, 514, 388, -0.125, 0.08, 0.0003, -0.0005, -0.005]), SIZE)

DIFFERENCE = """
models = [mrcal.cameramodel(path) for path in question['paths']]
answer = {}
for name, options in question['options'].items():
    if 'implied_Rt10' in options:
        options['implied_Rt10'] = np.array(options['implied_Rt10'])
    _, difference, pixel, rt = mrcal.projection_diff(models, use_uncertainties=False, **options)
    answer[name] = [difference.tolist(), pixel.tolist(), rt[:3].tolist()]
"""


def test_a_camera_does_not_differ_from_itself() -> None:
    """No difference, and no rotation, for every model."""
    for camera in CAMERAS.values():
        found = camera_difference(camera, camera)
        assert np.abs(found.difference_px).max() < 1e-9
        assert found.turn_rad < 1e-12


def test_a_turned_camera_is_the_same() -> None:
    """A linear camera whose frame is turned about its axis differs in nothing but the rotation, which is found."""
    angle = 0.02
    a = Camera("pinhole", np.array([900.0, 900, 511.5, 383.5]), SIZE)
    about_z = exp_rotation(np.array([0, 0, angle]))
    pixel = camera_difference(a, a).pixel
    turned = project(a, rays(a, pixel) @ about_z.T)
    assert np.linalg.norm(turned - pixel, axis=-1).max() > 10
    # A shift of the principal point is a turn to first order: most of 4 px must vanish.
    b = Camera("pinhole", np.array([900.0, 900, 515.5, 383.5]), SIZE)
    shifted = camera_difference(a, b)
    assert shifted.length_px.max() < 1.5
    assert camera_difference(a, b, radius_px=0).length_px.max() == pytest.approx(4)
    assert shifted.turn_rad == pytest.approx(4 / 900, rel=0.2)


def test_the_rotation_is_the_best() -> None:
    """No other rotation makes the squares of the differences smaller."""
    found = camera_difference(A, B)
    ray = rays(A, found.pixel.reshape(-1, 2))

    def cost(turn: np.ndarray) -> float:
        rotation = exp_rotation(turn * 1e-3) @ found.b_from_a
        return float(np.sum((project(B, ray @ rotation.T) - found.pixel.reshape(-1, 2)) ** 2))

    best = minimize(cost, np.zeros(3), method="Nelder-Mead", options={"xatol": 1e-9, "fatol": 1e-9})
    assert cost(np.zeros(3)) <= best.fun * (1 + 1e-9)
    assert cost(np.zeros(3)) < 0.9 * cost(np.array([1.0, 0, 0]))


def test_mrcal_finds_the_same(tmp_path: Path) -> None:
    """With our rotation, or none, mrcal's map is ours to its precision; mrcal's own rotation is hardly another.

    mrcal makes the fourth powers of angles least, we the squares of pixels: its RMS is no smaller, but close.
    """
    paths = [tmp_path / f"{name}.cameramodel" for name in "ab"]
    for path, camera in zip(paths, (A, B), strict=True):
        path.write_text(text_of("mrcal", camera))
    whole, none = camera_difference(A, B), camera_difference(A, B, radius_px=0)
    radius = min(SIZE) / 6
    centre = camera_difference(A, B, radius_px=radius)
    given = [*whole.b_from_a.tolist(), [0, 0, 0]]
    options = {
        "given": {"implied_Rt10": given},
        "none": {"intrinsics_only": True},
        "whole": {"focus_radius": 1e4},
        "centre": {},
    }
    answer = ask_mrcal(DIFFERENCE, {"paths": [str(path) for path in paths], "options": options}, tmp_path)
    assert isinstance(answer, dict)
    assert np.array_equal(answer["none"][1], none.pixel)
    assert np.abs(np.array(answer["none"][0]) - none.difference_px).max() < 1e-6
    assert np.abs(np.array(answer["given"][0]) - whole.difference_px).max() < 1e-6
    for name, ours in (("whole", whole), ("centre", centre)):
        near = ours.off_centre_px <= ours.radius_px
        theirs = np.linalg.norm(answer[name][0], axis=-1)
        our_rms, their_rms = (np.sqrt(np.mean(length[near] ** 2)) for length in (ours.length_px, theirs))
        assert our_rms <= their_rms * (1 + 1e-9)
        assert our_rms > 0.8 * their_rms


def test_one_corner_does_not_set_the_scale() -> None:
    """Where few differences are far larger than the usual, colours end at the usual; else at the largest."""
    length = np.linspace(0.1, 0.2, 400)
    assert scale_end(length) == (pytest.approx(0.2), False)
    length[0] = 50.0
    end, is_cut = scale_end(length)
    assert is_cut
    assert 0.19 < end < 0.2


def test_other_image_sizes_are_refused() -> None:
    """Cameras of two image sizes cannot be compared, and both sizes are named."""
    other = Camera("pinhole", np.array([900.0, 900, 500, 400]), (1000, 800))
    with pytest.raises(InputError, match="cameras of 1024 x 768 and 1000 x 800 pixels cannot be compared"):
        camera_difference(A, other)


def test_what_one_camera_does_not_know_is_left_out() -> None:
    """Where a lens folds over there is no light to compare; a radius with no pixel in it is refused."""
    folded = Camera("opencv", np.array([900.0, 905, 510, 390, -0.6, 0, 0, 0, 0]), SIZE)
    found = camera_difference(A, folded)
    known = np.isfinite(found.difference_px).all(axis=-1)
    assert 0.3 < known.mean() < 1
    assert found.turn_rad < 0.05
    with pytest.raises(InputError, match="use a larger radius, or 0 for no rotation"):
        camera_difference(A, B, radius_px=1.0)


@pytest.mark.parametrize("b", [A, Camera("opencv", np.array([900.0, 905, 510, 390, -0.6, 0, 0, 0, 0]), SIZE)])
def test_the_picture_can_be_drawn(b: Camera, tmp_path: Path) -> None:
    """The map is a picture in colours, of equal cameras and of half-known ones too."""
    (tmp_path / "d.png").write_bytes(difference_picture(camera_difference(A, b, radius_px=200), "a to b", "note"))
    picture = cv2.imread(str(tmp_path / "d.png"))
    assert picture is not None
    assert picture.shape[1] == WIDTH_PX
    assert 0.6 < picture.shape[0] / picture.shape[1] < 1
    assert picture.std() > 10


def test_wide_cameras_are_compared_by_angles_to_the_border() -> None:
    """Of equidistant lenses light at r px comes from r / f: the angle is its difference, also beyond 90 degrees."""
    size, focal = (801, 601), (230.0, 231.0)
    a, b = (Camera("fisheye", np.array([f, f, 400.0, 300.0, 0, 0, 0, 0]), size) for f in focal)
    found = camera_difference(a, b, radius_px=0)
    radius = np.linalg.norm(found.pixel - np.array([400.0, 300.0]), axis=-1)
    assert radius.max() / focal[0] > np.radians(120)
    assert found.angle_rad == pytest.approx(radius / focal[0] - radius / focal[1], abs=1e-12)
    assert found.length_px == pytest.approx(radius * (focal[1] / focal[0] - 1), abs=1e-9)


def test_what_only_a_formula_shows_is_not_compared() -> None:
    """A polynomial sends light from 80 degrees far out of its image: no camera, so nothing to compare there."""
    wide = Camera("fisheye", np.array([190.0, 190.0, 319.5, 239.5, 0.0, 0.0, 0.0, 0.0]), (640, 480))
    grows = Camera("opencv", np.array([190.0, 190.0, 319.5, 239.5, -0.3, 0.1, 0.0, 0.0, 0.0]), (640, 480))
    length = camera_difference(wide, grows, radius_px=0).length_px
    assert np.nanmax(length) < 1500
    assert np.isnan(length).mean() > 0.3
