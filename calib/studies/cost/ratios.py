"""All that the study samples: scenes, how their targets and sightings are, and real photos if there are any.

What the study says: each cost against the image's, and how many starts it stands.

Costs are compared on the same sightings: of a measure's errors e in N sets the mean of log(e / e_image) is told as a
ratio, with Student's interval of the mean.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from types import MappingProxyType

import numpy as np

from calib.cameras.camera import camera_or_preset
from calib.core.types import Observations
from calib.solver.costs import COSTS, IMAGE
from calib.solver.problem import Loss
from calib.studies.compare.scene import ComparedScene, make_target, scene_of
from calib.studies.cost.estimates import CONDITIONS, ESTIMATORS, MEASURES, CostPool, RealPool, StartPool
from calib.studies.identity import StudyIdentity, identity_of
from calib.studies.samples import Case, Samples
from calib.studies.store import Study
from calib.studies.workers import CaseSpec
from designer.base.arrays import Array
from designer.base.errors import InputError
from designer.base.marks import Gap
from designer.kinds.presets import preset_or_file
from designer.tolerance.error_file import error_model

VIEWS = 20
CONTRAST_TO_NOISE = 50.0
FARTHEST = 2.0
"""Photos are taken from where the target fills the image to twice as far: ranges that are all alike would hide much."""
MOST_PARTS = 24
"""Of real photos."""
LEAST_PHOTOS = 4
STARTS = "bad starts"
REAL = "photos held out"


@dataclass(frozen=True)
class CostScene:
    """A target before a camera, by the names of their templates."""

    name: str
    template: str
    errors: str  # how the target is made
    camera: str


SETTINGS: tuple[CostScene, ...] = (
    CostScene("board", "3d-board", "fdm-board", "machine-vision"),
    CostScene("icosahedron", "shiny-ico", "fdm-dual", "machine-vision"),
    CostScene("board, wide lens", "3d-board", "fdm-board", "action-camera"),
)


@dataclass(frozen=True)
class CostPlan:
    """How much of the study."""

    sets: int  # of photos of each scene and condition
    starts: int  # of each scene
    seed: int = 1
    photos: str = ""  # name of the real ones; "": none
    model: str = ""  # that they are solved with


@dataclass(frozen=True, eq=False)
class RealPhotos:
    """Photos of a person's own."""

    name: str
    observations: Observations
    model: str


def identity(plan: CostPlan, own: Mapping[str, Path | str] = MappingProxyType({})) -> StudyIdentity:
    """All that a sample depends on beside its case and number, a person's own photos too; sets may be added later."""
    files = dict(own)
    for one in SETTINGS:
        files[f"target {one.template}"] = preset_or_file("targets", one.template)
        files[f"errors {one.errors}"] = preset_or_file("errors", one.errors)
        files[f"camera {one.camera}"] = preset_or_file("cameras", one.camera)
    return identity_of(plan.seed, {"study": "cost", "photos": plan.photos, "model": plan.model}, files)


def scene_named(setting: CostScene) -> ComparedScene:
    """The scene of a setting."""
    scene = scene_of(setting.name, make_target(setting.template), camera_or_preset(setting.camera), VIEWS)
    return replace(scene, contrast_to_noise=CONTRAST_TO_NOISE, farthest=FARTHEST)


def cases_of(plan: CostPlan, real: RealPhotos | None) -> tuple[CaseSpec, ...]:
    """The cases of a plan."""
    own, simulated, starts = list[CaseSpec](), list[CaseSpec](), list[CaseSpec]()
    if real is not None:
        count = real.observations.view_count
        if count < LEAST_PHOTOS:
            raise InputError(f"{real.name}: {count} photos, of which some are held out; give {LEAST_PHOTOS} or more")
        pool = RealPool(real.observations, real.model, min(count, MOST_PARTS))
        own.append(CaseSpec(Case(real.name, count, count, REAL), pool, pool.parts))
    for one in SETTINGS:
        scene = scene_named(one)
        for condition in CONDITIONS:
            is_huber = condition == "outliers, Huber"
            loss: Loss = "huber" if is_huber else "squares"
            errors = error_model(one.errors) if condition == "as made" else None
            photos = CostPool(scene, errors, is_huber or condition == "outliers", loss)
            simulated.append(CaseSpec(Case(one.name, VIEWS, VIEWS, condition), photos, plan.sets))
        starts.append(CaseSpec(Case(one.name, VIEWS, VIEWS, STARTS), StartPool(scene), plan.starts))
    return (*own, *simulated, *starts)


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


def table_of(study: Study, plan: CostPlan) -> CostTable:
    """The table of all samples that a study has."""
    cases, starts = list[CostRatio](), list[StartRow]()
    for samples in study.load_all().values():
        case = samples.case.case
        if case.sampling == STARTS:
            starts += start_rows(samples, case.target)
        else:
            cases += cost_rows(samples, case.target, case.sampling)
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
