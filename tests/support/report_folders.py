"""Folders of studies and measured prints for the tests of their pages: small, and made once."""

import tempfile
from collections.abc import Callable, Mapping
from functools import cache
from pathlib import Path

import numpy as np

from calib.app.study_bootstrap import Bootstrap
from calib.app.study_compare import ComparedObjects
from calib.app.study_cost import CostStudy
from calib.app.study_result import StudyResult
from calib.studies.compare.cases import FIGURE, LENS_DRAWN, METRICS, CaseResult, Explanation, Plan, tabulated
from calib.studies.cost.ratios import CostPlan, CostRatio, CostTable, StartRow
from calib.studies.identity import StudyIdentity
from calib.studies.runner import DrawCount
from calib.studies.samples import Case, SampleErrors, SampleResult, StoredCase
from calib.studies.store import open_study
from calib.studies.study_table import StudyCases, study_table
from tests.support.study_cases import NAMES, Made, gamma, made, paper_cases, studied
from tests.support.tolerance_settings import told, tolerance_study

Files = Mapping[str, bytes]

TARGET, PRINT = "my board", "ico-measured"
NAN = float("nan")
IDENTITY = StudyIdentity(7, (("model", "luhmann"), ("weighted", "no")), ())
POOL, SIZES, SAMPLES = 20, (5, 10), 60


def _samples(size: int) -> Made:
    rng = np.random.default_rng(size)
    metrics = np.column_stack(
        [gamma(mu, mu / size, SAMPLES, rng) for mu in (0.05, 0.004, 0.002)] + [np.full(SAMPLES, np.nan)]
    )
    return made(metrics, rng.normal(1000.0, 1 / size, size=(SAMPLES, len(NAMES))))


@cache
def bootstrap_result() -> Bootstrap:
    """A bootstrap of a person's board with two numbers of views, and its study file."""
    cases = {Case(TARGET, size, POOL): _samples(size) for size in SIZES}
    pool = {case.pool_key: 1e-6 * np.eye(len(NAMES)) for case in cases}
    return _bootstrap(StudyCases("luhmann", cases, pool), _study(cases))


def _bootstrap(cases: StudyCases, study: bytes) -> Bootstrap:
    return Bootstrap(study_table(cases), cases, IDENTITY, DrawCount(), (), study, "out")


def _study(cases: Mapping[Case, Made]) -> bytes:
    """The file of a study of these samples."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "study.sqlite"
        with open_study(path, IDENTITY, resume=False) as study:
            for case, samples in cases.items():
                study.declare(StoredCase(case, "luhmann", len(NAMES), 1e-6 * np.eye(len(NAMES))))
                study.add(case.name, [_result(k, samples) for k in range(len(samples.metrics))])
        return path.read_bytes()


def _result(number: int, samples: Made) -> SampleResult:
    params, errors = tuple(samples.params[number].tolist()), SampleErrors(*samples.metrics[number].tolist())
    return SampleResult(number, "converged", 4, params, 3, errors=errors)


@cache
def paper_result() -> Bootstrap:
    """The paper's study with its own means and deviations."""
    return _bootstrap(studied(paper_cases(80)), b"")


@cache
def compare_result() -> ComparedObjects:
    """A comparison with made-up errors: the board is best, and the virtual camera wins behind the lens."""
    rng = np.random.default_rng(1)
    sizes = {("AluBoard", FIGURE, "opencv"): 0.04, ("ShinyIco", FIGURE, "opencv"): 0.2}
    sizes |= {("AluBoard", LENS_DRAWN, "opencv"): 0.08, ("AluBoard", LENS_DRAWN, "virtual"): 0.001}
    cases = tuple(
        CaseResult(*key, {name: size * (1 + 0.1 * rng.random((3, 2))) for name in METRICS}, 0, 1)
        for key, size in sizes.items()
    )
    alone = (
        Explanation("AluBoard", "warp", 8.0, 7.0, 9.0, "1.2mm", 0.52, 0.5, 6.0, 6, 0, ""),
        Explanation("AluBoard", "noise", 1e4, 1e4, 1e4, "", 0.1, 0.5, 6.0, 6, 0, ""),
        Explanation("AluBoard", "skew", NAN, NAN, NAN, "", NAN, 0.5, NAN, 0, 6, "skew has no effect"),
    )
    plan = Plan("phase-one-ixg", 3, 2)
    return ComparedObjects(tabulated(plan, {}, cases, alone), DrawCount(), "out")


@cache
@cache
def cost_result() -> CostStudy:
    """A study of costs with made-up errors: rays are surely worse but in one place, and stand bad starts better."""
    ratios = (
        CostRatio("board", "as drawn", "image", "held_out_mm", "mm", 0.5, 1.0, 1.0, 1.0, 30, 0),
        CostRatio("board", "as drawn", "ray", "held_out_mm", "mm", 0.6, 1.2, 1.1, 1.3, 30, 0),
        CostRatio("board", "as drawn", "image", "camera_px", "px", 0.01, 1.0, 1.0, 1.0, 30, 0),
        CostRatio("board", "as drawn", "ray", "camera_px", "px", 0.02, 2.0, 1.9, 2.1, 29, 1),
        CostRatio("board", "as made", "image", "camera_px", "px", 0.01, 1.0, 1.0, 1.0, 30, 0),
        CostRatio("board", "as made", "ray", "camera_px", "px", 0.009, 0.9, 0.85, 0.95, 30, 0),
    )
    starts = (StartRow("board", "image", 60, 45, 0, 0, 9.0), StartRow("board", "ray", 60, 54, 10, 1, 8.0))
    table = CostTable(CostPlan(30, 60, 1, "own.csv", "opencv"), ratios, starts)
    return CostStudy(table, DrawCount(), "out")


RESULTS: Mapping[str, Callable[[], StudyResult]] = {
    "bootstrap": bootstrap_result, "paper": paper_result, "compare": compare_result, "cost": cost_result,
    "tolerance": lambda: told(tolerance_study()),
}  # fmt: skip
