"""Draws of a what-if study kept in `study.sqlite`, as the samples of other studies are: resumable and in parallel."""

import hashlib
import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from calib.studies.identity import identity_of
from calib.studies.runner import run_cases
from calib.studies.sample import SampleResult
from calib.studies.statistics import Case
from calib.studies.store import open_study
from calib.studies.tolerance.draw import case_names, run_draws
from calib.studies.tolerance.full import run_full_draws
from calib.studies.tolerance.quantities import QUANTITIES
from calib.studies.tolerance.setting import Setting
from calib.studies.workers import CaseSpec
from designer.tolerance.model import ErrorModel

Array = NDArray[np.float64]

KIND = "tolerance"
CASE = "draws"
NAN = float("nan")


@dataclass(frozen=True, eq=False)
class DrawPool:
    """What draws are made from, as `calib.studies.workers.Pool`."""

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


def tolerance_draws(
    setting: Setting,
    errors: ErrorModel,
    path: Path,
    *,
    inputs: Mapping[str, Path],
    draws: int,
    seed: int,
    jobs: int,
    dask: str | None,
    resume: bool,
    full: bool = False,
    on_progress: Callable[[int], None] = lambda done: None,
) -> Array:
    """The first draws of a study, those that its file does not have computed.  # (D, C, Q)

    Args:
        setting: what is photographed, and how.
        errors: of the target.
        path: of the study's file, in a folder that is there.
        inputs: the files that were read, by what they are.
        draws: D.
        seed: of all draws.
        jobs: processes on this machine.
        dask: address of a cluster's scheduler, instead.
        resume: go on with a file that is there.
        full: render and detect images, which takes minutes a draw.
        on_progress: told how many are done.

    Raises:
        InputError: the file is there and `resume` is not asked for, or is of another study.
        StudyStoppedError: interrupted, or no workers are left.
    """
    pool = DrawPool(setting, errors, full)
    spec = CaseSpec(Case(CASE, setting.view_count, setting.view_count), pool)
    with open_study(path, identity_of(seed, _settings(setting, errors, full=full), inputs), resume=resume) as study:
        run_cases(
            [spec], study, samples=draws, seed=seed, jobs=jobs, dask=dask, on_progress=on_progress,
            chunk=1 if full else None,
        )  # fmt: skip
        kept = study.load(spec.name)
    return kept.params[:draws].reshape(-1, len(case_names(errors)), len(QUANTITIES))


def _settings(setting: Setting, errors: ErrorModel, *, full: bool) -> dict[str, str]:
    """What decides a draw beside the seed."""
    amounts = [f"{name}={amount.kind} {amount.size!r}" for name, amount in errors.amounts]
    return {
        "study": KIND,
        "images": "yes" if full else "no",
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
