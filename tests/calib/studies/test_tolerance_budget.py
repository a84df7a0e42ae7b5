"""What tolerance studies conclude from costs: tables, budgets, sweeps and crossovers; draws against predictions.

Draws are kept in a file and gone on with, and images say what simulated observations say.
"""

from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from calib.studies.runner import Sampling
from calib.studies.tolerance.budget import allowed_by_draws, budget_row, crossovers, largest_allowed
from calib.studies.tolerance.draw import TOGETHER, run_draws
from calib.studies.tolerance.first_order import first_order
from calib.studies.tolerance.predict import Cost, ToleranceTable, control_of, linear_table, table_of_draws
from calib.studies.tolerance.quantities import NAMES, QUANTITIES, Requirement, quantity_row
from calib.studies.tolerance.record import CrossoverRow
from calib.studies.tolerance.seen import aimed_at
from calib.studies.tolerance.setting import make_setting
from calib.studies.tolerance.sizes import sweep_rows
from calib.studies.tolerance.stored import DrawPool, kept_draws, run_full_draws
from designer.base.arrays import Array
from designer.base.errors import InputError
from designer.page.progress import unheard
from designer.tolerance.error_file import error_model
from designer.tolerance.model import ErrorModel
from designer.tolerance.source import Amount
from tests.support.perturbed_targets import ico
from tests.support.solver_scenes import CAMERAS
from tests.support.tolerance_settings import DISTANCE_MM, errors, ico_setting


def of(row: Array, name: str) -> float:
    return float(row[quantity_row(name)])


def made_table(cost: dict[str, list[float]], together: list[float], base: float) -> ToleranceTable:
    """A made table in which all quantities cost the same; each list is value, low, high."""
    model = ErrorModel("made", "", tuple((name, Amount("normal", 0.5)) for name in cost))
    size = len(QUANTITIES)

    def spread(number: int) -> Array:
        return np.array([np.full(size, values[number]) for values in cost.values()])

    return ToleranceTable(
        "draws", model, Cost(*(np.full(size, base) for _ in range(3))), Cost(*map(spread, range(3))),
        Cost(*(np.full(size, value) for value in together)), 10, (),
    )  # fmt: skip


def test_table_of_made_draws() -> None:
    """Cost is sqrt(mean(m^2 - m0^2)), its interval that of the mean; sensitivity is by the amount's deviation."""
    model = ErrorModel("made", "", (("skew", Amount("uniform", 0.3)),))
    rng = np.random.default_rng(0)
    bare = 1 + rng.random((200, 1, len(QUANTITIES)))
    extra = rng.random((200, 1, len(QUANTITIES)))
    worse = np.sqrt(bare**2 + extra**2)
    table = table_of_draws(model, np.concatenate([bare, worse, worse], axis=1))
    np.testing.assert_allclose(table.cost.value[0], np.sqrt((extra**2).mean(axis=0)[0]))
    half = 1.96 * (extra**2).std(axis=0, ddof=1)[0] / np.sqrt(200)
    np.testing.assert_allclose(table.cost.high[0] ** 2 - table.cost.value[0] ** 2, half, rtol=1e-3)
    np.testing.assert_allclose(table.total, np.sqrt((worse**2).mean(axis=0)[0]))
    assert table.ranking("pose") == ("skew",)
    with pytest.raises(InputError, match="cases"):
        table_of_draws(errors(), np.zeros((3, 2, len(QUANTITIES))))
    with pytest.raises(InputError, match="even without errors"):
        table_of_draws(model, np.full((3, 3, len(QUANTITIES)), np.nan))


