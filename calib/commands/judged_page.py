"""How `calib run` and `calib solve` end: the verdict on the camera, and the page of the folder."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from calib.commands.folder_page import folder_page
from calib.commands.screen import quoted, shown, table_console, waiting
from calib.commands.solutions import stop
from designer.command import command_line

if TYPE_CHECKING:
    from collections.abc import Sequence

    from calib.commands.solutions import Work
    from calib.pipeline.solutions import Solution
    from calib.report.origin import Origin
    from calib.report.run_folder import RunFolder
    from calib.verdict.criteria import Criteria
    from calib.verdict.verdict import Check, Verdict
    from designer.answer import Value
    from designer.page.blocks import Page
    from designer.target import TargetGeometry

BAD = 1
DEFAULT_CRITERIA = "standard"


def criteria_templates(incomplete: str) -> list[str]:
    """Templates of limits, for a shell."""
    from designer.presets import preset_names

    return [name for name in preset_names("criteria") if name.startswith(incomplete)]


CriteriaOption = Annotated[
    str,
    typer.Option(
        help="limits of the verdict: a template (standard, metrology, robotics), or a TOML file of one's own",
        metavar="NAME|FILE",
        autocompletion=criteria_templates,
    ),
]

PageOption = Annotated[
    bool, typer.Option("--page/--no-page", help="write the folder's index.html, or save the seconds that takes")
]


@dataclass(frozen=True)
class JudgedPage:
    """What came of it."""

    verdict: "Verdict"
    files: tuple[Path, ...]
    remarks: tuple[str, ...]
    look: tuple[str, ...]  # what a person does first
    proposed: int  # photos to take next, which the page or next_views.json describes

    @property
    def exit_code(self) -> int:
        """1 if the camera is not to be used."""
        return BAD if self.verdict.grade == "bad" else 0

    def again(self, how: str) -> tuple[str, str] | None:
        """What to do, and then what to type, if the camera is not to be used; None if it is.

        Args:
            how: what to do with more photos, as in "add them to the others".
        """
        if self.verdict.grade != "bad":
            return None
        has_page = any(path.suffix == ".html" for path in self.files)
        where = "the page proposes" if has_page else "next_views.json describes"
        photos = "the photo" if self.proposed == 1 else f"the {self.proposed} photos"
        take = f"take {photos} that {where}, {how}" if self.proposed else "do what is said above"
        return f"{take}; then run the same command again", command_line()

    @property
    def answer(self) -> "dict[str, Value]":
        """The verdict for a program."""
        return {"verdict": verdict_answer(self.verdict)}


def check_judged_folder(folder: Path, models: "Sequence[str]") -> None:
    """Refuse a folder in which a file to be written has the name of somebody's own, before any work is done.

    Raises:
        InputError: the message names the file.
    """
    from calib.figures import CALIBRATION_PICTURE, COMPARISON_PICTURE
    from calib.results.calibration_file import CALIBRATION_FILE, CAMERA_FILE, OBSERVATIONS_FILE
    from calib.verdict.next_views_file import FORMAT as NEXT_VIEWS
    from calib.verdict.next_views_file import NEXT_VIEWS_FILE
    from calib.verdict.verdict_file import FORMAT as VERDICT
    from calib.verdict.verdict_file import VERDICT_FILE
    from designer.own_files import require_ours

    for place in (folder, *(folder / model for model in models)):
        for name in (CALIBRATION_FILE, OBSERVATIONS_FILE, CAMERA_FILE, CALIBRATION_PICTURE, COMPARISON_PICTURE):
            require_ours(place / name)
    require_ours(folder / VERDICT_FILE, kind=VERDICT)
    require_ours(folder / NEXT_VIEWS_FILE, kind=NEXT_VIEWS)


def judge_and_report(
    solutions: "Sequence[Solution]", work: "Work", criteria: "Criteria", target: "TargetGeometry | None", *, page: bool
) -> JudgedPage:
    """Judge the camera of a folder, say so, and write the folder's page.

    Args:
        solutions: all of them, written.
        work: what they are of.
        criteria: the limits.
        target: as it was used, which the page shows in 3D; None: points from elsewhere.
        page: whether to write it; `calib report` does so later.
    """
    try:
        return _judge_and_report(work.folder, criteria, target, page=page)
    except KeyboardInterrupt:
        stop(solutions, work.finished)


def _judge_and_report(folder: Path, criteria: "Criteria", target: "TargetGeometry | None", *, page: bool) -> JudgedPage:
    from calib.report.judging import judge_what_is_read
    from calib.report.kept_target import keep_target
    from calib.report.run_folder import read_run
    from calib.report.write import PAGE_FILE
    from calib.verdict.next_views_file import NEXT_VIEWS_FILE
    from calib.verdict.verdict_file import VERDICT_FILE

    files = [folder / VERDICT_FILE, folder / NEXT_VIEWS_FILE]
    with waiting("judging"):
        if target is not None:
            files += keep_target(folder, target, is_again=(folder / VERDICT_FILE).exists())
        run = read_run(folder)
        judged, views = judge_what_is_read(run, criteria)
    _say(judged.verdict, criteria)
    if not page:
        step = f"calib report {quoted(folder)}   # draws its page"
        earlier = folder / PAGE_FILE
        old = (f"{shown(earlier)}: is of an earlier run; {step}",) if earlier.exists() else ()
        return JudgedPage(judged.verdict, tuple(files), old, old or (step,), len(views))
    with waiting("drawing the page"):
        pages, remarks = folder_page(folder, "calibration", tuple, lambda origin: _page_of(run, origin))
    look = tuple(f"open {shown(path)} in a browser" for path in pages if path.suffix == ".html")
    return JudgedPage(judged.verdict, (*files, *pages), remarks, look, len(views))


def _page_of(run: "RunFolder", origin: "Origin") -> "Page":
    from calib.report.calibration_page import page_of

    return page_of(run, origin)


def _say(verdict: "Verdict", criteria: "Criteria") -> None:
    """The checks, and the answer below them, where the eye ends."""
    from calib.verdict.words import checks_table, criteria_line, headline, meanings_table

    print()
    console, meanings = table_console(), meanings_table(verdict)
    console.print(checks_table(verdict))
    if meanings.row_count:
        print()
        console.print(meanings)
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
