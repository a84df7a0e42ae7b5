"""Pictures of studies: drawn from anything that a study can hold, in three formats."""

import io
from dataclasses import replace

import numpy as np
import pytest
from PIL import Image

from calib.app.bootstrap_page import study_sheets
from calib.draw.study_figures import (
    Pair,
    _edges,
    draw_convergence,
    draw_correlations,
    draw_histograms,
    histograms_height_px,
    merged,
)
from calib.draw.study_tables import unit_words
from calib.draw.style import picture
from calib.studies.samples import Case
from calib.studies.statistics import ICOSAHEDRON, METRICS, CaseSummary, correlations, predicted_correlations
from tests.support.study_cases import (
    NAMES,
    SIZES,
    Made,
    covariance,
    made,
    paper_cases,
    studied,
    summaries_of,
    table_of_cases,
    with_failures,
)

pytestmark = pytest.mark.filterwarnings("error")

ONE_SETTING = (("binary", "<= 75 deg"),)


def few(size: int = 20, count: int = 50) -> dict[Case, Made]:
    """A small study of one target."""
    generator = np.random.default_rng(1)
    return {Case("cube", size, 30): made(generator.normal(1, 0.1, (count, 4)), generator.normal(0, 1, (count, 9)))}


def test_a_study_has_its_pictures_in_three_formats() -> None:
    """Histograms, correlations and sigma over N, named by sampling and sightings; the same again from the same data."""
    cases = {case: samples for case, samples in paper_cases(50, settings=ONE_SETTING).items() if case.size in SIZES[:2]}
    sheets = list(study_sheets(studied(cases), table_of_cases(cases)))
    names = ("histograms_binary_75_deg", "correlations_binary_75_deg", "sigma_75_deg")
    files = {path: content for sheet in sheets for path, content in sheet.drawn(("pdf", "svg")).items()}
    assert list(files) == [f"figures/{name}.{suffix}" for name in names for suffix in ("png", "pdf", "svg")]
    for path, content in files.items():
        start = {"png": b"\x89PNG", "pdf": b"%PDF", "svg": b"<?xml"}[path.rpartition(".")[2]]
        assert content.startswith(start)
    svg = files["figures/sigma_75_deg.svg"].decode()
    assert "Reconstruction error" in svg  # text stays text
    assert Image.open(io.BytesIO(files["figures/sigma_75_deg.png"])).width == 1600
    again = sheets[-1].drawn(("pdf", "svg"))
    assert again == {path: files[path] for path in again}


def beside(cases: dict[Case, Made]) -> list[tuple[CaseSummary, Made]]:
    """Samples with what they say."""
    return list(zip(summaries_of(cases), cases.values(), strict=True))


def constant(samples: Made) -> Made:
    return replace(samples, metrics=np.ones_like(samples.metrics))


def without_poses(samples: Made) -> Made:
    metrics = samples.metrics.copy()
    metrics[:, 3] = np.nan
    return replace(samples, metrics=metrics)


def lost(samples: Made) -> Made:
    metrics = samples.metrics.copy()
    metrics[0] = 1e200
    return replace(samples, metrics=metrics)


@pytest.mark.parametrize(
    "cases",
    [
        few(count=2),
        few(count=0),
        {case: constant(samples) for case, samples in few().items()},
        {case: without_poses(samples) for case, samples in few().items()},
        {case: lost(samples) for case, samples in few().items()},
        {case: with_failures(s, np.random.default_rng(1), 0, 50) for case, s in few().items()},
        {**few(5), **few(7), **few(9), **few(11), **few(13), **few(15)},
        {replace(case, target="$x_{$" + 40 * "\n\udc80"): samples for case, samples in few().items()},
    ],
    ids=["two", "none", "constant", "no poses", "lost", "failed", "many sizes", "hostile name"],
)
def test_any_samples_can_be_drawn(cases: dict[Case, Made]) -> None:
    """No number of samples, size of an error, or name stops a picture; nothing is warned of."""
    content = picture(histograms_height_px(1), lambda page: draw_histograms(page, beside(cases)))
    assert Image.open(io.BytesIO(content)).height == histograms_height_px(1)
    picture(800, lambda page: draw_convergence(page, summaries_of(cases)))


def test_a_single_size_has_no_line_over_sizes_and_fixed_parameters_no_matrix() -> None:
    """What would show nothing is not made."""
    cases = {case: replace(samples, params=np.zeros((50, 9))) for case, samples in few().items()}
    assert [sheet.stem for sheet in study_sheets(studied(cases), table_of_cases(cases))] == ["histograms"]


def test_a_matrix_holds_samples_below_and_prediction_above() -> None:
    """Read by row and column: below the diagonal what was found, above what was predicted."""
    (case, samples), *_ = few().items()
    found = correlations(samples, NAMES)
    predicted = predicted_correlations(covariance(ICOSAHEDRON), NAMES)
    matrix = merged(Pair(case, found, predicted))
    below, above = np.tril_indices(9, -1), np.triu_indices(9, 1)
    np.testing.assert_array_equal(matrix[below], found.matrix[below])
    np.testing.assert_array_equal(matrix[above], predicted.matrix[above])
    assert np.isnan(np.diagonal(matrix)).all()
    alone = merged(Pair(case, found))
    np.testing.assert_array_equal(alone[above], alone.T[above])


def test_matrices_with_fixed_parameters_can_be_drawn() -> None:
    """A fixed parameter has no correlations; one matrix is drawn as two are."""
    (case, samples), *_ = few().items()
    params = samples.params.copy()
    params[:, 6] = 0.0
    pair = Pair(case, correlations(replace(samples, params=params), NAMES))
    picture(700, lambda page: draw_correlations(page, [pair]))


def test_bins_resolve_the_narrowest_distribution_and_hold_all_but_the_wildest() -> None:
    """A sigma has two bins or more; a lost sample does not set the axis."""
    generator = np.random.default_rng(1)
    wide, narrow = generator.normal(5.0, 1.0, 5000), generator.normal(5.0, 0.15, 5000)
    wide[0] = narrow[0] = 1e6
    edges = _edges([wide, narrow])
    assert edges[1] - edges[0] < 0.15 / 2
    assert edges[-1] < 12
    assert np.mean((wide > edges[0]) & (wide < edges[-1])) > 0.99


def test_units_are_the_papers() -> None:
    """With real superscripts: the style reads no formulae."""
    assert [unit_words(metric) for metric in METRICS] == ["10⁻² mm", "10⁻² mm", "10⁻¹ px", "10⁻¹ mm"]
