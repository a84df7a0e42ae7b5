"""From observations to cameras of several models: what a person asks for, and what came of each model."""

import math
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from calib.cameras import ABILITIES, ANY_LENS, MODELS, models_of_all, models_of_all_wide, solved_models, told_parameters
from calib.cameras.camera import Camera
from calib.core.types import Observations
from calib.metrics.evaluation import Evaluation, evaluate, held_out_px
from calib.solver.accuracy import UndeterminedError
from calib.solver.calibration import Calibration, Capture
from calib.solver.capture_error import with_capture_error
from calib.solver.circles import with_circle_doubt
from calib.solver.costs import COSTS, IMAGE
from calib.solver.options import SolveOptions, tie_parameters
from calib.solver.suited import lens_kind, ruled_out
from calib.solver.target_error import with_target_error
from calib.verdict.lit_part import lit_part
from calib.verdict.reading import unit_doubt
from calib.virtual.calibrate import calibrate
from designer.base.errors import InputError
from designer.base.words import several, shown, suggestion

if TYPE_CHECKING:
    from calib.renderer.truth import Truth
    from calib.virtual.solve_virtual import Reference
    from designer.tolerance.made import Made

ALL = "all"
MAX_FOCAL_PX = 1e7
LEAST_COMPARED = 2
_ASSIGNMENT = re.compile(r"\s*([A-Za-z0-9_]+)\s*(?:=\s*(\S+)\s*)?")
_FOCAL = re.compile(r"\s*([0-9.eE+]{1,30})\s*(px)?\s*")


@dataclass(frozen=True)
class SolvePlan:
    """The models to solve, each with its options."""

    models: tuple[str, ...]
    options: SolveOptions  # with the names of every model asked for
    wide_models: tuple[str, ...] = ()  # that are solved instead where the lens is a wide one
    is_compared: bool = False  # by photos held out

    @property
    def may_solve(self) -> tuple[str, ...]:
        """All models that may be solved, whatever the lens."""
        return _any_of(self.models, self.wide_models)

    def suited(self, observations: Observations) -> tuple["SolvePlan", Observations]:
        """The plan for the lens that was photographed, and the observations with a word on it if it is a wide one."""
        if not self.wide_models:
            return self, observations
        kind = lens_kind(observations, self.options)
        if not kind.is_wide:
            return self, observations
        models = tuple(model for model in self.wide_models if kind.may_show(model))
        said = f"{kind.sentence}: solved as {', '.join(models)}, not as {', '.join(self.models)}"
        plan = replace(self, models=models, wide_models=(), is_compared=True)
        return plan, replace(observations, remarks=(*observations.remarks, said))

    def options_of(self, model: str) -> SolveOptions:
        """The options without the parameters that this model does not have."""
        names = {parameter.name for parameter in told_parameters(model)}
        return replace(
            self.options,
            fixed=tuple(pair for pair in self.options.fixed if pair[0] in names),
            shared=tuple(group for group in self.options.shared if all(name in names for name in group)),
        )


def plan_from_words(
    model: str,
    *,
    fix: Sequence[str],
    share: Sequence[str],
    focal_px: float | None,
    loss: str,
    reject: float | None,
    weighted: bool,
    minimise: str = IMAGE,
    free_bend: bool = False,
) -> SolvePlan:
    """What to solve, and how.

    Args:
        model: a model's name, or `all`.
        fix: parameters to keep: `k3`, or `k3=0`.
        share: parameters that have one value: `fx_px,fy_px`.
        focal_px: a first guess of the focal length.
        loss: squares, huber or cauchy.
        reject: leave out what is farther off than so many robust standard deviations.
        weighted: by the covariances of the observations.
        minimise: distances in the image, or others of `calib.solver.costs.COSTS`.
        free_bend: of a flat target, as an unknown.

    Raises:
        InputError: a word that means nothing; the message says what may stand there.
    """
    from calib.renderer.quantities import number

    fix, share = several("--fix", fix), several("--share", share)
    models, wide = _told_models(str(model))
    choices = ", ".join(solved_models())
    for name in models:
        if name in MODELS and name not in solved_models():
            raise InputError(f"--model {name}: photos are simulated with it, not solved; give {choices} or {ALL}")
        if name not in MODELS:
            hint = suggestion(name, [*solved_models(), ALL]) or f"; there are {choices} and {ALL}"
            raise InputError(f"--model {name!r}: no such model{hint}")
    reject = None if reject is None else number("--reject", reject)
    if reject is not None and not 1 <= reject < float("inf"):
        raise InputError(f"--reject {reject:g}: give 1 or more standard deviations, such as 4")
    if loss not in ("squares", "huber", "cauchy"):
        raise InputError(f"--loss {loss!r}: it must be squares, huber or cauchy")
    known = {parameter.name for one in models for parameter in told_parameters(one)}
    fixed = tuple(_fixed(text, known) for text in fix)
    shared = tuple(_shared(text, known) for text in share)
    options = SolveOptions(
        weighted=weighted,
        loss="huber" if loss == "huber" else "cauchy" if loss == "cauchy" else "squares",
        reject_sigma=reject,
        fixed=fixed,
        shared=shared,
        focal_px=None if focal_px is None else _focal_px(number("--focal", focal_px)),
        minimise=cost_of(minimise),
        free_bend=bool(free_bend),
    )
    plan = SolvePlan(models, options, wide)
    for name in (*models, *wide):
        tie_parameters(name, plan.options_of(name))  # refuses what cannot be together, before any work is done
    return plan


