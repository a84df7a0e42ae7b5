"""Draws of a what-if study kept in `study.sqlite`, as the samples of other studies are: resumable and in parallel."""

import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from calib.studies.identity import identity_of
from calib.studies.runner import run_cases
from calib.studies.sample import SampleResult
from calib.studies.sampling import Tell
from calib.studies.statistics import Case
from calib.studies.store import open_study
from calib.studies.tolerance.draw import case_names, run_draws
from calib.studies.tolerance.full import run_full_draws
from calib.studies.tolerance.quantities import QUANTITIES
from calib.studies.tolerance.setting import Setting
from calib.studies.workers import CaseSpec
from designer.base.errors import InputError
from designer.tolerance.model import ErrorModel

Array = NDArray[np.float64]

STUDY_FILE, AGAINST_FILE, SWEEPS_FOLDER = "study.sqlite", "against.sqlite", "sweeps"
KIND = "tolerance"
CASE = "draws"
NAN = float("nan")


@dataclass(frozen=True, eq=False)
class DrawPool:
    """What draws are made from, as `calib.studies.workers.SamplePool`."""

    setting: Setting
    errors: ErrorModel
    full: bool  # with images, rendered and detected

    @property
    def view_count(self) -> int:
        """Of the setting."""
        return self.setting.view_count

    @property
    def model(self) -> str:
        """The kind of study."""
        return KIND

    @property
    def value_count(self) -> int:
        """All quantities of all cases."""
        return len(case_names(self.errors)) * len(QUANTITIES)

    @property
    def covariance(self) -> Array:
        """There is none."""
        return np.zeros((0, 0))

    def run(self, case: str, size: int, seed: int, numbers: range) -> list[SampleResult]:
        """Draws; one in which a case has no solution is not converged."""
        run = run_full_draws if self.full else run_draws
        draws = run(self.setting, self.errors, seed, numbers)
        return [self._result(number, draw) for number, draw in zip(numbers, draws, strict=True)]

    def _result(self, number: int, draw: Array) -> SampleResult:
        lost = [name for name, row in zip(case_names(self.errors), draw, strict=True) if not np.isfinite(row).all()]
        return SampleResult(
            number, "stopped" if lost else "converged", self.view_count, NAN, NAN, NAN, NAN,
            tuple(draw.ravel().tolist()), 0, f"no solution with {', '.join(lost)}" if lost else "",
        )  # fmt: skip


@dataclass(frozen=True)
class Keeping:
    """Where draws are kept, and who computes them."""

    folder: Path
    jobs: int  # processes on this machine
    dask: str | None = None  # address of a cluster's scheduler, instead
    resume: bool = False  # go on with a file that is there

    def draws(self, pool: DrawPool, file: str, inputs: Mapping[str, Path], seed: int, count: int, tell: Tell) -> Array:
        """The first draws of a study, those that its file does not have computed.  # (D, C, Q)

        Args:
            pool: what they are made from.
            file: of the study, below the folder.
            inputs: the files that were read, by what they are.
            seed: of all draws.
            count: D.
            tell: told how many are done.

        Raises:
            InputError: the file is there and `resume` is not asked for, or is of another study.
            StudyStoppedError: interrupted, or no workers are left.
        """
        path = self.folder / file
        path.parent.mkdir(parents=True, exist_ok=True)
        spec = CaseSpec(Case(CASE, pool.view_count, pool.view_count), pool)
        with open_study(path, identity_of(seed, _settings(pool), inputs), resume=self.resume) as study:
            run_cases(
                [spec], study, samples=count, seed=seed, jobs=self.jobs, dask=self.dask, on_progress=tell,
                chunk=1 if pool.full else None,
            )  # fmt: skip
            kept = study.load(spec.name)
        return kept.params[:count].reshape(-1, len(case_names(pool.errors)), len(QUANTITIES))

    def check_unused(self, *, predicts: bool) -> None:
        """Refuse a folder that holds a study already, unless it is gone on with.

        Raises:
            InputError: there is one.
        """
        sweeps = sorted((self.folder / SWEEPS_FOLDER).glob("*.sqlite"))
        for path in (self.folder / STUDY_FILE, self.folder / AGAINST_FILE, *sweeps):
            if path.exists() and predicts:
                raise InputError(f"{path}: the folder holds a study with draws; choose another -o for the prediction")
            if path.exists() and not self.resume:
                raise InputError(f"{path}: there is a study already; go on with it with --resume, or choose another -o")


def _settings(pool: DrawPool) -> dict[str, str]:
    """What decides a draw beside the seed."""
    setting, errors = pool.setting, pool.errors
    amounts = [f"{name}={amount.kind} {amount.size!r}" for name, amount in errors.amounts]
    return {
        "study": KIND,
        "images": "yes" if pool.full else "no",
        "errors": ", ".join(amounts),
        "expansion": repr(errors.expansion_per_kelvin),
        "layer height": repr(errors.layer_height_mm),
        "model": setting.model,
        "options": repr(setting.options),
        "views": str(setting.view_count),
        "camera": _digest((json.dumps(setting.camera.to_json(), indent=2) + "\n").encode()),
        "poses": _digest(setting.cam_from_target.tobytes()),
        "noise": _digest(setting.noise_root.tobytes()),
        "bed": "",  # on its last face, as in all studies so far
    }


def _digest(content: bytes) -> str:
    return hashlib.sha256(content).hexdigest()[:16]
