"""A target before a camera, and everything that a study of its errors computes, its draws kept in a folder."""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from os import fspath
from types import MappingProxyType

from calib.cameras.camera import Camera
from calib.solver.problem import SolveOptions
from calib.studies.runner import STUDY_FILE, DrawCount, Sampling, Tell, after
from calib.studies.tolerance.budget import budget_row, checked, crossovers, default_vary, largest_allowed, searched
from calib.studies.tolerance.draw import BARE, TOGETHER
from calib.studies.tolerance.first_order import FirstOrder, first_order
from calib.studies.tolerance.predict import Cost, ToleranceTable, control_of, linear_table, table_of_draws
from calib.studies.tolerance.quantities import QUANTITIES, Quantity, Requirement
from calib.studies.tolerance.record import CostRow, Crossovers, PhotographedSetting, ToleranceStudy, nine_digits
from calib.studies.tolerance.seen import view_fit
from calib.studies.tolerance.setting import Setting, make_setting
from calib.studies.tolerance.sizes import FACTORS, Reach, reach_of, sweep_rows, what_if_table
from calib.studies.tolerance.stored import AGAINST_FILE, SWEEPS_FOLDER, DrawPool, kept_draws
from calib.studies.tolerance.what_if import WhatIfTable
from designer.base.arrays import Array
from designer.base.errors import InputError
from designer.base.words import printable
from designer.kinds.layout import Viewpoints, advised_photos
from designer.kinds.presets import preset_names
from designer.target import TargetGeometry, bounding_radius_mm
from designer.tolerance.error_file import error_model
from designer.tolerance.model import ErrorModel
from designer.tolerance.sources import SOURCES

SWEEP_DRAWS = 12


@dataclass(frozen=True, eq=False)
class PhotographedTarget:
    """A target with its errors in front of a camera."""

    name: str
    digest: str  # of its file, which tells a study from another
    setting: Setting
    errors: ErrorModel
    words: PhotographedSetting
    way: str = ""  # what the errors are called without sizes that were set; "": by their name
    ways: Mapping[str, ErrorModel] = field(default_factory=dict)  # others to choose from, by what they are called


@dataclass(frozen=True)
class Photographing:
    """How targets are photographed and calibrated: the same for both that are compared."""

    views: int
    camera: Camera
    camera_name: str
    model: str
    weighted: bool
    seed: int
    aim_offset_mm: float | None  # None: as advised


def photographed(
    geometry: TargetGeometry, name: str, digest: str, errors: str, changes: Sequence[str],
    distance_mm: tuple[float, float] | None, by: Photographing,
) -> PhotographedTarget:  # fmt: skip
    """A target with its errors, and its photos.

    Args:
        geometry: of the target.
        name: what it is called in tables.
        digest: of its file, which tells a study from another.
        errors: an error template, or a TOML file.
        changes: other sizes of single errors: `face_tilt=0.1deg`.
        distance_mm: between which two the cameras stand; None: as the page of a design advises.
        by: the rest.

    Raises:
        InputError: errors or a distance that break a rule.
    """
    made = error_model(errors, changes)
    photos = _photos(geometry, distance_mm, by.aim_offset_mm)
    fit = view_fit(geometry, by.camera, photos.distance_mm[1]).remark
    try:
        setting = make_setting(
            geometry, by.camera, views=by.views, photos=photos, model=by.model, seed=by.seed,
            options=SolveOptions(weighted=by.weighted),
        )  # fmt: skip
    except InputError as error:
        raise InputError(f"{error}{f' ({fit})' if fit else ''}") from None
    advised = " (as its design's page advises)" if photos == advised_photos(geometry) else ""
    photos_words = (
        f"{_count(geometry.face_count, 'face')}, {geometry.ring_count} {geometry.feature_word}; "
        f"{_count(by.views, 'view')} from {range_words(photos.distance_mm)}, looking up to "
        f"{photos.aim_offset_mm:g}mm past the target's middle{advised}, by {by.camera_name}, "
        f"{len(setting.observations.view)} observations; solved: {by.model}{', weighted' if by.weighted else ''}"
    )
    is_nominal, is_solid = geometry.source == "nominal", not geometry.is_planar
    remarks = (
        *([] if is_nominal else [f"the target file is a {geometry.source} one; its shape is taken as the drawing"]),
        *(["layers and axes are those of a print that lies on its last face"] if is_solid else []),
        *setting.remarks,
    )
    words = PhotographedSetting(photos_words, f"{made.name}: {made.title}", remarks, (fit,) if fit else ())
    way = printable(fspath(errors))
    ways = {way: error_model(errors), **templates_for(geometry)}
    return PhotographedTarget(name, digest, setting, made, words, way, ways)


