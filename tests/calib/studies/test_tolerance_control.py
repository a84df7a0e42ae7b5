"""Draws against what is predicted of them."""

import numpy as np
import pytest

from calib.studies.tolerance.draw import run_draws
from calib.studies.tolerance.first_order import first_order
from calib.studies.tolerance.predict import control_of, linear_table
from calib.studies.tolerance.quantities import NAMES, quantity_row
from calib.studies.tolerance.result import table_of_draws
from designer.tolerance.error_file import error_model
from designer.tolerance.model import ErrorModel
from designer.tolerance.source import Amount
from tests.support.tolerance_settings import ico_setting

SEED = 3


def mixed_errors() -> ErrorModel:
    """Faces, rings and the print; a fixed number, a uniform one, one as small as the noise, and one without effect."""
    few = error_model("fdm-dual-calibrated").only("face_tilt", "ring_jitter", "scale", "ink_bleed")
    few = few.with_amount("skew", Amount("fixed", 1e-4)).with_amount("ring_jitter", Amount("normal", 5e-4))
    return few.with_amount("face_offset", Amount("uniform", 0.02))


@pytest.mark.parametrize("has_noise", [True, False])
def test_predictions_of_draws_have_the_mean_that_is_stated(has_noise: bool) -> None:
    """The mean over many draws of what is predicted of each is the table's square, within what chance allows."""
    first, errors = first_order(ico_setting()), mixed_errors()
    numbers = range(300)
    control = control_of(first, linear_table(ico_setting(), errors), SEED, numbers, factor=1.5, has_noise=has_noise)
    chance = control.square.std(axis=0, ddof=1) / np.sqrt(len(numbers))
    scale = np.abs(control.mean).max(axis=0)
    assert (np.abs(control.square.mean(axis=0) - control.mean) < 4.5 * chance + 1e-10 * scale).all()


def test_draws_that_are_as_predicted_are_the_prediction() -> None:
    """Of draws that the prediction tells exactly, the table is the prediction, and nothing is left to chance."""
    first, errors = first_order(ico_setting()), mixed_errors()
    linear = linear_table(ico_setting(), errors)
    control = control_of(first, linear, SEED, range(3))
    drawn = control.square.copy()
    drawn[:, 1:] += drawn[:, :1]
    table = table_of_draws(errors, np.sqrt(np.maximum(drawn, 0.0)), control)
    size = linear.baseline.value
    for found, expected in ((table.cost, linear.cost), (table.together, linear.together)):
        np.testing.assert_allclose(found.value, expected.value, rtol=1e-9, atol=1e-5 * size.max())
        assert (found.high - found.low < 1e-5 * (expected.value + size)).all()
    np.testing.assert_allclose(table.baseline.value, linear.baseline.value, rtol=1e-9)


def test_a_table_against_the_prediction_is_that_of_the_draws() -> None:
    """Held against their prediction draws say the same as without, more precisely, where errors are large, too."""
    setting, factor = ico_setting(), 4.0
    errors = error_model("fdm-dual").only("skew", "face_offset", "ring_jitter")
    numbers = range(24)
    control = control_of(first_order(setting), linear_table(setting, errors), SEED, numbers, factor=factor)
    model = errors.scaled(factor)
    draws = run_draws(setting, model, SEED, numbers)
    plain, table = table_of_draws(model, draws), table_of_draws(model, draws, control)
    rows = [quantity_row(name) for name in NAMES if name != "principal_point"]
    for one, other in ((plain.cost, table.cost), (plain.together, table.together)):
        assert (np.abs(one.value - other.value) < 4 * np.hypot(one.error, other.error))[..., rows].all()
        assert np.median(other.error[..., rows] / one.error[..., rows]) < 0.25
    np.testing.assert_array_equal(plain.failed, table.failed)
