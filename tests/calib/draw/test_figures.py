"""Pictures of calibrations: drawn from anything that can be evaluated, and what they state is right."""

import io
import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from matplotlib.figure import Figure
from matplotlib.text import Text
from PIL import Image

from calib.cameras.camera import Camera
from calib.core.se3 import exp_rotation
from calib.draw import calibration_figures
from calib.draw.style import picture, round_length
from calib.observe.observations import known_points
from calib.renderer.truth import Truth, true_views
from calib.solver.calibration import Calibration
from calib.solver.metrics.evaluation import Evaluation, evaluate
from calib.solver.metrics.residual_cells import LEAST_PER_CELL, cells_of, columns_rows, residuals_of
from tests.support.calibrations import board, calibration_of, camera, example, icosahedron, poses_around, seen_by

BOARD = board()


def drawn(one: Calibration) -> Image.Image:
    """The picture of a calibration."""
    (content,) = calibration_figures(evaluate(one), Path()).values()
    return Image.open(io.BytesIO(content))


def noisy(views: int = 6) -> Calibration:
    """An ordinary calibration."""
    return example(BOARD, np.random.default_rng(1), views=views, noise_px=0.1)


def weighted(one: Calibration) -> Calibration:
    """The same, with covariances that count."""
    cov = np.tile(0.01 * np.eye(2), (len(one.observations.view), 1, 1))
    return replace(one, observations=replace(one.observations, cov_px2=cov), weighted=True, scale=1.0)


def with_outliers(one: Calibration) -> Calibration:
    """The same, some observations left out."""
    flag = np.arange(len(one.is_outlier)) % 7 == 0
    return replace(one, is_outlier=flag)


def portrait() -> Calibration:
    """An image that is higher than wide."""
    lens, poses = camera(size=(600, 1500), focal_px=900.0), poses_around(3, np.random.default_rng(2))
    return calibration_of(lens, seen_by(lens, known_points(BOARD), poses), poses)


def no_corners() -> Calibration:
    """A lens that folds over before it reaches the corners of the image."""
    lens = Camera("opencv", np.array([500.0, 500, 500, 500, -0.5, 0, 0, 0, 0]), (1000, 1000))
    poses = poses_around(3, np.random.default_rng(6))
    return calibration_of(lens, seen_by(lens, known_points(BOARD), poses), poses)


def tiny(seed: int) -> Evaluation:
    """Errors of some thousandths, and poses known: all metrics, with many zeros after the point."""
    one = example(BOARD, np.random.default_rng(seed), noise_px=0.003)
    moved = one.cam_from_target.copy()
    moved[:, :3, :3] = exp_rotation(np.array([1e-6, 0.0, 0.0])) @ moved[:, :3, :3]
    return evaluate(one, Truth("", one.camera, true_views(one.observations.view_names, moved)))


def test_the_same_data_makes_the_same_picture() -> None:
    """Byte for byte: no dates, no random choice of arrows. It is 1600 pixels wide, three rows of panels high."""
    one = evaluate(noisy())
    pictures = calibration_figures(one, Path())
    assert calibration_figures(one, Path()) == pictures
    (content,) = pictures.values()
    width, height = Image.open(io.BytesIO(content)).size
    assert width == 1600
    assert height > 1200


@pytest.mark.parametrize(
    "one",
    [
        weighted(noisy()),
        with_outliers(noisy()),
        replace(noisy(), is_outlier=np.ones(len(noisy().is_outlier), dtype=bool)),
        replace(noisy(), param_covariance=np.full((9, 9), np.nan), scale=math.nan, status="degenerate"),
        replace(noisy(), param_covariance=np.zeros((9, 9)), scale=0.0),
        replace(noisy(1), observations=replace(noisy(1).observations, view_names=("$x_{$" + 300 * "\n\udc80",))),
        portrait(),
        no_corners(),
        example(icosahedron(), np.random.default_rng(3), model="pinhole", views=3),
    ],
    ids=[
        "weighted",
        "outliers",
        "only-outliers",
        "degenerate",
        "all-fixed",
        "hostile-name",
        "portrait",
        "no-corners",
        "no-errors",
    ],
)
@pytest.mark.filterwarnings("error")
def test_anything_that_can_be_evaluated_can_be_drawn(one: Calibration) -> None:
    """Weights, outliers, nothing left, nothing known, odd names and shapes: a picture, and no warning."""
    assert drawn(one).size[0] == 1600


