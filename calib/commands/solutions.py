"""Solving several models, as `calib solve` and `calib run` show it."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, NoReturn

from calib.commands.answers.solutions import solutions_answer
from calib.commands.screen import quoted, shown, table_console, waiting
from designer.answer import NegativeError, StoppedError, Summary, program
from designer.command import NOTHING_WRITTEN, printable
from designer.errors import InputError

if TYPE_CHECKING:
    from calib.metrics.evaluation import Evaluation
    from calib.pipeline.settings import SolvePlan
    from calib.pipeline.solutions import Solution
    from calib.results.calibration_file import Provenance
    from calib.results.truth import Truth
    from calib.types import Calibration, Observations
    from calib.virtual.solve_virtual import Reference
    from designer.tolerance.made import Made


LONGEST_LINE = 400
"""Of a command that is said again; of thousands of file names nobody reads more."""


@dataclass(frozen=True, eq=False)
class Work:
    """What is to be solved, and where it comes from."""

    observations: "Observations"
    plan: "SolvePlan"
    folder: Path
    layout_id: str  # of the target; "" for points from elsewhere
    settings: tuple[tuple[str, str], ...]  # of the command, for the record
    reference: "Reference | None" = None
    truth: "Truth | None" = None
    made: "Made | None" = None  # how the target was; None: nobody knows
    finished: tuple[Path, ...] = ()  # files that are written already


def solve_and_say(work: Work) -> "list[Solution]":
    """Solve and write all models, and print what came of them.

    Raises:
        InputError: no model could be solved.
    """
    from calib.pipeline.solutions import solve_models

    for remark in work.observations.remarks:
        print(printable(remark))
    if work.made is not None:
        print(printable(work.made.sentence))
    solutions: list[Solution] = []
    try:
        with waiting("solving"):
            for solution in solve_models(
                work.observations, work.plan, work.folder, provenance=_provenance_of(work), reference=work.reference,
                truth=work.truth, remarks=work.observations.remarks, made=work.made,
            ):  # fmt: skip
                solutions.append(solution)
    except KeyboardInterrupt:
        stop(solutions, work.finished)
    if not any(solution.files for solution in solutions):
        reasons = {solution.failure: solution.model for solution in solutions}
        several = len(reasons) > 1
        said = "; ".join(f"{model}: {why}" if several else why for why, model in reasons.items())
        if not any(solution.is_undetermined for solution in solutions):
            raise InputError(said)
        answer = {**solutions_answer(solutions, None), "verdict": None}
        raise NegativeError(f"no camera is determined: {said}", Summary(answer, work.finished, remarks=(said,)))
    _say_solutions(work, solutions)
    return solutions


def _provenance_of(work: Work) -> "Callable[[str], Provenance]":
    """Where the calibration of a model comes from."""
    from calib.results.calibration_file import Provenance

    def provenance(model: str) -> Provenance:
        return Provenance(
            program(), layout_id=work.layout_id, geometry_id=work.observations.points.geometry_id,
            options=work.plan.options_of(model), settings=(*work.settings, ("model", model)),
        )  # fmt: skip

    return provenance


def stop(solutions: "Sequence[Solution]", written: Sequence[Path]) -> NoReturn:
    """End after Ctrl-C, with a word on what is finished and stays.

    Args:
        solutions: what came of the models so far.
        written: before they were solved.

    Raises:
        StoppedError: always.
    """
    finished = [one for one in solutions if one.files]
    places = ", ".join(map(shown, (*written, *(one.folder for one in finished))))
    said = f"stopped; finished and kept: {places}" if places else NOTHING_WRITTEN
    files = (*written, *(file for one in finished for file in one.files))
    raise StoppedError(said, Summary(solutions_answer(finished, None), files)) from None


def _say_solutions(work: Work, solutions: "Sequence[Solution]") -> None:
    """The parameters of each model, all side by side, and what could not be solved."""
    from calib.results.calibration_file import CALIBRATION_FILE
    from calib.results.evaluation_table import comparison_table, parameters_table

    console = table_console()
    evaluations = [solution.evaluation for solution in solutions if solution.evaluation is not None]
    for evaluation in evaluations:
        calibration = evaluation.calibration
        print(f"\n{calibration.camera.model}: {_summary(calibration)}")
        console.print(parameters_table(evaluation))
        for remark in (*calibration.remarks, *evaluation.remarks):
            if remark not in work.observations.remarks:
                print(f"  {printable(remark)}")
    views, sightings = work.observations.view_count, len(work.observations.view)
    print(
        f"\n{views} photo{'s' if views > 1 else ''}, {sightings} sightings; "
        "root mean square errors, of the photos solved from:"
    )
    console.print(comparison_table(evaluations))
    for solution in solutions:
        if solution.failure:
            print(f"{solution.model}: not solved: {printable(solution.failure)}")
            if (solution.folder / CALIBRATION_FILE).exists():
                print(f"  {shown(solution.folder)} holds an earlier solution, of something else")


def _summary(calibration: "Calibration") -> str:
    """Status, and what the scale says."""
    scale = f"{calibration.scale:.3g} times the stated sigma" if calibration.weighted else f"{calibration.scale:.4f} px"
    return f"{calibration.status}; an observation's standard deviation is {scale}; {calibration.seconds:.2f} s"


def say_files(solutions: "Sequence[Solution]") -> None:
    """What was written of each model."""
    for solution in solutions:
        names = dict.fromkeys(
            "metrics_*.csv" if path.name.startswith("metrics_") else path.name for path in solution.files
        )
        if names:
            print(f"wrote {shown(solution.folder)}: {', '.join(names)}")


def advise(
    solutions: "Sequence[Solution]",
    *,
    first: Sequence[str] = (),
    again: tuple[str, str] | None = None,
    evaluate: "Callable[[Solution], str]",
) -> tuple[str, ...]:
    """Say what to do next; return what of it is a command line.

    Args:
        solutions: what came of the models.
        first: what comes before all.
        again: of a camera that is not to be used: what to do, and what to type then, "" if that is not known.
        evaluate: what to type to evaluate a solution, "" for nothing.
    """
    best = best_of(solutions)
    none = "no camera is determined: " if is_degenerate(solutions) else ""
    if again is not None:  # a camera that is not to be used is not handed on
        commands = [again[1]] if again[1] else []
        said = [*first, f"{none}{again[0]}", *(one for one in commands if len(one) <= LONGEST_LINE)]
    else:
        convert = f"calib convert {quoted(best.folder / 'camera.json')} --to colmap -o cameras.txt"
        commands = [step for step in (evaluate(best), f"{convert}   # or opencv, ros, kalibr, ...") if step]
        said = [*first, *commands]
    for number, step in enumerate(said):
        print(f"{'' if number else 'next'}".ljust(6) + step)
    return tuple(commands)


def best_of(solutions: "Sequence[Solution]") -> "Solution":
    """The one to go on with."""
    from calib.pipeline.solutions import preference

    solved = (solution for solution in solutions if solution.evaluation is not None)
    return min(solved, key=lambda solution: preference(_evaluation_of(solution)))


def is_degenerate(solutions: "Sequence[Solution]") -> bool:
    """Whether the camera of no model is determined."""
    solved = [_evaluation_of(solution).calibration for solution in solutions if solution.evaluation is not None]
    return all(calibration.status == "degenerate" for calibration in solved)


def _evaluation_of(solution: "Solution") -> "Evaluation":
    if solution.evaluation is None:
        raise ValueError(f"{solution.model} was not solved")
    return solution.evaluation


def files_of_solutions(solutions: "Sequence[Solution]") -> tuple[Path, ...]:
    """All that was written of them."""
    return tuple(file for one in solutions for file in one.files)
