"""The spline camera: a lens that no Brown polynomial fits, for simulated photos."""

import numpy as np
import pytest
from scipy.interpolate import BSpline

from calib.cameras import linearise, parameter_names, project, rays
from calib.cameras.camera import Camera, camera_from_mapping, camera_or_preset
from calib.cameras.parameters import slopes
from calib.cameras.refit import refit
from calib.cameras.spline import COLUMNS, MODEL, ROWS
from calib.solver.plan import plan_from_words
from calib.solver.problem import SolveOptions, tie_parameters
from designer.base.errors import InputError
from tests.support.lenses import SIZE, bent

FIRST = MODEL.first_control
PINHOLE = np.array([900.0, 880.0, 510.0, 390.0])


def pixels(count: int = 2000) -> np.ndarray:
    """Pixels all over the image."""
    return np.random.default_rng(1).uniform([-0.5, -0.5], [SIZE[0] - 0.5, SIZE[1] - 0.5], (count, 2))


def test_the_surface_is_a_tensor_product_of_scipys_splines() -> None:
    """The displacement is that of scipy's cubic B-splines with uniform knots a control point apart."""
    camera = bent(5)
    point = rays(camera, pixels(500))
    pinhole = slopes(point) * PINHOLE[:2] + PINHOLE[2:]
    scale = MODEL.scale(camera.image_size)
    across, down = (scale[k, 0] + (np.arange(count) - 1) / scale[k, 1] for k, count in enumerate((COLUMNS, ROWS)))

    def basis(where: np.ndarray, centers: np.ndarray) -> np.ndarray:
        step = centers[1] - centers[0]
        knots = centers[0] + step * np.arange(-2, len(centers) + 2)
        return BSpline.design_matrix(where, knots, 3).toarray()

    control = camera.params[FIRST:].reshape(2, ROWS, COLUMNS)
    offset = np.einsum("nr,arc,nc->na", basis(pinhole[:, 1], down), control, basis(pinhole[:, 0], across))
    assert np.abs(project(camera, point) - pinhole - offset).max() < 1e-9


def test_without_displacement_it_is_a_pinhole() -> None:
    """With all control points at zero it sees as the linear camera, and control points all alike only shift it."""
    point = rays(Camera("pinhole", PINHOLE, SIZE), pixels())
    shifted = np.concatenate([PINHOLE, np.full(ROWS * COLUMNS, 3.0), np.full(ROWS * COLUMNS, -2.0)])
    straight = np.concatenate([PINHOLE, np.zeros(2 * ROWS * COLUMNS)])
    assert np.abs(project(Camera("spline", straight, SIZE), point) - pixels()).max() < 1e-9
    assert np.abs(project(Camera("spline", shifted, SIZE), point) - pixels() - [3, -2]).max() < 1e-9


def test_nothing_is_seen_behind_the_camera_or_outside_of_the_surface() -> None:
    """Points behind the camera and far outside of the image project to nan; pixels there have no ray."""
    camera = bent()
    outside = np.array([[0.1, 0.1, -1.0], [0.1, 0.1, 0.0], [3.0, 0.0, 1.0]])
    assert np.isnan(project(camera, outside)).all()
    assert np.isnan(linearise(camera, np.ascontiguousarray(outside.T)).pixel).all()
    assert np.isnan(rays(camera, np.array([[5000.0, 0.0]]))).all()


def test_the_template_is_bent_as_no_brown_polynomial_is() -> None:
    """The best Brown fits of the template leave 2 px RMS and more; the camera itself is the Phase One."""
    camera = camera_or_preset("phase-one-spline")
    assert (camera.model, camera.image_size) == ("spline", (11608, 8708))
    assert np.array_equal(camera.params[:FIRST], camera_or_preset("phase-one-ixg").params[:FIRST])
    for model in ("opencv", "luhmann"):
        assert 2.0 < refit(camera, model, turn=True).rms_px < 5.0


def test_a_file_has_all_control_points() -> None:
    """A file that ends early is refused, not read with zeros for what is missing; so is a name that there is not."""
    names = parameter_names("spline")
    assert len(names) == FIRST + 2 * ROWS * COLUMNS
    lens = {"fx_px": 900.0, "fy_px": 880.0, "cx_px": 510.0, "cy_px": 390.0}
    whole = {**dict.fromkeys(names, 0.0), **lens, "du_row1_column2_px": 4.0}
    values = {"format": "ringsolid.camera", "version": 1, "model": "spline", "image_size": list(SIZE)}

    def read(parameters: dict[str, float]) -> Camera:
        return camera_from_mapping({**values, "parameters": parameters}, "test", is_written_by_hand=True)

    assert np.flatnonzero(read(whole).params[FIRST:]).tolist() == [COLUMNS + 2]
    with pytest.raises(InputError, match=f"{names[-3]} is missing, and 2 more of the {len(names)} of model spline"):
        read({name: whole[name] for name in names[:-3]})
    with pytest.raises(InputError, match="unknown parameter 'du_row9_column9_px'"):
        read({**whole, "du_row9_column9_px": 1.0})


def test_it_is_not_solved() -> None:
    """Solver and command line refuse the model in one line that names those that are solved."""
    with pytest.raises(InputError, match="simulated with it, not solved; choose one of luhmann, opencv, virtual"):
        tie_parameters("spline", SolveOptions())
    with pytest.raises(InputError, match="--model spline: photos are simulated with it, not solved"):
        plan_from_words("spline", fix=[], share=[], focal_px=None, loss="squares", reject=None, weighted=False)
