"""The result of a bootstrap study: errors, parameters, and what holds."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated

import numpy as np

from calib.cameras import MODELS, told_parameters
from calib.studies.findings import HeldClaim, findings
from calib.studies.samples import Case, Setting
from calib.studies.statistics import METRICS, CaseSummary, Correlations, Metric, SampleArrays, correlations, summarise
from calib.studies.store import Study
from designer.base.arrays import Array
from designer.base.errors import InputError
from designer.base.marks import INLINE, Gap
from designer.base.words import shown

DRAWN_BY = {
    "tolerance": "design tolerance", "rig tolerance": "design tolerance --rig", "compare": "calib study compare",
    "cost": "calib study cost", "rig bootstrap": "calib study bootstrap --rig",
}  # fmt: skip
"""Studies of other values than a camera's parameters, by the name of these."""
FEWEST = 3
"""Converged samples that have a spread."""


@dataclass(frozen=True)
class SpreadParameter:
    """One of the camera's parameters in the converged samples of a case."""

    name: str
    unit: str  # "" for a number without one
    mean: Gap
    sigma: Gap
    stated: Gap  # standard deviation that the one solution of all views states


@dataclass(frozen=True)
class StrongestTie:
    """The two parameters that go together most."""

    first: str
    second: str
    correlation: Gap


@dataclass(frozen=True)
class CameraSpread:
    """How the camera of a case scatters."""

    case: Annotated[Case, INLINE]
    converged: int
    parameters: tuple[SpreadParameter, ...]
    strongest: StrongestTie | None  # None: no two vary


@dataclass(frozen=True)
class StudyTable:
    """All of it."""

    cases: tuple[CaseSummary, ...]
    cameras: tuple[CameraSpread, ...]  # of the cases that have enough converged samples
    findings: tuple[HeldClaim, ...]

    @property
    def targets(self) -> tuple[str, ...]:
        """In the order of the cases."""
        return tuple(dict.fromkeys(one.case.target for one in self.cases))

    @property
    def sizes(self) -> tuple[int, ...]:
        """Numbers of views, the smallest first."""
        return tuple(sorted({one.case.size for one in self.cases}))

    @property
    def settings(self) -> tuple[Setting, ...]:
        """The ways of sampling and counting, in the order of the cases."""
        return tuple(dict.fromkeys(one.case.setting for one in self.cases))

    @property
    def metrics(self) -> tuple[Metric, ...]:
        """The errors that any case has, in the order of the paper's table."""
        return tuple(metric for metric in METRICS if any(one.of(metric.name).count for one in self.cases))

    @property
    def is_compared(self) -> bool:
        """Whether findings of the paper are among its findings, and not only how sigma falls."""
        return any(one.about == "comparison" for one in self.findings)

    def case(self, target: str, size: int, setting: Setting) -> CaseSummary | None:
        """A case; None if there is none."""
        wanted = target, size, setting
        return next((one for one in self.cases if (one.case.target, one.case.size, one.case.setting) == wanted), None)

    def camera(self, case: Case) -> CameraSpread | None:
        """The spread of a case's camera; None if it has none."""
        return next((one for one in self.cameras if one.case == case), None)


@dataclass(frozen=True, eq=False)
class StudyCases:
    """The samples of a study, of one camera model."""

    model: str
    samples: Mapping[Case, SampleArrays]
    covariance: Mapping[tuple[str, str, str], Array]  # (P, P) in the solution of all views of a pool; or (0, 0)

    @property
    def names(self) -> tuple[str, ...]:
        """Of the camera's parameters.  # (P,)"""
        return tuple(one.name for one in told_parameters(self.model))

    def together(self, case: Case) -> Correlations:
        """The correlations of the parameters in a case's samples."""
        return correlations(self.samples[case], self.names)


def cases_of(study: Study) -> StudyCases:
    """The samples that a study has, finished or not.

    Raises:
        InputError: it has none, they are of other values than a camera's, or its file is damaged.
    """
    stored = study.cases()
    samples = {one.case.case: one for one in study.load_all().values()}
    if not samples:
        raise InputError(f"{study.path}: holds no samples yet; run the study again with --resume")
    models = {one.model for one in stored}
    for name, command in DRAWN_BY.items():
        if name in models:
            raise InputError(
                f"{study.path}: made by {command}, which draws it again with --resume and the same options"
            )
    count = len(MODELS[next(iter(models))].parameters) if models <= MODELS.keys() else -1
    if len(models) > 1 or any(one.params != count for one in stored):
        raise InputError(
            f"{study.path}: of models this program does not know: {', '.join(map(shown, sorted(models)))}; "
            "use the version that made it"
        )
    return StudyCases(models.pop(), samples, {one.case.pool_key: one.covariance for one in stored})


def study_table(cases: StudyCases) -> StudyTable:
    """What samples say."""
    summaries = tuple(summarise(case, samples) for case, samples in cases.samples.items())
    spreads = (_camera_spread(cases, case) for case in cases.samples)
    return StudyTable(summaries, tuple(one for one in spreads if one is not None), findings(summaries))


def _camera_spread(cases: StudyCases, case: Case) -> CameraSpread | None:
    samples = cases.samples[case]
    is_good = (np.asarray(samples.status, dtype=np.str_) == "converged") & np.isfinite(samples.params).all(axis=1)
    params = samples.params[is_good]
    if len(params) < FEWEST:
        return None
    covariance = cases.covariance.get(case.pool_key, np.zeros((0, 0)))
    stated = np.sqrt(np.diagonal(covariance)) if len(covariance) else np.full(params.shape[1], np.nan)
    columns: Sequence[Array] = (params.mean(axis=0), params.std(axis=0, ddof=1), stated)
    parameters = tuple(
        SpreadParameter(one.name, "" if one.unit == "1" else one.unit, *map(float, row))
        for one, *row in zip(told_parameters(cases.model), *columns, strict=False)  # they come first
    )
    strongest = cases.together(case).strongest
    return CameraSpread(case, len(params), parameters, None if strongest is None else StrongestTie(*strongest))
