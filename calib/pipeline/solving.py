"""From observations to cameras of several models: what a person asks for, and what came of each model."""

import math
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

from calib.cameras import MODELS, learned_models, models_of_all, parameter_names, solved_models
from calib.cameras.camera import Camera
from calib.core.types import Observations
from calib.metrics.errors import summarise
from calib.metrics.evaluation import Evaluation, evaluate
from calib.observe.truth import Truth
from calib.solver.accuracy import UndeterminedError
from calib.solver.calibration import Calibration
from calib.solver.image_field import with_image_field
from calib.solver.options import SolveOptions, tie_parameters
from calib.solver.solve import solve
from calib.solver.target_error import with_target_error
from calib.virtual.solve_virtual import Reference, on_plane_mm, solve_virtual
from designer.base.errors import InputError
from designer.base.words import suggestion
from designer.target import TargetGeometry
from designer.tolerance.made import MEASURED, Made
from designer.tolerance.prior import ShapePrior, measured_prior, shape_prior

ALL = "all"
MAX_FOCAL_PX = 1e7
_ASSIGNMENT = re.compile(r"\s*([A-Za-z0-9_]+)\s*(?:=\s*(\S+)\s*)?")
_FOCAL = re.compile(r"\s*([0-9.eE+]{1,30})\s*(px)?\s*")


@dataclass(frozen=True)
class SolvePlan:
    """The models to solve, each with its options."""

    models: tuple[str, ...]
    options: SolveOptions  # with the names of every model asked for

    def options_of(self, model: str) -> SolveOptions:
        """The options without the parameters that this model does not have."""
        names = parameter_names(model)
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

    Raises:
        InputError: a word that means nothing; the message says what may stand there.
    """
    fix, share = ((words,) if isinstance(words, str) else words for words in (fix, share))
    models = models_of_all() if model == ALL else (model,)
    choices = ", ".join(solved_models())
    for name in models:
        if name in MODELS and name not in solved_models():
            raise InputError(f"--model {name}: photos are simulated with it, not solved; give {choices} or {ALL}")
        if name not in MODELS:
            hint = suggestion(name, [*solved_models(), ALL]) or f"; there are {choices} and {ALL}"
            raise InputError(f"--model {name!r}: no such model{hint}")
    if reject is not None and not 1 <= reject < float("inf"):
        raise InputError(f"--reject {reject:g}: give 1 or more standard deviations, such as 4")
    if loss not in ("squares", "huber", "cauchy"):
        raise InputError(f"--loss {loss!r}: it must be squares, huber or cauchy")
    known = {name for one in models for name in parameter_names(one)}
    fixed = tuple(_fixed(text, known) for text in fix)
    shared = tuple(_shared(text, known) for text in share)
    options = SolveOptions(
        weighted=weighted,
        loss="huber" if loss == "huber" else "cauchy" if loss == "cauchy" else "squares",
        reject_sigma=reject,
        fixed=fixed,
        shared=shared,
        focal_px=None if focal_px is None else _focal_px(focal_px),
    )
    plan = SolvePlan(models, options)
    for name in models:
        tie_parameters(name, plan.options_of(name))  # refuses what cannot be together, before any work is done
    return plan


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


ALL_VIEWS = "all"
"""As the reference: the map is learned from all views."""


def calibrate(
    observations: Observations, model: str, options: SolveOptions, reference: Reference | None = None
) -> Calibration:
    """Solve a camera of any model.

    Args:
        observations: what was seen.
        model: its name.
        options: weights, losses, fixed and shared parameters.
        reference: the photo that a learned map is of, or `ALL_VIEWS`; only models with one heed it.

    Raises:
        InputError: the observations or the options do not do.
    """
    if model not in learned_models():
        return solve(observations, model, options)
    if reference == ALL_VIEWS:
        return solve_virtual(observations, options, all_views=True)
    if options.fixed and (reference is not None or on_plane_mm(observations.points, observations.point) is not None):
        raise InputError(
            f"{options.fixed[0][0]} cannot be fixed: the sensor of a map learned from a photo has a focal length and a "
            "centre of its own; learn the map from all views, with --reference all"
        )
    return solve_virtual(observations, options, reference)


def prior_of(calibration: Calibration, target: TargetGeometry | None) -> ShapePrior | None:
    """The prior that a calibration was given for its target; None if it was given none, or does not tell it."""
    error = calibration.target_error
    if target is None or error is None or not error.param_covariance.any():
        return None
    if error.made == MEASURED:
        return measured_prior(target)
    return None if error.errors is None else shape_prior(target, error.errors)


def with_made(calibration: Calibration, made: Made | None) -> Calibration:
    """The calibration with what its target may be off; as it was if nobody knows how that was made."""
    if made is None:
        return calibration
    return with_target_error(calibration, made.prior, made=made.name, because=made.because, errors=made.errors)


@dataclass(frozen=True, eq=False)
class Solution:
    """What came of one model: an evaluated calibration, or why there is none."""

    model: str
    evaluation: Evaluation | None
    failure: str = ""
    is_undetermined: bool = False  # what failed had too little to go on

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
    reference: Reference | None = None  # the photo that a learned map is of
    truth: Truth | None = None  # of rendered photos
    made: Made | None = None  # how the target was; None: nobody knows


def preference(evaluation: Evaluation) -> tuple[bool, bool, float]:
    """The order in which cameras of the same photos are recommended, the best first.

    It is determined, of a model that other programs know, and then with the least left over: what a learned map leaves
    over is small because it bends to the very photos it is judged by.
    """
    calibration, errors = evaluation.calibration, evaluation.of("reprojection")
    left_px = math.inf if errors is None else summarise(errors).rmse
    return calibration.status != "converged", calibration.camera.learned is not None, left_px


def solve_models(task: SolveTask) -> Iterator[Solution]:
    """Solve each model and evaluate it. One that cannot be solved does not stop the others."""
    for model in task.plan.models:
        try:
            solved = calibrate(task.observations, model, task.plan.options_of(model), task.reference)
            calibration = with_image_field(with_made(solved, task.made))
            calibration = replace(calibration, remarks=(*calibration.remarks, *task.observations.remarks))
            yield Solution(model, evaluate(calibration, task.truth))
        except InputError as error:
            yield Solution(model, None, str(error), isinstance(error, UndeterminedError))
