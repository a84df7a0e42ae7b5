"""How `calib run` and `calib solve` end: the verdict on the camera, and the page of the folder."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from calib.commands.folder_page import folder_page
from calib.commands.screen import shown, table_console, waiting
from calib.commands.solutions import stop

if TYPE_CHECKING:
    from collections.abc import Sequence

    from calib.commands.solutions import Work
    from calib.pipeline.solutions import Solution
    from calib.verdict.criteria import Criteria
    from calib.verdict.verdict import Check, Verdict
    from designer.answer import Value
    from designer.target import TargetGeometry

BAD = 1
DEFAULT_CRITERIA = "standard"
CriteriaOption = Annotated[
    str,
    typer.Option(
        help="limits of the verdict: a template (standard, metrology, robotics), or a TOML file of one's own",
        metavar="NAME|FILE",
    ),
]


@dataclass(frozen=True)
class JudgedPage:
    """What came of it."""

    verdict: "Verdict"
    files: tuple[Path, ...]
    remarks: tuple[str, ...]
    look: tuple[str, ...]  # what a person does first

    @property
    def exit_code(self) -> int:
        """1 if the camera is not to be used."""
        return BAD if self.verdict.grade == "bad" else 0

    @property
    def answer(self) -> "dict[str, Value]":
        """The verdict for a program."""
        return {"verdict": verdict_answer(self.verdict)}


def judge_and_report(
    solutions: "Sequence[Solution]", work: "Work", criteria: "Criteria", target: "TargetGeometry | None"
) -> JudgedPage:
    """Judge the camera of a folder, say so, and write the folder's page.

    Args:
        solutions: all of them, written.
        work: what they are of.
        criteria: the limits.
        target: as it was used, which the page shows in 3D; None: points from elsewhere.
    """
    try:
        return _judge_and_report(work.folder, criteria, target)
    except KeyboardInterrupt:
        stop(solutions, work.finished)


def _judge_and_report(folder: Path, criteria: "Criteria", target: "TargetGeometry | None") -> JudgedPage:
    from calib.files import write_files
    from calib.report.judging import judge_folder
    from calib.report.run_folder import TARGET_FILE
    from calib.verdict.next_views_file import NEXT_VIEWS_FILE
    from calib.verdict.verdict_file import VERDICT_FILE
    from designer.target import target_to_json

    files = [folder / VERDICT_FILE, folder / NEXT_VIEWS_FILE]
    with waiting("judging"):
        if target is not None:
            write_files({folder / TARGET_FILE: target_to_json(target).encode()})
            files.append(folder / TARGET_FILE)
        judged = judge_folder(folder, criteria)
    _say(judged.verdict, criteria)
    with waiting("drawing the page"):
        page, remarks = folder_page(folder, "calibration", tuple)
    look = tuple(f"open {shown(path)} in a browser" for path in page if path.suffix == ".html")
    return JudgedPage(judged.verdict, (*files, *page), remarks, look)


def _say(verdict: "Verdict", criteria: "Criteria") -> None:
    """The checks, and the answer below them, where the eye ends."""
    from calib.verdict.words import checks_table, criteria_line, headline

    print()
    table_console().print(checks_table(verdict))
    print(f"\n{headline(verdict)}")
    print(criteria_line(criteria))
    for number, step in enumerate(verdict.advice):
        print(f"{'' if number else 'better next time:'}".ljust(18) + step)
    print()


def verdict_answer(verdict: "Verdict") -> "dict[str, Value]":
    """The verdict and its checks for a program."""
    return {
        "grade": verdict.grade,
        "model": verdict.model,
        "sentence": verdict.sentence,
        "checks": [_check(check) for check in verdict.checks],
        "advice": verdict.advice,
    }


def _check(check: "Check") -> "dict[str, Value]":
    return {
        "name": check.name,
        "grade": check.grade,
        "value": check.value,
        "unit": check.unit,
        "good": check.good,
        "usable": check.usable,
        "is_at_least": check.is_at_least,
        "sentence": check.sentence,
    }
