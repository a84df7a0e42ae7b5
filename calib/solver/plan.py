"""What a person asks to be solved, and how: models, what is kept of them, and what is minimised.

Whether photos are of an ordinary lens or of a wide one, by quick solutions of both kinds.
"""

import re
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from numbers import Real
from typing import TYPE_CHECKING

import numpy as np

from calib.cameras import (
    ABILITIES,
    ANY_LENS,
    COMMON,
    DEFAULT,
    MODELS,
    WIDE,
    learned_models,
    models_of_all,
    models_of_all_wide,
    rays,
    solved_models,
    told_parameters,
    wide_models,
)
from calib.cameras.camera import Camera
from calib.core.se3 import angles_between
from calib.core.types import KnownPoints, Observations, keep_sightings
from calib.solver.calibration import LINEAR, Calibration, is_flat
from calib.solver.costs import COSTS, IMAGE
from calib.solver.free_bend import made_bend_mm
from calib.solver.outliers import deviations
from calib.solver.priors import BETWEEN, full_name, prior_from, texts_of
from calib.solver.problem import SolveOptions, pack, select_rows, tie_parameters
from calib.solver.solve import solve
from calib.solver.varying import FOCAL
from designer.base.errors import InputError
from designer.base.units import parse_quantity
from designer.base.words import several, shown, suggestion

if TYPE_CHECKING:
    from designer.tolerance.made import Made

PER_VIEW = 64
"""Observations of a view that are enough to tell the kinds apart."""
KEPT_SHARE = 0.98
"""Of the observations, those with the least residuals: a few wrong ones say nothing of the lens."""
CLEARLY = 1.3
"""Times that residuals are larger where a kind of model does not fit."""
FINE_PX = 1e-3
"""Residuals of perfect data are nothing but rounding."""
LOST_SHARE = 0.005
"""Of the observations, more of which a model that suits does not leave out."""
FORWARD_RAD = np.radians(80.0)
"""Off the axis, to which models of what is in front may reach: the tangent is 5.7 there, and grows without bounds."""
SUSPECT_PX = 1.0
"""Root mean square distance with which a model may squeeze into its field of view what is seen from the side."""
FAR_OFF = 6.0
"""Robust standard deviations: farther off is not what it is taken for."""


@dataclass(frozen=True, eq=False)
class LensKind:
    """What a quick look says of a lens."""

    is_wide: bool  # only models for wide lenses show what was seen
    off_axis_rad: float  # of the outermost observations, by a wide model; nan: none was found
    lost_share: float  # of the observations, that this model leaves out
    wide: Camera | None  # a rough one, of a part of the observations

    @property
    def sentence(self) -> str:
        """Of a wide lens, how wide it is."""
        return f"the lens is a wide one: points are seen up to {np.degrees(self.off_axis_rad):.0f} degrees off its axis"

    def may_show(self, model: str) -> bool:
        """Whether a model reaches so far that it is worth a trial."""
        return ABILITIES[model].is_wide or self.off_axis_rad < FORWARD_RAD


def lens_kind(observations: Observations, options: SolveOptions | None = None) -> LensKind:
    """Whether a lens is a wide one: `lens_kind(observations).is_wide`.

    It is if a wide model determines a camera that shows the points, and each ordinary model leaves points out that
    this one shows, finds none, or leaves residuals that are clearly larger. Which parameters the options fix or share
    is of no account.
    """
    options = replace(
        options or SolveOptions(), fixed=(), shared=(), focal_px=None, priors=(), breathing_mm=None, vary=()
    )
    problem = pack(observations, weighted=False)
    rows = select_rows(problem, np.arange(problem.view_count), PER_VIEW)[1]
    is_kept = np.zeros(len(observations.view), dtype=bool)
    is_kept[rows] = True
    few = keep_sightings(observations, is_kept)
    wide = _solved(few, WIDE, options)
    if wide is None or wide.status != "converged":
        return LensKind(False, np.nan, np.nan, None)
    ordinary = (_solved(few, model, options) for model in (DEFAULT, COMMON))
    is_wide = not any(one is not None and _suits(one, wide, few) for one in ordinary)
    is_near = (deviations(wide.residual_px.T, None) <= FAR_OFF) & ~wide.is_outlier
    off_axis = angles_between(rays(wide.camera, wide.observations.center_px[is_near]), np.array([0.0, 0.0, 1.0]))
    return LensKind(is_wide, float(np.nanmax(off_axis)), _lost_share(wide, few), wide.camera)


