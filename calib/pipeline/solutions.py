"""Several models solved from the same observations, each written to its folder as soon as it is there."""

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from calib.metrics.errors import summarise
from calib.metrics.evaluation import Evaluation, evaluate
from calib.pipeline.calibrate import calibrate
from calib.pipeline.made import with_made
from calib.pipeline.settings import SolvePlan
from calib.results.calibration_file import Provenance, write_calibration
from calib.results.truth import Truth
from calib.solver.degeneracy import UndeterminedError
from calib.solver.image_field import with_image_field
from calib.types import Observations
from calib.virtual.solve_virtual import Reference
from designer.errors import InputError, NotWrittenError
from designer.tolerance.made import Made


@dataclass(frozen=True, eq=False)
class Solution:
    """What came of one model: an evaluated calibration in a folder, or why there is none."""

    model: str
    folder: Path
    evaluation: Evaluation | None
    files: tuple[Path, ...] = ()
    failure: str = ""
    is_undetermined: bool = False  # what failed had too little to go on


def preference(evaluation: Evaluation) -> tuple[bool, bool, float]:
    """The order in which cameras of the same photos are recommended, the best first.

    It is determined, of a model that other programs know, and then with the least left over: what a learned map leaves
    over is small because it bends to the very photos it is judged by.
    """
    calibration, errors = evaluation.calibration, evaluation.of("reprojection")
    left_px = math.inf if errors is None else summarise(errors).rmse
    return calibration.status != "converged", calibration.camera.learned is not None, left_px


def solve_models(
    observations: Observations,
    plan: SolvePlan,
    folder: Path,
    *,
    provenance: Callable[[str], Provenance],
    reference: Reference | None,
    truth: Truth | None,
    remarks: Sequence[str] = (),
    made: Made | None = None,
) -> Iterator[Solution]:
    """Solve each model, write it, and evaluate it. One that cannot be solved does not stop the others.

    Args:
        observations: what was seen.
        plan: models and options.
        folder: where to; with several models, each has a folder of its name in it.
        provenance: of a model's solution.
        reference: the photo that a learned map is of.
        truth: of rendered photos.
        made: how the target was; None: nobody knows.
        remarks: on what the observations were made of, to stand in each calibration after its own.
    """
    for model in plan.models:
        place = folder if len(plan.models) == 1 else folder / model
        try:
            solved = calibrate(observations, model, plan.options_of(model), reference)
            calibration = with_image_field(with_made(solved, made))
            calibration = replace(calibration, remarks=(*calibration.remarks, *remarks))
            evaluation = evaluate(calibration, truth)
            files = tuple(write_calibration(place, calibration, provenance(model)))
        except NotWrittenError:
            raise
        except InputError as error:
            few = isinstance(error, UndeterminedError)
            yield Solution(model, place, None, failure=str(error), is_undetermined=few)
            continue
        yield Solution(model, place, evaluation, files)