def cost_of(minimise: str) -> str:
    """What is minimised, as a person names it.

    Raises:
        InputError: nothing is called so.
    """
    if minimise not in COSTS:
        hint = suggestion(str(minimise), list(COSTS)) or f"; there are {', '.join(COSTS)}"
        raise InputError(f"--minimise {shown(str(minimise))}: nothing that is minimised{hint}")
    return minimise


def models_of(model: str) -> tuple[str, ...]:
    """The models that may be solved for a name: itself, or of `all` those of ordinary lenses and of wide ones."""
    return _any_of(*_told_models(model))


def _told_models(model: str) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """The models that a name means, of ordinary lenses (or whatever the lens) and of wide ones."""
    return (models_of_all(), models_of_all_wide()) if model == ALL else ((model,), ())


def _any_of(models: tuple[str, ...], wide_models: tuple[str, ...]) -> tuple[str, ...]:
    """The models that may be solved, whatever the lens."""
    return (*models, *wide_models, ANY_LENS) if wide_models else models


def _fixed(text: str, known: set[str]) -> tuple[str, float | None]:
    match = _ASSIGNMENT.fullmatch(text)
    if match is None:
        raise InputError(f"--fix {text!r}: name a parameter, such as k3, or give it a value, such as k3=0")
    _require_known(match[1], known, "--fix")
    if match[2] is None:
        return match[1], None
    try:
        value = float(match[2])
    except ValueError:
        value = float("nan")
    if not abs(value) < float("inf"):
        raise InputError(f"--fix {text!r}: {match[2]!r} is no finite number; write it as in k3=0")
    return match[1], value


def _shared(text: str, known: set[str]) -> tuple[str, ...]:
    names = tuple(name.strip() for name in text.split(","))
    for name in names:
        _require_known(name, known, "--share")
    return names


def _require_known(name: str, known: set[str], option: str) -> None:
    if name not in known:
        hint = suggestion(name, sorted(known)) or f"; there are {', '.join(sorted(known))}"
        raise InputError(f"{option} {name!r}: no such parameter{hint}")


def parse_focal_px(text: str) -> float:
    """A first guess of the focal length as a person writes it, `2500px`.

    Raises:
        InputError: it is none.
    """
    match = _FOCAL.fullmatch(text)
    try:
        return _focal_px(float(match[1]) if match else math.nan)
    except (ValueError, InputError):
        raise InputError(f"--focal {text!r}: give a length in pixels such as 2500px, more than 0") from None


def _focal_px(value: float) -> float:
    if not 0 < value <= MAX_FOCAL_PX:
        raise InputError(f"focal length {value:g} px: give one of more than 0 pixels, such as 2500")
    return value


@dataclass(frozen=True, eq=False)
class Solution:
    """What came of one model: an evaluated calibration, or why there is none."""

    model: str
    evaluation: Evaluation | None
    failure: str = ""
    is_undetermined: bool = False  # what failed had too little to go on
    held_out_px: float | None = None  # left over in photos that it was not solved from; None: not compared so

    def with_held_out(self, left_px: float, said: str) -> "Solution":
        """The solution with what it leaves over in photos held out, and a word on it."""
        if self.evaluation is None:
            return self
        calibration = replace(self.calibration, remarks=(*self.calibration.remarks, said))
        return replace(self, evaluation=replace(self.evaluation, calibration=calibration), held_out_px=left_px)

    @property
    def calibration(self) -> Calibration:
        """The calibration.

        Raises:
            ValueError: there is none.
        """
        if self.evaluation is None:
            raise ValueError(f"{self.model} was not solved: {self.failure}")
        return self.evaluation.calibration

    @property
    def camera(self) -> Camera:
        """The camera."""
        return self.calibration.camera


