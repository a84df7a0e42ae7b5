"""All that a comparison samples: the paper's figure, the lens that no Brown model fits, and single errors scaled.

The result of a comparison: medians over sets and prints, and single errors.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from types import MappingProxyType
from typing import Annotated

import numpy as np

from calib.cameras import parameter_names
from calib.cameras.camera import Camera, camera_or_preset
from calib.studies.compare.prints import (
    ALL_PHOTOS,
    ALONE_VALUES,
    NOISE,
    TOGETHER,
    VALUES,
    OneSource,
    SetsOfPhotos,
    grouped,
)
from calib.studies.compare.scene import (
    MODELS,
    OBJECTS,
    SETS,
    VIRTUAL,
    ComparedScene,
    PaperObject,
    make_target,
    object_named,
    scene_of,
)
from calib.studies.identity import StudyIdentity, identity_of
from calib.studies.samples import Case, Samples
from calib.studies.store import Study
from calib.studies.workers import CaseSpec
from designer.base.arrays import Array
from designer.base.errors import InputError
from designer.base.marks import Gap, Key
from designer.kinds.presets import preset_or_file
from designer.tolerance.error_file import error_model
from designer.tolerance.model import ErrorModel
from designer.tolerance.source import Amount, format_quantity
from designer.tolerance.sources import SOURCES

CAMERA = "phase-one-ixg"
LENS = "phase-one-spline"
LENS_OBJECTS = ("AluBoard", "ShinyIco")
SLOW = (VIRTUAL, ALL_PHOTOS)
"""Models of which fewer sets of a print are solved."""
FIGURE, LENS_DRAWN, LENS_MADE, PLAIN_DRAWN, ALONE = "figure", "spline, as drawn", "spline", "plain, as drawn", "alone"
DRAWN_SETS = 4
"""Of objects as drawn, which hardly differ."""
QUICK, ALONE_PRINTS = 2, 6
"""Prints and sets that are enough to see which way it goes; prints for each source alone."""
ALIKE = "face_offset, all alike"
WITHOUT_EFFECT = ("scale", "ink_bleed", "thermal")
"""Sources that a calibration with the drawing cannot show: poses take up the scale, and contours keep their centres."""


@dataclass(frozen=True)
class Plan:
    """How much of the comparison."""

    camera: str  # template or file, of the paper's figure
    prints: int
    sets: int = SETS  # of photos of each print
    slow_sets: Annotated[int, Key("virtual_sets")] = 1  # of them, solved with the models that are slow
    alone: int = ALONE_PRINTS  # prints for each source alone
    seed: int = 1


@dataclass(frozen=True, eq=False)
class Comparison:
    """All cases of a plan."""

    plan: Plan
    scenes: Mapping[str, ComparedScene]  # of the figure, by object
    errors: Mapping[str, ErrorModel]  # by object
    cases: tuple[CaseSpec, ...]


def identity(plan: Plan) -> StudyIdentity:
    """All that a sample depends on beside its case and number: prints may be added later, sets may not."""
    settings = {"study": "compare", "sets": str(plan.sets), "virtual sets": str(plan.slow_sets)}
    files = {"camera": _camera_file(plan.camera), "lens": _camera_file(LENS), "plain camera": _camera_file(CAMERA)}
    for one in OBJECTS:
        files[f"target {one.template}"] = preset_or_file("targets", one.template)
        files[f"errors {one.errors}"] = preset_or_file("errors", one.errors)
    return identity_of(plan.seed, settings, files)


def _camera_file(name: str) -> Path:
    return Path(name) if Path(name).suffix.lower() == ".json" else preset_or_file("cameras", name)


def comparison(plan: Plan) -> Comparison:
    """The cases of a plan.

    Raises:
        InputError: a camera that cannot be used; the message says why.
    """
    camera = usable_camera(plan.camera)
    scenes = {one.name: scene_of(one.name, make_target(one.template), camera, one.views) for one in OBJECTS}
    errors = {one.name: error_model(one.errors) for one in OBJECTS}
    lens, plain = camera_or_preset(LENS), camera_or_preset(CAMERA)
    fast, slow, drawn = list[CaseSpec](), list[CaseSpec](), list[CaseSpec]()

    def add_made(one: PaperObject, part: str, scene: ComparedScene, model: str) -> None:
        cases, sets = (slow, plan.slow_sets) if model in SLOW else (fast, plan.sets)
        cases.append(_spec(one, part, SetsOfPhotos(scene, errors[one.name], model, sets), plan.prints * sets))

    for one in OBJECTS:
        for model in MODELS:
            add_made(one, FIGURE, scenes[one.name], model)
    for name in LENS_OBJECTS:
        one, scene = object_named(name), scenes[name]
        for model in (*MODELS, ALL_PHOTOS) if scene.target.is_planar else MODELS:
            through, without = (scene_of(name, scene.target, other, scene.views) for other in (lens, plain))
            add_made(one, LENS_MADE, through, model)
            drawn += [
                _spec(one, part, SetsOfPhotos(other, None, model, plan.sets), min(plan.sets, DRAWN_SETS))
                for part, other in ((LENS_DRAWN, through), (PLAIN_DRAWN, without))
            ]
    alone = _alone_specs(scenes, errors, plan.alone)
    return Comparison(plan, scenes, errors, (*fast, *alone, *drawn, *slow))


def usable_camera(name: str) -> Camera:
    """The camera of the figure."""
    camera = camera_or_preset(name)
    if camera.learned is not None or parameter_names(camera.model)[:2] != ("fx_px", "fy_px"):
        raise InputError(
            f"{name}: model {camera.model} has no lens to photograph with; give one of model {' or '.join(MODELS[:2])}"
        )
    return camera


def _spec(one: PaperObject, part: str, pool: SetsOfPhotos, samples: int) -> CaseSpec:
    return CaseSpec(Case(one.name, pool.view_count, pool.view_count, part, pool.camera_model), pool, samples)


def _alone_specs(
    scenes: Mapping[str, ComparedScene], errors: Mapping[str, ErrorModel], samples: int
) -> tuple[CaseSpec, ...]:
    """A case for each source that may explain one of the paper's medians."""
    specs = []
    for one in OBJECTS:
        if not one.is_known:
            continue
        scene, model = scenes[one.name], errors[one.name]
        for label, errors_of, source in _candidates(model):
            pool = OneSource(scene, errors_of, source, one.intersection_mm)
            specs.append(CaseSpec(Case(one.name, scene.views, scene.views, ALONE, label), pool, samples))
    return tuple(specs)


def _candidates(model: ErrorModel) -> list[tuple[str, ErrorModel, str]]:
    """What may explain a median: its label, the errors, and the source that is scaled."""
    found = [(name, model, name) for name in model.sources if name not in WITHOUT_EFFECT]
    if "face_offset" in model.sources:
        alike = model.with_amount("face_offset", Amount("fixed", model.amount("face_offset").sigma))
        found.append((ALIKE, alike, "face_offset"))
    return [*found, (TOGETHER, model, TOGETHER), (NOISE, model, NOISE)]


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
    kept, cases, alone = study.load_all(), [], []
    for spec in plan.cases:
        samples = kept.get(spec.name)
        if samples is not None and spec.case.sampling == ALONE:
            alone.append(_explanation(samples, spec.case.target, spec.case.sightings, plan))
        elif samples is not None and isinstance(spec.pool, SetsOfPhotos):
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