def _photos(target: TargetGeometry, distance_mm: tuple[float, float] | None, aim_offset_mm: float | None) -> Viewpoints:
    """What was asked for, and what was left open as a design's page advises."""
    photos = advised_photos(target, distance_mm)
    photos = photos if aim_offset_mm is None else replace(photos, aim_offset_mm=aim_offset_mm)
    near, far = photos.distance_mm
    inside = bounding_radius_mm(target)
    if not inside + photos.aim_offset_mm < near <= far:
        past = f", and the aim {photos.aim_offset_mm:g}mm" if photos.aim_offset_mm else ""
        raise InputError(
            f"--distance {range_words((near, far))}: the target reaches {inside:.0f}mm from its origin{past}; stay "
            "farther away"
        )
    return photos


def range_words(distance_mm: tuple[float, float]) -> str:
    """`250mm..500mm`, or one of them where both are the same."""
    near, far = distance_mm
    return f"{near:g}mm" if near == far else f"{near:g}mm..{far:g}mm"


def templates_for(target: TargetGeometry) -> dict[str, ErrorModel]:
    """The ways of making that travel with the program and suit a target, by name."""
    models = {name: error_model(name) for name in preset_names("errors")}
    return {name: model for name, model in models.items() if model.suits_target(target)}


def _count(number: int, noun: str) -> str:
    return f"{number} {noun}{'' if number == 1 else 's'}"


@dataclass(frozen=True)
class TolerancePlan:
    """What is computed."""

    draws: int
    seed: int
    requirements: tuple[Requirement, ...]
    by: str  # quantity that errors are ranked by
    full: bool  # with images
    linear: bool  # without draws
    sampling: Sampling

    def tell(self, what: str, total: int) -> Tell:
        """Tells of one kind of work."""
        self.sampling.progress(what, 0, total)
        return lambda done: self.sampling.progress(what, done, total)


@dataclass(frozen=True, eq=False)
class _Exploration:
    """What is predicted of a target, and what its draws say."""

    scene: PhotographedTarget
    plan: TolerancePlan

    @cached_property
    def linear(self) -> ToleranceTable:
        """The prediction."""
        return linear_table(self.scene.setting, self.scene.errors)

    @cached_property
    def first(self) -> FirstOrder:
        """The derivatives."""
        return first_order(self.scene.setting)

    def what_ifs(self) -> WhatIfTable:
        """What other sizes of errors would do."""
        scene, plan = self.scene, self.plan
        plan.sampling.progress(f"what if {scene.name} were made otherwise", 0, 0)
        return what_if_table(scene.setting, scene.errors, scene.way or scene.errors.name, scene.ways, seed=plan.seed)

    def draws(self, file: str, count: int, tell: Tell, factor: float = 1.0) -> tuple[Array, DrawCount]:
        """Draws of all errors (D, C, Q), times a factor, kept in a file of the folder; the missing ones computed."""
        scene, plan = self.scene, self.plan
        errors = scene.errors if factor == 1 else scene.errors.scaled(factor)
        pool = DrawPool(scene.setting, errors, plan.full)
        return kept_draws(plan.sampling, pool, file, {"target": scene.digest}, plan.seed, count, tell)

    def table(self, drawn: Array, factor: float = 1.0) -> ToleranceTable:
        """The table of draws (D, C, Q) of the errors times a factor, held against what is predicted of them."""
        has_noise = not self.plan.full
        control = control_of(
            self.first, self.linear, self.plan.seed, range(len(drawn)), factor=factor, has_noise=has_noise
        )
        return table_of_draws(self.scene.errors.scaled(factor), drawn, control)

    def swept(self, main: Array) -> dict[float, ToleranceTable]:
        """The table of all errors at each multiple; the draws of the amounts themselves are the study's own."""
        count, drawn, done = min(SWEEP_DRAWS, len(main)), {1.0: main}, 0
        tell = self.plan.tell("sweeping", (len(FACTORS) - 1) * count)
        for factor in FACTORS:
            if factor != 1:
                file = f"{SWEEPS_FOLDER}/{factor:g}x.sqlite"
                drawn[factor], _ = self.draws(file, count, after(done, tell), factor)
                done += count
        self.plan.sampling.progress("comparing with the prediction", 0, 0)
        return {factor: self.table(drawn[factor], factor) for factor in FACTORS}

    def reaches(self) -> list[Reach]:
        """How far the prediction holds of each source that has an effect."""
        linear, found = self.linear, list[Reach]()
        names = [name for name, cost in zip(linear.sources, linear.cost.value, strict=True) if (cost > 0).any()]
        tell = self.plan.tell("checking the prediction", len(names))
        for name in names:
            found.append(reach_of(self.first, self.scene.errors, name, linear.baseline.value, seed=self.plan.seed))
            tell(len(found))
        return found

    def told(
        self, table: ToleranceTable, sweeps: Mapping[float, ToleranceTable] = MappingProxyType({}),
        reaches: Sequence[Reach] = (),
    ) -> ToleranceStudy:  # fmt: skip
        """The study of a table; with sweeps, limits are searched with draws where no square law holds."""
        scene, plan = self.scene, self.plan
        budgets = [checked(largest_allowed(table, one), table, self.linear, reaches) for one in plan.requirements]
        total, done = sum(len(one.unchecked) for one in budgets), 0
        if sweeps and total:
            tell = plan.tell("searching limits", total)
            for place, one in enumerate(budgets):
                budgets[place] = searched(one, self.first, scene.errors, plan.seed, plan.draws, after(done, tell))
                done += len(one.unchecked)
        return ToleranceStudy(
            scene.name, scene.words, table.kind, table.draws, table.failed, plan.by,
            tuple(_cost_rows(table, self.linear, reaches)), tuple(budget_row(one, table) for one in budgets),
            sweep_rows(sweeps, self.linear) if sweeps else (), None, dict(scene.errors.notes), self.what_ifs(),
        )  # fmt: skip


