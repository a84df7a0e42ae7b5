"""Several models solved from the same observations, one after the other."""

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace

from calib.cameras.camera import Camera
from calib.core.types import Observations
from calib.metrics.errors import summarise
from calib.metrics.evaluation import Evaluation, evaluate
from calib.observe.truth import Truth
from calib.pipeline.calibrate import calibrate
from calib.pipeline.made import with_made
from calib.pipeline.settings import SolvePlan
from calib.solver.calibration import Calibration
from calib.solver.degeneracy import UndeterminedError
from calib.solver.image_field import with_image_field
from calib.virtual.solve_virtual import Reference
from designer.base.errors import InputError
from designer.tolerance.made import Made


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
