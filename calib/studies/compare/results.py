"""What the samples of a comparison say: medians over sets and prints, and what single errors would explain."""

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from calib.studies.compare.alone import NOISE, TOGETHER
from calib.studies.compare.alone import VALUES as ALONE_VALUES
from calib.studies.compare.cases import ALIKE, ALONE, Comparison
from calib.studies.compare.objects import object_named
from calib.studies.compare.photographed import VALUES, SetsOfPhotos, grouped
from calib.studies.store import Study
from calib.studies.stored_samples import Samples
from designer.tolerance.model import ErrorModel
from designer.tolerance.registry import SOURCES
from designer.tolerance.source import format_quantity

Array = NDArray[np.float64]

METRICS: Mapping[str, str] = MappingProxyType(
    {"intersection": "mm", "reconstruction": "mm", "reprojection": "px", "held_reprojection": "px",
     "held_intersection": "mm", "held_reconstruction": "mm", "held_share": "1", "image_share": "1"}
)  # fmt: skip
"""Name and unit."""
_COLUMN = {"reprojection": 0, "intersection": 1, "reconstruction": 2}
LOW, HIGH = 2.5, 97.5
SPLIT = re.compile(r"([-+.0-9e]+)(.*)")
NEAR = 0.25
"""A source that gives the paper's intersection error explains its reconstruction error if it is as near as this."""
REACH = 10.0
"""An amount of more than so many times the template's is no explanation: it would have been seen."""


@dataclass(frozen=True)
class Middle:
    """The median of the prints' medians, and what 95 % of the prints lie between."""

    median: float
    low: float
    high: float
    prints: int


@dataclass(frozen=True, eq=False)
class CaseResult:
    """One object, part and camera model."""

    name: str  # of the object
    part: str
    model: str
    values: Mapping[str, Array]  # (prints, sets) by metric, in its unit; nan where there is none
    without: int  # samples without a camera
    unsure: int  # samples whose solution did not converge

    def middle(self, metric: str) -> Middle:
        """Over sets, then over prints."""
        table = self.values[metric]
        known = table[np.isfinite(table).any(axis=1)]
        if not len(known):
            return Middle(math.nan, math.nan, math.nan, 0)
        medians = np.nanmedian(known, axis=1)
        low, high = np.percentile(medians, [LOW, HIGH])
        return Middle(float(np.median(medians)), float(low), float(high), len(medians))

    def flat(self, metric: str) -> Array:
        """All sets of all prints that have the error."""
        table = self.values[metric].ravel()
        return table[np.isfinite(table)]


@dataclass(frozen=True)
class Explanation:
    """One source scaled until it gives the paper's intersection error alone; medians over prints."""

    name: str  # of the object
    source: str
    multiple: float  # of the template's amount; nan: no multiple does it
    multiple_low: float
    multiple_high: float
    amount: str  # that it takes, root mean square, with its unit
    reprojection_px: float
    reconstruction_mm: float
    paper_reconstruction_mm: float
    prints: int
    without: int  # prints that no multiple does it for
    why: str  # if none

    @property
    def ratio(self) -> float:
        """The reconstruction error it gives over the paper's."""
        return self.reconstruction_mm / self.paper_reconstruction_mm

    @property
    def fits(self) -> bool:
        """Whether it gives both of the paper's errors."""
        return abs(self.ratio - 1) <= NEAR

    @property
    def is_within_reach(self) -> bool:
        """Whether a print may be so."""
        return self.multiple <= REACH


@dataclass(frozen=True, eq=False)
class Results:
    """All that a comparison says."""

    comparison: Comparison
    cases: tuple[CaseResult, ...]
    explanations: tuple[Explanation, ...]

    def of(self, name: str, part: str, model: str) -> CaseResult | None:
        """A case; None if it has no samples."""
        return next((one for one in self.cases if (one.name, one.part, one.model) == (name, part, model)), None)


def results_of(study: Study, plan: Comparison) -> Results:
    """The results of all samples that a study has."""
    known = {one.case.name for one in study.cases()}
    cases, explanations = [], []
    for group in plan.groups:
        for spec in group.specs:
            if spec.name not in known or not len((samples := study.load(spec.name)).number):
                continue
            if spec.case.sampling == ALONE:
                explanations.append(_explanation(samples, spec.case.target, spec.case.sightings, plan))
            elif isinstance(spec.pool, SetsOfPhotos):
                cases.append(_case_result(samples, spec.case.target, spec.case.sampling, spec.pool))
    return Results(plan, tuple(cases), tuple(explanations))


def _case_result(samples: Samples, name: str, part: str, pool: SetsOfPhotos) -> CaseResult:
    numbers = samples.number.tolist()
    columns = {metric: samples.metrics[:, column] for metric, column in _COLUMN.items()}
    columns |= {value.removesuffix("_px").removesuffix("_mm"): samples.params[:, k] for k, value in enumerate(VALUES)}
    values = {metric: grouped(columns[metric], numbers, pool.sets) for metric in METRICS}
    statuses = samples.status.tolist()
    return CaseResult(
        name, part, pool.camera_model, values, statuses.count("failed"),
        sum(status in ("stopped", "degenerate") for status in statuses),
    )  # fmt: skip


def _explanation(samples: Samples, name: str, source: str, plan: Comparison) -> Explanation:
    met = samples.status == "converged"
    multiple = samples.params[met, ALONE_VALUES.index("multiple")]
    middle, low, high = np.percentile(multiple, [50, LOW, HIGH]).tolist() if met.any() else (math.nan,) * 3
    reprojection, reconstruction = (
        float(np.median(samples.metrics[met, _COLUMN[metric]])) if met.any() else math.nan
        for metric in ("reprojection", "reconstruction")
    )
    return Explanation(
        name, source, middle, low, high, _amount(plan.errors[name], source, middle), reprojection, reconstruction,
        object_named(name).reconstruction_mm, int(met.sum()), int((~met).sum()),
        next((message for message in samples.message if message), ""),
    )  # fmt: skip


def _amount(errors: ErrorModel, source: str, multiple: float) -> str:
    """How large the source is then, to two digits."""
    if not math.isfinite(multiple) or source in (NOISE, TOGETHER):
        return ""
    chosen = "face_offset" if source == ALIKE else source
    number, unit = SPLIT.findall(format_quantity(multiple * errors.amount(chosen).sigma, SOURCES[chosen].unit))[0]
    return f"{short(float(number))}{unit}"


def short(number: float) -> str:
    """To two digits."""
    return f"{float(f'{number:.2g}'):g}"
