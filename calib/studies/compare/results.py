"""The result of a comparison: medians over sets and prints, and single errors."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from types import MappingProxyType

import numpy as np

from calib.studies.compare.cases import ALIKE, ALONE, FIGURE, Comparison, Plan
from calib.studies.compare.photographed import ALONE_VALUES, NOISE, TOGETHER, VALUES, SetsOfPhotos, grouped
from calib.studies.compare.scene import object_named
from calib.studies.store import Study
from calib.studies.stored_samples import Samples
from designer.base.arrays import Array
from designer.base.marks import Gap
from designer.tolerance.model import ErrorModel
from designer.tolerance.source import format_quantity
from designer.tolerance.sources import SOURCES

METRICS: Mapping[str, str] = MappingProxyType(
    {"intersection": "mm", "reconstruction": "mm", "reprojection": "px", "held_reprojection": "px",
     "held_intersection": "mm", "held_reconstruction": "mm", "held_share": "1", "image_share": "1"}
)  # fmt: skip
"""Name and unit."""
_COLUMN = {"reprojection": 0, "intersection": 1, "reconstruction": 2}
LOW, HIGH = 2.5, 97.5
NEAR = 0.25
"""A source that gives the paper's intersection error explains its reconstruction error if it is as near as this."""
REACH = 10.0
"""An amount of more than so many times the template's is no explanation: it would have been seen."""


@dataclass(frozen=True)
class CaseRow:
    """One error of an object, part and camera model: the median of the prints' medians; nan where there is none."""

    object: str
    part: str
    model: str
    metric: str
    unit: str
    median: Gap
    low: Gap  # between this and `high` lie 95 % of the prints
    high: Gap
    prints: int
    samples: int
    without_camera: int
    not_converged: int
    paper: Gap


@dataclass(frozen=True)
class Explanation:
    """One source scaled until it gives the paper's intersection error alone; medians over prints."""

    object: str
    source: str
    multiple: Gap  # of the template's amount; nan: no multiple does it
    multiple_low: Gap
    multiple_high: Gap
    amount: str  # that it takes, root mean square, with its unit
    reconstruction_mm: Gap
    paper_reconstruction_mm: Gap
    reprojection_px: Gap
    prints: int
    without: int  # prints that no multiple does it for
    why: str  # if none

    @property
    def fits(self) -> bool:
        """Whether it gives both of the paper's errors."""
        return abs(self.reconstruction_mm / self.paper_reconstruction_mm - 1) <= NEAR

    @property
    def is_within_reach(self) -> bool:
        """Whether a print may be so."""
        return self.multiple <= REACH


@dataclass(frozen=True)
class ComparisonTable:
    """All that a comparison says."""

    plan: Plan
    distance_mm: dict[str, float]
    cases: tuple[CaseRow, ...]
    alone: tuple[Explanation, ...]

    @cached_property
    def _by_key(self) -> dict[tuple[str, str, str, str], CaseRow]:
        return {(one.object, one.part, one.model, one.metric): one for one in self.cases}

    def of(self, name: str, part: str, model: str, metric: str) -> CaseRow | None:
        """A row that has a number; None if there is none."""
        found = self._by_key.get((name, part, model, metric))
        return None if found is None or math.isnan(found.median) else found

    def median(self, name: str, part: str, model: str, metric: str) -> float:
        """A median; nan if there is none."""
        found = self.of(name, part, model, metric)
        return math.nan if found is None else found.median

    def keys(self, *parts: str) -> tuple[tuple[str, str, str], ...]:
        """Object, part and model of the cases of these parts, part by part."""
        found = dict.fromkeys((one.part, one.object, one.model) for one in self.cases)
        return tuple((name, part, model) for wanted in parts for part, name, model in found if part == wanted)