def test_budget_fills_the_limit() -> None:
    """With the allowed amount a quantity is at its limit; more room allows more; what costs nothing may be anything."""
    made = made_table({"skew": [2.0, 1.8, 2.2], "ink_bleed": [0.0, 0.0, 0.0]}, [2.0, 1.8, 2.2], base=1.0)
    budget = largest_allowed(made, Requirement("pose", 1.5))
    allowed = budget.allowed["skew"]
    assert np.hypot(1.0, 2.0 * allowed.factor) == pytest.approx(1.5)
    assert allowed.low < allowed.factor < allowed.high
    assert budget_row(budget, made).alone[0].largest_rms == pytest.approx(0.5 * allowed.factor)
    assert budget.allowed["ink_bleed"].factor == np.inf
    limits = (Requirement("pose", limit) for limit in (0.5, 1.0, 1.2, 2.0, 9.0))
    factors = [largest_allowed(made, one).allowed[TOGETHER].factor for one in limits]
    assert factors == sorted(factors)
    assert factors[:2] == [0.0, 0.0]
    assert not largest_allowed(made, Requirement("pose", 0.5)).is_met_without


def test_budget_by_draws() -> None:
    """By draws, the limit is met at the allowed amount, near the table's where errors are small."""
    setting, model = ico_setting(), errors().only("face_tilt", "ring_jitter")
    numbers = range(10)
    first, linear = first_order(setting), linear_table(setting, model)
    control = control_of(first, linear, 0, numbers)
    table = table_of_draws(model, run_draws(setting, model, 0, numbers), control)
    limit = float(1.5 * table.total[quantity_row("intersection")])
    required = Requirement("intersection", limit)
    found = allowed_by_draws(first, model, required, seed=0, numbers=numbers)
    assert found.factor == pytest.approx(largest_allowed(table, required).allowed[TOGETHER].factor, rel=0.02)
    drawn = run_draws(setting, model.scaled(found.factor), 0, numbers)
    again = table_of_draws(model, drawn, control_of(first, linear, 0, numbers, factor=found.factor))
    assert of(again.total, "intersection") == pytest.approx(limit, rel=2e-3)
    assert found.low < found.factor < found.high
    below = 0.5 * float(table.baseline.value[quantity_row("intersection")])
    required = Requirement("intersection", below)
    assert allowed_by_draws(first, model, required, seed=0, numbers=range(3)).factor == 0


@pytest.mark.parametrize(
    ("quantity", "limit", "message"), [("intersectoin", 1.0, "intersection"), ("pose", 0.0, "more than 0")]
)
def test_budgets_that_mean_nothing_are_refused(quantity: str, limit: float, message: str) -> None:
    """An unknown quantity is met with the nearest name, a limit of zero with the rule."""
    table = made_table({"skew": [1.0, 1.0, 1.0]}, [1.0, 1.0, 1.0], base=0.0)
    with pytest.raises(InputError, match=message):
        largest_allowed(table, Requirement(quantity, limit))


def test_sweep_goes_through_the_table() -> None:
    """A sweep's point at the model's own amount is the source's cost there; its line is the prediction."""
    own = made_table({"skew": [2.0, 1.8, 2.2], "ink_bleed": [0.0, 0.0, 0.0]}, [2.0, 1.8, 2.2], base=1.0)
    twice = made_table({"skew": [3.0, 2.8, 3.2], "ink_bleed": [0.0, 0.0, 0.0]}, [3.0, 2.8, 3.2], base=1.0)
    (found,) = sweep_rows({1.0: own, 2.0: twice}, own)
    assert (found.error, found.rms) == ("skew", (0.5, 1.0))
    for name in NAMES:
        costs = found.of(name)
        assert (costs.cost, costs.cost_low, costs.cost_high) == ((2.0, 3.0), (1.8, 2.8), (2.2, 3.2))
        assert costs.predicted == (2.0, 4.0)