def ruled_out(model: str, solved: Calibration | None, observations: Observations, options: SolveOptions) -> str:
    """Why the field of view rules a model out and what to take instead, in a line; "" if it does not."""
    if ABILITIES[model].is_wide:
        return ""
    if solved is not None and _lost_share(solved, observations) <= LOST_SHARE and _left_px(solved) <= SUSPECT_PX:
        return ""
    kind = lens_kind(observations, options)
    if kind.wide is None or not kind.is_wide:
        return ""
    keeps_all = solved is not None and _lost_share(solved, observations) - kind.lost_share <= LOST_SHARE
    if keeps_all and kind.off_axis_rad < 0.5 * np.pi:
        return ""
    return f"model {model} cannot show all that was seen: {kind.sentence}; give --model {' or '.join(wide_models())}"


def _lost_share(solved: Calibration, observations: Observations) -> float:
    """Of the observations, what was left out."""
    return 1 - float((~solved.is_outlier).sum()) / len(observations.view)


def _solved(observations: Observations, model: str, options: SolveOptions) -> Calibration | None:
    try:
        return solve(observations, model, options)
    except InputError:
        return None


def _suits(ordinary: Calibration, wide: Calibration, few: Observations) -> bool:
    """Whether an ordinary model does as well as a wide one: also where photos determine the wide one alone.

    Photos from one side may do so, by what the formula of the wide one supposes, which says nothing of the lens.
    """
    more = _lost_share(ordinary, few) - _lost_share(wide, few)
    return more <= LOST_SHARE and _left_px(ordinary) <= CLEARLY * _left_px(wide) + FINE_PX


def _left_px(calibration: Calibration) -> float:
    """Root mean square distance of most of the observations that count."""
    square = np.sort((calibration.residual_px[~calibration.is_outlier] ** 2).sum(axis=1))
    return float(np.sqrt(square[: max(int(KEPT_SHARE * len(square)), 1)].mean()))


ALL = "all"
MAX_FOCAL_PX = 1e7
_ASSIGNMENT = re.compile(r"\s*([A-Za-z0-9_]+)\s*(?:=\s*(\S+)\s*)?")


@dataclass(frozen=True)
class SolvePlan:
    """The models to solve, each with its options."""

    models: tuple[str, ...]
    options: SolveOptions  # with the names of every model asked for
    wide_models: tuple[str, ...] = ()  # that are solved instead where the lens is a wide one
    is_compared: bool = False  # by photos held out
    is_bent: bool = False  # whether the bend of a target is an unknown, if nobody says
    bend_sigma_mm: tuple[float, float, float, float, float] | None = None  # see `SolveOptions`

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

    def for_target(self, made: "Made | None", points: KnownPoints) -> "SolvePlan":
        """The plan with what is believed of a flat target's bend: an unknown unless it is as exact as photos see."""
        if self.options.free_bend is False or self.options.minimise != IMAGE or not is_flat(points):
            return self
        sigma_mm = made_bend_mm(made, points)
        is_likely = made is None or (made.errors is not None and sigma_mm is not None)
        return replace(self, is_bent=is_likely, bend_sigma_mm=sigma_mm)

    def flat_remark(self, made: "Made | None", points: KnownPoints) -> str:
        """A word on a bend that would be an unknown but for what is minimised; "" of none."""
        minimise = self.options.minimise
        in_image = replace(self, options=replace(self.options, minimise=IMAGE)).for_target(made, points)
        if minimise == IMAGE or not any(in_image.options_of(model).free_bend for model in self.models):
            return ""
        return f"the target is taken to be flat, as --minimise {minimise} does not go with its bend"

    def options_of(self, model: str) -> SolveOptions:
        """The options without the parameters that this model does not have."""
        names = {parameter.name for parameter in told_parameters(model)}
        is_bent = self.options.free_bend
        return replace(
            self.options,
            free_bend=self.is_bent and model not in learned_models() if is_bent is None else is_bent,
            bend_sigma_mm=self.bend_sigma_mm,
            fixed=tuple(pair for pair in self.options.fixed if pair[0] in names),
            shared=tuple(group for group in self.options.shared if all(name in names for name in group)),
            priors=tuple(prior for prior in self.options.priors if prior.name in names),
        )


