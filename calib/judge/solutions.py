"""Cameras of several models from the same observations: each solved and evaluated, and compared by photos held out."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import TYPE_CHECKING

from calib.cameras import ABILITIES, ANY_LENS
from calib.cameras.camera import Camera
from calib.core.types import Observations
from calib.judge.coverage import Coverage, coverage_of, lit_part
from calib.judge.reading import unit_doubt
from calib.observe.calibration_file import Provenance
from calib.solver.accuracy import UndeterminedError
from calib.solver.calibrate import calibrate
from calib.solver.calibration import Calibration, Capture
from calib.solver.capture_error import with_capture_error
from calib.solver.circles import with_circle_doubt
from calib.solver.metrics.errors import summarise
from calib.solver.metrics.evaluation import Evaluation, evaluate, held_out_px
from calib.solver.metrics.evaluation_files import Metrics, metrics_of
from calib.solver.plan import SolvePlan, ruled_out
from calib.solver.target_error import with_target_error
from designer.base.answer import program
from designer.base.arrays import Array
from designer.base.errors import InputError

if TYPE_CHECKING:
    from calib.observe.photos import PhotoFile
    from calib.renderer.truth import Truth
    from calib.solver.solve_virtual import Reference
    from designer.tolerance.made import Made

LEAST_COMPARED = 2
NOWHERE = Provenance("")


@dataclass(frozen=True, eq=False)
class Solution:
    """What came of one model: an evaluated calibration, or why there is none."""

    model: str
    evaluation: Evaluation | None
    failure: str = ""
    is_undetermined: bool = False  # what failed had too little to go on
    held_out_px: float | None = None  # left over in photos that it was not solved from; None: not compared so
    provenance: Provenance = NOWHERE
    stored: Metrics | None = None  # of a folder, as `calib evaluate` left them, with what only a truth tells
    path: str = ""  # of its folder from the run's: "", or with a "/" at its end

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
        return self.evaluated.calibration

    @property
    def evaluated(self) -> Evaluation:
        """Its errors.

        Raises:
            ValueError: there are none.
        """
        if self.evaluation is None:
            raise ValueError(f"{self.model} was not solved: {self.failure}")
        return self.evaluation

    @property
    def camera(self) -> Camera:
        """The camera."""
        return self.calibration.camera

    @property
    def without_truth(self) -> "Solution":
        """As it would be read from its folder, which holds no truth but in its metrics."""
        return replace(self, evaluation=self.evaluated.without_truth, stored=self.stored or metrics_of(self.evaluated))

    @cached_property
    def rms_px(self) -> float:
        """Root mean square of the residuals; nan if none counts."""
        errors = self.evaluated.of("reprojection")
        return math.nan if errors is None else summarise(errors).rmse

    @cached_property
    def metrics(self) -> Metrics:
        """The errors of the photos that it was solved from, with what only a truth tells if that is known."""
        is_of_these = self.stored is not None and not self.stored.is_of_others
        return self.stored if is_of_these and self.stored else metrics_of(self.evaluated)

    @property
    def held_out(self) -> Metrics | None:
        """The errors of other photos, as `calib evaluate` left them with `--held-out` or `--on`."""
        return self.stored if self.stored is not None and self.stored.is_of_others else None

    @cached_property
    def coverage(self) -> Coverage:
        """What of the image the observations surround."""
        return coverage_of(self.calibration)

    @property
    def rank(self) -> tuple[float, ...]:
        """The least is the camera to go on with: determined, of a model that other programs know, least residuals."""
        preference = self.evaluated.preference
        return (*preference[:2], self.held_out_px or 0.0, *preference)


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
    photos: "tuple[PhotoFile, ...]" = ()  # that show where the light of a wide lens ends; none: nobody knows

    @cached_property
    def brightest(self) -> Array | None:
        """The most light of each part of the image in the photos; None without any."""
        if not self.photos:
            return None
        from calib.observe.search import brightest_of

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
    origin = Provenance(
        program(), layout_id=task.layout_id, geometry_id=task.observations.points.geometry_id, options=options,
        settings=(*task.settings, ("model", model)),
    )  # fmt: skip
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
        return Solution(model, evaluate(calibration, task.truth), provenance=origin)
    except InputError as error:
        return Solution(model, None, str(error), isinstance(error, UndeterminedError))


def best_of(solutions: Sequence[Solution]) -> Solution:
    """The one to go on with, of those that were solved.

    Raises:
        ValueError: none was.
    """
    return min((one for one in solutions if one.evaluation is not None), key=lambda one: one.rank)


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
    from calib.observe.search import with_image_circle

    found = with_image_circle(calibration.camera, task.brightest)
    camera = found.camera
    if camera.field_rad is not None:  # an observation shows light, too
        farthest_rad = lit_part(replace(calibration, camera=camera)).farthest_rad
        camera = replace(camera, field_rad=min(max(camera.field_rad, 2.001 * farthest_rad), 2 * math.pi))
    remarks = (*calibration.remarks, found.remark) if found.remark else calibration.remarks
    return replace(calibration, camera=camera, remarks=remarks)