def explore(scene: PhotographedTarget, plan: TolerancePlan) -> tuple[ToleranceStudy, ToleranceTable, DrawCount]:
    """Costs, sweeps, how far the prediction holds, and budgets; their table; and what was drawn for them."""
    plan.sampling.progress("predicting", 0, 0)
    one = _Exploration(scene, plan)
    if plan.linear:
        return one.told(one.linear), one.linear, DrawCount()
    drawn, count = one.draws(STUDY_FILE, plan.draws, plan.tell("drawing", plan.draws))
    plan.sampling.progress("comparing with the prediction", 0, 0)
    table = one.table(drawn)
    return (one.told(table) if plan.full else one.told(table, one.swept(drawn), one.reaches())), table, count


def compared(
    study: ToleranceStudy, table: ToleranceTable, other: PhotographedTarget, plan: TolerancePlan, vary: str | None
) -> ToleranceStudy:
    """The study with the other target's costs, and where the first loses to it."""
    plan.sampling.progress("predicting the other", 0, 0)
    one = _Exploration(other, plan)
    theirs = one.linear
    if not plan.linear:
        drawn, _ = one.draws(AGAINST_FILE, plan.draws, plan.tell("drawing the other", plan.draws))
        theirs = one.table(drawn)
    chosen, found = vary or default_vary(table, plan.by), crossovers(table, theirs)
    them = Crossovers(other.name, other.words, other.errors.name, chosen, found, one.what_ifs())
    return replace(study, crossovers=them)


def _cost_rows(table: ToleranceTable, linear: ToleranceTable, reaches: Sequence[Reach]) -> Iterator[CostRow]:
    """For each quantity a row without errors, one for each source, and one for all together."""
    reach = {one.source: one.factor for one in reaches}
    unknown = math.nan

    def of_no_source(error: str, cost: Cost, predicted: Cost, quantity: Quantity) -> CostRow:
        return CostRow(
            error, "", unknown, unknown, "", quantity.name, quantity.unit, *_numbers(cost, predicted), unknown,
            unknown, unknown, unknown, math.inf,
        )  # fmt: skip

    for row, quantity in enumerate(QUANTITIES):
        yield of_no_source(BARE, table.baseline[row], linear.baseline[row], quantity)
        for place, name in enumerate(table.sources):
            amount, sigma, cost = table.errors.amount(name), float(table.sigma[place]), table.cost[place, row]
            by_unit, low, high = (nine_digits(end / sigma) if sigma > 0 else unknown for end in cost.bounds)
            holds_to = sigma * float(reach[name][row]) if name in reach else math.inf
            yield CostRow(
                name, amount.kind, nine_digits(amount.size), nine_digits(sigma), SOURCES[name].unit, quantity.name,
                quantity.unit, *_numbers(cost, linear.cost[place, row]), nine_digits(table.share[place, row]),
                by_unit, low, high, nine_digits(holds_to),
            )  # fmt: skip
        yield of_no_source(TOGETHER, table.together[row], linear.together[row], quantity)


def _numbers(cost: Cost, predicted: Cost) -> tuple[float, float, float, float]:
    value, low, high = map(nine_digits, cost.bounds)
    return value, low, high, nine_digits(float(predicted.value))
