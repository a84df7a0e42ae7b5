"""How the commands that solve cameras end: well, stopped, or without a camera."""

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, NoReturn

from calib.commands.answers.solutions import solutions_answer
from calib.show.screen import shown, waiting
from designer.base.answer import NegativeError, StoppedError, Summary
from designer.base.command import NOTHING_WRITTEN, command_line

if TYPE_CHECKING:
    from calib.api.run_result import RunResult, RunWriter
    from designer.base.answer import Value

BAD = 1
"""The camera is not to be used."""

Answer = Callable[["RunResult", Callable[[str], Path]], "dict[str, Value]"]


def report_of(
    run: "RunResult", writer: "RunWriter", answer: Answer, *, page: bool, verbose: bool, more: str, evaluate: str
) -> Summary:
    """Write the page, and say what came of a run.

    Args:
        run: solved, judged and written but for its page.
        writer: that wrote it.
        answer: makes what a program is told.
        page: whether to write it; `calib report` does so later.
        verbose: say all tables.
        more: what to do with more photos, as in "and add them to the photos".
        evaluate: what to type to evaluate the best camera; "" for nothing.
    """
    from calib.commands.run_screen import next_steps, say_files, say_next, say_run

    try:
        with waiting("drawing the page"):
            remark = writer.write_page(run, command_line()) if page else writer.earlier_page()
    except KeyboardInterrupt:
        stopped(writer)
    remarks = tuple(filter(None, [remark]))
    say_run(run, writer.told(run), verbose=verbose)
    say_files(writer.folder, writer.files, remarks)
    steps = next_steps(run, writer.folder, writer.files, more=more, evaluate=evaluate)
    say_next(steps)
    of_search = () if run.search is None else run.search.remarks
    return Summary(
        answer(run, writer.place_of), tuple(writer.files), steps.commands,
        (*of_search, *run.observations.remarks, *remarks), BAD if run.verdict.grade == "bad" else 0,
    )  # fmt: skip


def stopped(writer: "RunWriter") -> NoReturn:
    """End after Ctrl-C, with a word on what is finished and stays.

    Raises:
        StoppedError: always.
    """
    tables = [path for path in writer.files if path.suffix == ".csv" and path.parent == writer.folder][:1]
    places = dict.fromkeys((*tables, *(writer.place_of(one.model) for one in writer.finished)))
    said = f"stopped; finished and kept: {', '.join(map(shown, places))}" if places else NOTHING_WRITTEN
    answer = solutions_answer(writer.finished, None, writer.place_of)
    raise StoppedError(said, Summary(answer, tuple(writer.files))) from None


def negative(writer: "RunWriter", error: Exception) -> NoReturn:
    """End where the photos determine no camera.

    Raises:
        NegativeError: always.
    """
    answer = {**solutions_answer(writer.solutions, None, writer.place_of), "verdict": None}
    said = str(error)
    raise NegativeError(f"no camera is determined: {said}", Summary(answer, tuple(writer.files), remarks=(said,)))