@dataclass(frozen=True, eq=False)
class SolveTask:
    """What is to be solved, and what is known of where it comes from."""

    observations: Observations
    plan: SolvePlan
    layout_id: str = ""  # of the target; "" for points from elsewhere
    settings: tuple[tuple[str, str], ...] = ()  # names and values as they were given, for the record
    reference: "Reference | None" = None  # the photo that a learned map is of
    truth: "Truth | None" = None  # of rendered photos
    made: "Made | None" = None  # how the target was; None: nobody knows
    capture: Capture | None = None  # how the photos were taken; None: assumed
    photos: tuple[Path, ...] = ()  # that show where the light of a wide lens ends; none: nobody knows

    @cached_property
    def brightest(self) -> NDArray[np.float64] | None:
        """The most light of each part of the image in the photos; None without any."""
        if not self.photos:
            return None
        from calib.observe.image_circle import brightest_of

        return brightest_of(self.photos, self.observations.image_size)


def solve_models(task: SolveTask) -> Iterator[Solution]:
    """Solve each model and evaluate it. One that cannot be solved does not stop the others."""
    solutions = (_solution(task, model) for model in task.plan.models)
    if not task.plan.is_compared:
        yield from solutions
        return
    formulas = list(solutions)
    yield from compared([*formulas, *_beyond_formulas(task, formulas)], task.plan)


def _beyond_formulas(task: SolveTask, formulas: Sequence[Solution]) -> Iterator[Solution]:
    """The model of any lens, where errors that are fixed in the image are left over by all the others."""
    fields = [one.calibration.image_field for one in formulas if one.evaluation is not None]
    if fields and None not in fields:
        free = _solution(task, ANY_LENS)
        if free.evaluation is not None:  # else it is one more that takes more photos
            yield free


def _solution(task: SolveTask, model: str) -> Solution:
    """A model solved and evaluated, unless the field of view rules it out."""
    options = task.plan.options_of(model)
    try:
        solved = calibrate(task.observations, model, options, task.reference)
    except InputError as error:
        why = ruled_out(model, None, task.observations, options)
        return Solution(model, None, why or str(error), isinstance(error, UndeterminedError) and not why)
    if why := ruled_out(model, solved, task.observations, options):
        return Solution(model, None, why)
    try:
        calibration = with_circle_doubt(with_capture_error(with_target_error(solved, task.made), task.capture))
        calibration = _with_image_circle(calibration, task)
        unit = (doubt,) if (doubt := unit_doubt(calibration)) else ()
        calibration = replace(calibration, remarks=(*calibration.remarks, *unit, *task.observations.remarks))
        return Solution(model, evaluate(calibration, task.truth))
    except InputError as error:
        return Solution(model, None, str(error), isinstance(error, UndeterminedError))


def compared(solutions: Sequence[Solution], plan: SolvePlan) -> Sequence[Solution]:
    """The solutions with what each leaves over in photos that it was not solved from, and a word on it."""
    solved = [one for one in solutions if one.evaluation is not None and one.camera.learned is None]
    if len(solved) < LEAST_COMPARED:
        return solutions
    left_px: dict[str, float] = {}
    for one in solved:
        again = partial(calibrate, model=one.model, options=plan.options_of(one.model))
        try:
            left_px[one.model] = held_out_px(one.calibration, again)
        except InputError:
            return solutions
    kept = min(left_px, key=lambda name: left_px[name])
    parts = ", ".join(f"{name} {px:.3g} px" for name, px in left_px.items())
    said = f"in photos held out of the solution {kept} leaves the least over ({parts}, RMS)"
    if ANY_LENS in left_px:
        said += f"; {ANY_LENS} was solved too, as the others leave errors that are fixed in the image"
    return [one.with_held_out(left_px[one.model], said) if one.model in left_px else one for one in solutions]


def _with_image_circle(calibration: Calibration, task: SolveTask) -> Calibration:
    """With the end of the light, if the lens may be a wide one and there are photos that show it."""
    if not any(ABILITIES[model].is_wide for model in task.plan.models) or task.brightest is None:
        return calibration
    from calib.observe.image_circle import with_image_circle

    found = with_image_circle(calibration.camera, task.brightest)
    camera = found.camera
    if camera.field_rad is not None:  # an observation shows light, too
        farthest_rad = lit_part(replace(calibration, camera=camera)).farthest_rad
        camera = replace(camera, field_rad=min(max(camera.field_rad, 2.001 * farthest_rad), 2 * math.pi))
    remarks = (*calibration.remarks, found.remark) if found.remark else calibration.remarks
    return replace(calibration, camera=camera, remarks=remarks)