def test_no_text_lies_on_another(monkeypatch: pytest.MonkeyPatch) -> None:
    """Titles, notes, scale arrows and numbers stay apart, tiny numbers included."""
    pages: list[Figure] = []

    def kept(height_px: int, draw: Callable[[Figure], None], **options: bool) -> bytes:
        return picture(height_px, lambda page: (draw(page), pages.append(page))[0], **options)

    monkeypatch.setattr("calib.draw.picture", kept)
    calibration_figures(tiny(0), Path())
    for axes in pages[0].axes:
        texts = [text for text in axes.findobj(Text) if isinstance(text, Text) and text.get_text()]
        flat = [text for text in texts if text.get_visible() and not text.get_rotation()]  # a slanted box is too large
        boxes = [text.get_window_extent() for text in flat]
        for number, box in enumerate(boxes):
            assert not box.count_overlaps(boxes[:number])


def test_cells_hold_the_means_of_what_lies_in_them() -> None:
    """Counts and means by a plain loop over cells; too few residuals have no mean."""
    rng = np.random.default_rng(4)
    pixel, residual = rng.uniform(-0.5, [119.5, 89.5], (300, 2)), rng.normal(0.3, 1, (300, 2))
    cells = cells_of((120, 90), pixel, residual, (8, 6))
    assert cells.count.sum() == 300
    for row in range(6):
        for column in range(8):
            inside = (np.floor((pixel[:, 0] + 0.5) / 15) == column) & (np.floor((pixel[:, 1] + 0.5) / 15) == row)
            assert cells.count[row, column] == inside.sum()
            if inside.sum() >= LEAST_PER_CELL:
                assert np.allclose(cells.mean_px[row, column], residual[inside].mean(axis=0))
            else:
                assert np.isnan(cells.mean_px[row, column]).all()


def test_noise_alone_explains_the_means_of_noise() -> None:
    """For white noise the means are as long as stated for noise alone; a distortion left over makes them longer."""
    rng = np.random.default_rng(5)
    pixel, residual = rng.uniform(0, [1000, 800], (20_000, 2)), rng.normal(0, 0.1, (20_000, 2))
    cells = cells_of((1000, 800), pixel, residual, (20, 16))
    assert cells.noise_px == pytest.approx(0.1, rel=0.02)
    assert cells.rms_of_means_px == pytest.approx(cells.rms_by_noise_px, rel=0.1)
    bent = cells_of((1000, 800), pixel, residual + 0.1 * np.sin(pixel / 150), (20, 16))
    assert bent.rms_of_means_px > 5 * bent.rms_by_noise_px


def test_cells_are_about_square_and_not_too_many() -> None:
    """Few sightings make coarse cells; many make 20 columns at most."""
    assert columns_rows((1000, 500), 10) == (4, 2)
    columns, rows = columns_rows((1200, 900), 1000)
    assert columns / rows == pytest.approx(4 / 3, rel=0.15)
    assert columns * rows < 1000 / 8
    assert columns_rows((1200, 900), 10**6) == (20, 15)


def test_residuals_drawn_are_those_that_count() -> None:
    """Outliers are marked apart."""
    one = with_outliers(noisy())
    found = residuals_of(evaluate(one))
    assert len(found.outlier_px) == one.is_outlier.sum()
    assert len(found.pixel) == (~one.is_outlier).sum()
    assert np.allclose(found.residual_px, one.residual_px[~one.is_outlier])


@pytest.mark.parametrize(("length", "expected"), [(0.9, 1), (1.6, 2), (30, 20), (70, 50), (80, 100), (0.0042, 0.005)])
def test_scales_are_round(length: float, expected: float) -> None:
    """1, 2 or 5 times a power of ten."""
    assert round_length(length) == pytest.approx(expected)
