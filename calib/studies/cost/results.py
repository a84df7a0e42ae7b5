"""What the study says: each cost against the image's, and how many starts it stands.

Costs are compared on the same sightings: of a measure's errors e in N sets the mean of log(e / e_image) is told as a
ratio, with Student's interval of the mean.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np

from calib.solver.costs import COSTS, IMAGE
from calib.studies.compare.cases import Group
from calib.studies.cost.cases import STARTS, CostPlan
from calib.studies.cost.errors import ESTIMATORS
from calib.studies.cost.photographed import MEASURES
from calib.studies.store import Study
from calib.studies.stored_samples import Samples
from designer.base.arrays import Array
from designer.base.marks import Gap

UNITS: Mapping[str, str] = MappingProxyType({name: name.rpartition("_")[2] for name in MEASURES})
SHARE = 0.99
"""Of the intervals: of hundreds of comparisons one in twenty would be called different by chance."""
SAME = 1e-3
"""A ratio nearer to 1 than this is no difference, however sure."""
FEWEST = 3


@dataclass(frozen=True)
class CostRatio:
    """One measure of one cost in a scene, against the distances in the image."""

    scene: str
    condition: str
    cost: str
    measure: str
    unit: str
    median: Gap
    ratio: Gap  # geometric mean of the error over the image's in the same set
    low: Gap  # of the ratio's interval
    high: Gap
    sets: int  # with both errors
    failed: int  # without this one

    @property
    def is_better(self) -> bool:
        """Surely less than the image's."""
        return self.high < 1 and self.ratio < 1 - SAME

    @property
    def is_worse(self) -> bool:
        """Surely more."""
        return self.low > 1 and self.ratio > 1 + SAME


@dataclass(frozen=True)
class StartRow:
    """How many bad starts of a scene lead a cost to its least value."""

    scene: str
    cost: str
    starts: int
    reached: int
    only_this: int  # from so many it does and the image does not
    only_image: int
    steps: Gap  # median of those that do

    @property
    def share(self) -> float:
        """Of the starts; nan without any."""
        return self.reached / self.starts if self.starts else math.nan


@dataclass(frozen=True)
class CostTable:
    """All that the study says."""

    plan: CostPlan
    cases: tuple[CostRatio, ...]
    starts: tuple[StartRow, ...]

    def compared(self, cost: str) -> tuple[CostRatio, ...]:
        """The rows of a cost that can be compared."""
        return tuple(one for one in self.cases if one.cost == cost and math.isfinite(one.high - one.low))

    @property
    def costs(self) -> tuple[str, ...]:
        """All that were compared with the image's, in their order."""
        return tuple(dict.fromkeys(one.cost for one in self.cases if one.cost != IMAGE))

    @property
    def keys(self) -> tuple[tuple[str, str], ...]:
        """Scenes and conditions, in their order."""
        return tuple(dict.fromkeys((one.scene, one.condition) for one in self.cases))

    def of(self, scene: str, condition: str, cost: str, measure: str) -> CostRatio | None:
        """A row that has a number; None if there is none."""
        key = (scene, condition, cost, measure)
        found = (one for one in self.cases if (one.scene, one.condition, one.cost, one.measure) == key)
        return next((one for one in found if math.isfinite(one.median)), None)


def table_of(study: Study, plan: CostPlan, groups: Sequence[Group]) -> CostTable:
    """The table of all samples that a study has."""
    known = {one.case.name for one in study.cases()}
    cases: list[CostRatio] = []
    starts: list[StartRow] = []
    for spec in (spec for group in groups for spec in group.specs):
        if spec.name not in known or not len((samples := study.load(spec.name)).number):
            continue
        if spec.case.sampling == STARTS:
            starts += start_rows(samples, spec.case.target)
        else:
            cases += cost_rows(samples, spec.case.target, spec.case.sampling)
    return CostTable(plan, tuple(cases), tuple(starts))


def cost_rows(samples: Samples, scene: str, condition: str) -> list[CostRatio]:
    """The rows of a case; without the measures that it does not have."""
    values = samples.params.reshape(len(samples.number), len(ESTIMATORS), len(MEASURES))
    return [
        _cost_row(values[:, 0, k], values[:, row, k], (scene, condition, one.name, measure))
        for row, one in enumerate(ESTIMATORS)
        for k, measure in enumerate(MEASURES)
        if np.isfinite(values[:, :, k]).any()
    ]


def _cost_row(image: Array, values: Array, key: tuple[str, str, str, str]) -> CostRatio:
    from scipy.stats import t as student

    both = np.isfinite(image) & np.isfinite(values)
    count, failed = int(both.sum()), int((~np.isfinite(values)).sum())
    median = float(np.median(values[np.isfinite(values)])) if failed < len(values) else math.nan
    ratio = low = high = math.nan
    if count >= FEWEST:
        difference = np.log(values[both]) - np.log(image[both])
        mean = float(difference.mean())
        half = float(student.ppf(0.5 + 0.5 * SHARE, count - 1) * difference.std(ddof=1) / math.sqrt(count))
        ratio, low, high = math.exp(mean), math.exp(mean - half), math.exp(mean + half)
    return CostRatio(*key, UNITS[key[3]], median, ratio, low, high, count, failed)


def start_rows(samples: Samples, scene: str) -> list[StartRow]:
    """The rows of a scene's starts."""
    count, names = len(samples.number), tuple(COSTS)
    reached, steps = samples.params[:, : len(names)] > 0, samples.params[:, len(names) :]
    image = reached[:, names.index(IMAGE)]
    return [
        StartRow(
            scene, name, count, int(reached[:, k].sum()), int((reached[:, k] & ~image).sum()),
            int((image & ~reached[:, k]).sum()),
            float(np.median(steps[reached[:, k], k])) if reached[:, k].any() else math.nan,
        )
        for k, name in enumerate(names)
    ]  # fmt: skip