def plan_from_words(
    model: str,
    *,
    fix: Sequence[str] = (),
    share: Sequence[str] = (),
    focal_px: float | None = None,
    loss: str = "squares",
    reject: float | None = None,
    weighted: bool = True,
    minimise: str = IMAGE,
    free_bend: bool | None = None,
    prior: Mapping[str, tuple[float, float]] | Sequence[str] = (),
    breathing_mm: float | None = None,
    vary: str | None = None,
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
        free_bend: of a flat target, as an unknown; None: if it is likely.
        prior: what is known of parameters: `fx=1250+-10px`.
        breathing_mm: distance at which the camera is told; its focal length follows the distance.
        vary: what differs between sessions: `focal`, `focal+-2px`, `fx,cx,cy`.

    Raises:
        InputError: a word that means nothing; the message says what may stand there.
    """
    fix, share = several("--fix", fix), several("--share", share)
    models, wide = _told_models(str(model))
    choices = ", ".join(solved_models())
    for name in models:
        if name in MODELS and name not in solved_models():
            raise InputError(f"--model {name}: photos are simulated with it, not solved; give {choices} or {ALL}")
        if name not in MODELS:
            hint = suggestion(name, [*solved_models(), ALL]) or f"; there are {choices} and {ALL}"
            raise InputError(f"--model {name!r}: no such model{hint}")
    reject = None if reject is None else _number("--reject", reject)
    if reject is not None and not 1 <= reject < float("inf"):
        raise InputError(f"--reject {reject:g}: give 1 or more standard deviations, such as 4")
    if loss not in ("squares", "huber", "cauchy"):
        raise InputError(f"--loss {loss!r}: it must be squares, huber or cauchy")
    known = {parameter.name: parameter for one in models for parameter in told_parameters(one)}
    fixed = tuple(_fixed(text, known) for text in fix)
    shared = tuple(_shared(text, known) for text in share)
    options = SolveOptions(
        weighted=weighted,
        loss="huber" if loss == "huber" else "cauchy" if loss == "cauchy" else "squares",
        reject_sigma=reject,
        fixed=fixed,
        shared=shared,
        focal_px=None if focal_px is None else _focal_px(_number("--focal", focal_px)),
        minimise=cost_of(minimise),
        free_bend=free_bend,
        priors=tuple(prior_from(text, known) for text in texts_of(prior)),
        breathing_mm=breathing_mm,
        vary=() if vary is None else _varied(vary)[0],
        vary_sigma_px=None if vary is None else _varied(vary)[1],
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


def _fixed(text: str, known: Collection[str]) -> tuple[str, float | None]:
    match = _ASSIGNMENT.fullmatch(text)
    if match is None:
        raise InputError(f"--fix {text!r}: name a parameter, such as k3, or give it a value, such as k3=0")
    name = full_name(match[1], known)
    _require_known(name, known, "--fix")
    if match[2] is None:
        return name, None
    try:
        value = float(match[2])
    except ValueError:
        value = float("nan")
    if not abs(value) < float("inf"):
        raise InputError(f"--fix {text!r}: {match[2]!r} is no finite number; write it as in k3=0")
    return name, value


def _shared(text: str, known: Collection[str]) -> tuple[str, ...]:
    names = tuple(full_name(name.strip(), known) for name in text.split(","))
    for name in names:
        _require_known(name, known, "--share")
    return names


def _varied(text: str) -> tuple[tuple[str, ...], float | None]:
    """What differs between sessions, and by how much if that is told."""
    names, *sigma = BETWEEN.split(text)
    found = tuple(name.strip().removesuffix("_px") for name in names.split(","))
    offered = (FOCAL, *LINEAR)
    odd = next((name for name in found if name not in offered), None)
    if odd is not None:
        hint = suggestion(odd, list(offered)) or f"; there are {', '.join(offered)}"
        raise InputError(f"--vary {shown(odd)}: nothing that may differ between sessions{hint}")
    if len(set(found)) < len(found) or (FOCAL in found and {"fx", "fy"} & set(found)):
        raise InputError(f"--vary {shown(text)}: names the same twice; name it once")
    if not sigma:
        return found, None
    try:
        size = parse_quantity(sigma[0], {"": 1.0, "px": 1.0}, "pixels, as in focal+-2px", MAX_FOCAL_PX)
    except ValueError as error:
        raise InputError(f"--vary {shown(text)}: {error}") from None
    if not size > 0 or len(sigma) > 1:
        raise InputError(f"--vary {shown(text)}: give one deviation of more than 0, as in focal+-2px")
    return found, size


def _require_known(name: str, known: Collection[str], option: str) -> None:
    if name not in known:
        hint = suggestion(name, sorted(known)) or f"; there are {', '.join(sorted(known))}"
        raise InputError(f"{option} {name!r}: no such parameter{hint}")


def _focal_px(value: float) -> float:
    if not 0 < value <= MAX_FOCAL_PX:
        raise InputError(f"focal length {value:g} px: give one of more than 0 pixels, such as 2500")
    return value


def _number(option: str, value: object) -> float:
    if not isinstance(value, Real) or isinstance(value, bool):
        raise InputError(f"{option} {shown(value)}: must be a number")
    return float(value)