def test_crossover() -> None:
    """At the crossover both targets have the same error; a target may lose at zero, or never."""
    other = made_table({"warp": [3.0, 2.9, 3.1]}, [3.0, 2.9, 3.1], base=0.5)
    own = made_table({"face_tilt": [2.0, 1.9, 2.1], "skew": [1.0, 0.9, 1.1]}, [2.2, 2.1, 2.3], base=0.2)
    found = of_first(own, other)
    assert found.verdict == "crosses"
    total = np.sqrt(0.2**2 + 1.0**2 + (found.rms / 0.5) ** 2 * 2.0**2)
    assert total == pytest.approx(np.hypot(3.0, 0.5))
    assert found.rms_low < found.rms < found.rms_high
    assert found.other_low < found.other < found.other_high
    assert found.noise_share == pytest.approx(0.04 / 1.04)
    assert of_first(other, own).verdict == "crosses"
    lost = of_first(own, made_table({"warp": [0.1, 0.1, 0.1]}, [0.1, 0.1, 0.1], base=0.1))
    assert (lost.verdict, lost.rms) == ("loses at zero", 0.0)
    harmless = made_table({"face_tilt": [0.0, 0.0, 0.0]}, [0.0, 0.0, 0.0], base=0.2)
    assert of_first(harmless, other).verdict == "never loses"


def of_first(table: ToleranceTable, other: ToleranceTable) -> CrossoverRow:
    """Of the first source and quantity."""
    return crossovers(table, other)[0]


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


FEW = ("scale", "face_tilt")


def kept(path: Path, model: ErrorModel, *, draws: int = 5, seed: int = SEED, jobs: int = 1, resume: bool = False,
         told: list[int] | None = None) -> NDArray[np.float64]:  # fmt: skip
    """The draws of a study."""
    pool, tell = DrawPool(ico_setting(), model, full=False), (told if told is not None else []).append
    sampling = Sampling(path.parent, jobs, None, resume, unheard)
    return kept_draws(sampling, pool, path.name, {}, seed, draws, tell)[0]


def test_draws_are_kept_and_gone_on_with(tmp_path: Path) -> None:
    """Draws from the file are those computed at once, bit for bit, whatever the jobs; only missing ones are done."""
    model, told = errors().only(*FEW), []
    expected = run_draws(ico_setting(), model, SEED, range(5))
    assert expected.shape[1] == 4
    np.testing.assert_array_equal(kept(tmp_path / "s", model, draws=2), expected[:2])
    np.testing.assert_array_equal(kept(tmp_path / "s", model, jobs=2, resume=True, told=told), expected)
    assert told[0] == 2
    np.testing.assert_array_equal(kept(tmp_path / "s", model, draws=3, resume=True), expected[:3])


def test_another_study_is_refused(tmp_path: Path) -> None:
    """Draws of other errors, of an amount that is hardly another, or of another seed do not come into the same file."""
    model = errors().only(*FEW)
    kept(tmp_path / "s", model, draws=1)
    before = (tmp_path / "s").read_bytes()
    with pytest.raises(InputError, match="--resume"):
        kept(tmp_path / "s", model, draws=1)
    for other in (model.only("scale"), model.scaled(1 + 1e-12)):
        with pytest.raises(InputError, match="with errors"):
            kept(tmp_path / "s", other, resume=True)
    with pytest.raises(InputError, match="seed"):
        kept(tmp_path / "s", model, seed=SEED + 1, resume=True)
    assert (tmp_path / "s").read_bytes() == before


TOLD = ("reprojection", "intersection", "reconstruction", "intersection_true", "pose", "focal_length")
"""Quantities that errors of a tenth of a millimetre set, not noise."""


def test_images_say_what_simulated_sightings_say() -> None:
    """Rendered, detected and calibrated, the same errors cost what they cost without images, and noise stays small."""
    setting = make_setting(
        ico(), CAMERAS["opencv"], views=4, photos=aimed_at(ico(), DISTANCE_MM), model="opencv", seed=1
    )
    model = errors("fdm-dual").only("face_offset")
    (full,), (simulated,) = (run(setting, model, 7, range(1)) for run in (run_full_draws, run_draws))
    assert full.shape == simulated.shape == (3, len(NAMES))
    assert full[0, NAMES.index("reprojection")] < 3 * simulated[0, NAMES.index("reprojection")]
    for name in TOLD:
        k = NAMES.index(name)
        assert abs(full[1, k] / simulated[1, k] - 1) < 0.1, (name, full[1, k], simulated[1, k])
    np.testing.assert_array_equal(full[1], full[2])