@dataclass(frozen=True, eq=False)
class CaseResult:
    """The errors of all samples of one object, part and camera model."""

    name: str  # of the object
    part: str
    model: str
    values: Mapping[str, Array]  # (prints, sets) by metric, in its unit; nan where there is none
    without: int  # samples without a camera
    unsure: int  # samples whose solution did not converge

    def row(self, metric: str) -> CaseRow:
        """The median over sets, then over prints."""
        table = self.values[metric]
        known = table[np.isfinite(table).any(axis=1)]
        median = low = high = math.nan
        if len(known):
            medians = np.nanmedian(known, axis=1)
            median, (low, high) = float(np.median(medians)), np.percentile(medians, [LOW, HIGH]).tolist()
        paper = object_named(self.name).median(metric) if self.part == FIGURE else math.nan
        return CaseRow(
            self.name, self.part, self.model, metric, METRICS[metric], median, low, high, len(known),
            len(self.flat(metric)), self.without, self.unsure, paper,
        )  # fmt: skip

    def flat(self, metric: str) -> Array:
        """All sets of all prints that have the error."""
        table = self.values[metric].ravel()
        return table[np.isfinite(table)]


@dataclass(frozen=True, eq=False)
class Results:
    """What a comparison says, and the samples that say it."""

    table: ComparisonTable
    cases: tuple[CaseResult, ...]

    def of(self, name: str, part: str, model: str) -> CaseResult | None:
        """A case; None if it has no samples."""
        return next((one for one in self.cases if (one.name, one.part, one.model) == (name, part, model)), None)


def results_of(study: Study, plan: Comparison) -> Results:
    """The results of all samples that a study has."""
    known = {one.case.name for one in study.cases()}
    cases, alone = [], []
    for group in plan.groups:
        for spec in group.specs:
            if spec.name not in known or not len((samples := study.load(spec.name)).number):
                continue
            if spec.case.sampling == ALONE:
                alone.append(_explanation(samples, spec.case.target, spec.case.sightings, plan))
            elif isinstance(spec.pool, SetsOfPhotos):
                cases.append(_case_result(samples, spec.case.target, spec.case.sampling, spec.pool))
    return tabulated(plan.plan, {name: scene.distance_mm for name, scene in plan.scenes.items()}, cases, alone)


def tabulated(
    plan: Plan, distance_mm: dict[str, float], cases: Sequence[CaseResult], alone: Sequence[Explanation]
) -> Results:
    """The table of cases beside them."""
    rows = tuple(one.row(metric) for one in cases for metric in METRICS)
    return Results(ComparisonTable(plan, distance_mm, rows, tuple(alone)), tuple(cases))


def _case_result(samples: Samples, name: str, part: str, pool: SetsOfPhotos) -> CaseResult:
    numbers = samples.number.tolist()
    columns = {metric: samples.metrics[:, column] for metric, column in _COLUMN.items()}
    columns |= {value.removesuffix("_px").removesuffix("_mm"): samples.params[:, k] for k, value in enumerate(VALUES)}
    values = {metric: grouped(columns[metric], numbers, pool.sets) for metric in METRICS}
    statuses = samples.status.tolist()
    unsure = statuses.count("stopped") + statuses.count("degenerate")
    return CaseResult(name, part, pool.camera_model, values, statuses.count("failed"), unsure)


def _explanation(samples: Samples, name: str, source: str, plan: Comparison) -> Explanation:
    met = samples.status == "converged"
    multiple = samples.params[met, ALONE_VALUES.index("multiple")]
    middle, low, high = np.percentile(multiple, [50, LOW, HIGH]).tolist() if met.any() else (math.nan,) * 3
    reprojection, reconstruction = (
        float(np.median(samples.metrics[met, _COLUMN[metric]])) if met.any() else math.nan
        for metric in ("reprojection", "reconstruction")
    )
    return Explanation(
        name, source, middle, low, high, _amount(plan.errors[name], source, middle), reconstruction,
        object_named(name).reconstruction_mm, reprojection, int(met.sum()), int((~met).sum()),
        next((message for message in samples.message if message), ""),
    )  # fmt: skip


def _amount(errors: ErrorModel, source: str, multiple: float) -> str:
    """How large the source is then, to two digits."""
    if not math.isfinite(multiple) or source in (NOISE, TOGETHER):
        return ""
    chosen = "face_offset" if source == ALIKE else source
    size, unit = multiple * errors.amount(chosen).sigma, SOURCES[chosen].unit
    rounded = math.radians(float(short(math.degrees(size)))) if unit == "rad" else float(short(size))
    return format_quantity(rounded, unit)


def short(number: float) -> str:
    """To two digits."""
    return f"{float(f'{number:.2g}'):g}"
