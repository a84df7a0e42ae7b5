"""Everything a tolerance study computes, step by step, with its draws kept in a folder."""

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from calib.studies.progress import Tell, after
from calib.studies.tolerance.budget import Allowed, allowed_by_draws, largest_allowed
from calib.studies.tolerance.control import control_of
from calib.studies.tolerance.draw import TOGETHER
from calib.studies.tolerance.first_order import FirstOrder
from calib.studies.tolerance.reach import Reach, reach_of
from calib.studies.tolerance.report import CheckedBudget, Requirement, ToleranceReport, checked_budget
from calib.studies.tolerance.result import Control, ToleranceTable
from calib.studies.tolerance.setting import Setting
from calib.studies.tolerance.stored import tolerance_draws
from calib.studies.tolerance.sweep import FACTORS
from designer.base.errors import InputError
from designer.tolerance.model import ErrorModel

Array = NDArray[np.float64]

STUDY_FILE, AGAINST_FILE, SWEEPS_FOLDER = "study.sqlite", "against.sqlite", "sweeps"
SWEEP_DRAWS, SEARCH_DRAWS = 12, 24
OTHER_FACTORS = tuple(factor for factor in FACTORS if factor != 1.0)


@dataclass(frozen=True)
class Keeping:
    """Where draws are kept, and who computes them."""

    folder: Path
    inputs: Mapping[str, Path]
    seed: int
    jobs: int
    dask: str | None
    resume: bool
    full: bool  # with images

    def draws(self, setting: Setting, errors: ErrorModel, file: str, count: int, tell: Tell) -> Array:
        """Draws of a file in the folder, the missing ones computed.  # (D, C, Q)

        Raises:
            InputError: as `tolerance_draws`.
            StudyStoppedError: interrupted, or no workers are left.
        """
        path = self.folder / file
        path.parent.mkdir(parents=True, exist_ok=True)
        return tolerance_draws(
            setting, errors, path, inputs=self.inputs, draws=count, seed=self.seed, jobs=self.jobs, dask=self.dask,
            resume=self.resume, full=self.full, on_progress=tell,
        )  # fmt: skip


def sweep_draws(keeping: Keeping, setting: Setting, errors: ErrorModel, main: Array, tell: Tell) -> dict[float, Array]:
    """The draws of all errors at each multiple; those of the amounts themselves are the study's own."""
    count = min(SWEEP_DRAWS, len(main))
    found = {1.0: main}
    for place, factor in enumerate(OTHER_FACTORS):
        found[factor] = keeping.draws(
            setting, errors.scaled(factor), f"{SWEEPS_FOLDER}/{factor:g}x.sqlite", count,
            after(place * count, tell),
        )  # fmt: skip
    return found


def sweep_controls(
    first: FirstOrder, linear: ToleranceTable, draws: Mapping[float, Array], seed: int
) -> dict[float, Control]:
    """What is predicted of the draws of each multiple."""
    return {factor: control_of(first, linear, seed, range(len(one)), factor=factor) for factor, one in draws.items()}


def reaches(
    first: FirstOrder, errors: ErrorModel, sources: Sequence[str], baseline: Array, seed: int, tell: Tell
) -> tuple[Reach, ...]:
    """How far the prediction of each source holds."""
    found = []
    for place, name in enumerate(sources):
        found.append(reach_of(first, errors, name, baseline, seed=seed))
        tell(place + 1)
    return tuple(found)


def budgets_of(report: ToleranceReport, requirements: Sequence[Requirement]) -> tuple[CheckedBudget, ...]:
    """What each limit allows by the square law, and where that is not known to hold."""
    return tuple(checked_budget(report, largest_allowed(report.table, one.quantity, one.limit)) for one in requirements)


def searched(
    first: FirstOrder, checked: CheckedBudget, errors: ErrorModel, seed: int, count: int, tell: Tell
) -> tuple[tuple[str, Allowed], ...]:
    """The budget of what lies beyond the square law, searched with draws one by one; left out where none is found."""
    guess = dict(checked.budget.alone) | {TOGETHER: checked.budget.together}
    found = []
    for place, name in enumerate(checked.beyond):
        model = errors if name == TOGETHER else errors.only(name)
        with suppress(InputError):
            allowed = allowed_by_draws(
                first, model, checked.budget.quantity, checked.budget.limit, seed=seed,
                numbers=range(min(SEARCH_DRAWS, count)), guess=guess[name].factor, tell=after(place, tell),
            )  # fmt: skip
            found.append((name, allowed))
    return tuple(found)


def check_unused(folder: Path, *, resume: bool, predicts: bool) -> None:
    """Refuse a folder that holds a study already, unless it is gone on with.

    Raises:
        InputError: there is one.
    """
    there = [folder / STUDY_FILE, folder / AGAINST_FILE, *sorted((folder / SWEEPS_FOLDER).glob("*.sqlite"))]
    for path in there:
        if path.exists() and predicts:
            raise InputError(f"{path}: the folder holds a study with draws; choose another -o for the prediction")
        if path.exists() and not resume:
            raise InputError(f"{path}: there is a study already; go on with it with --resume, or choose another -o")
