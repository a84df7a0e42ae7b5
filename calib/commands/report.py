"""The command `calib report`."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from calib.commands.judged_page import criteria_templates
from calib.show.screen import quoted, shown, waiting
from designer.base.answer import Summary, Value
from designer.base.errors import InputError
from designer.base.words import printable

if TYPE_CHECKING:
    from designer.page.blocks import Headline, Page

CALIBRATION = "calibration"
NEGATIVE = 1


def report(
    folder: Annotated[
        Path,
        typer.Argument(help="folder of calib run, solve, measure or study, or of design tolerance", metavar="DIR"),
    ],
    *,
    criteria: Annotated[
        str | None,
        typer.Option(
            help="judge a calibration by other limits: a template (standard, metrology, robotics) or a TOML file of "
            "one's own",
            metavar="NAME|FILE",
            autocompletion=criteria_templates,
        ),
    ] = None,
) -> Summary:
    """Write a folder's page, index.html, again from the results it stores.

    A calibration keeps its verdict, unless other limits are given. The exit code is 1 if the page's answer is
    negative, such as: do not use.
    """
    from calib.show.claim import why_no_page
    from calib.show.guess import origin_in
    from calib.show.write import build_page, write_page

    origin = origin_in(folder)
    if why := why_no_page(folder, origin.kind):
        raise InputError(f"{why}; move it away to have one written")
    wrote: tuple[Path, ...] = ()
    if criteria is not None:
        wrote = _judge(folder, origin.kind, criteria)
    with waiting("drawing"):
        page = build_page(folder, origin)
        place = write_page(folder, origin, page)
    print(f"{shown(folder)}: {page.kind.lower()}, {len(page.sections)} sections")
    if page.headline is not None:
        print(f"  {said(page.headline)}")
    for path in (*wrote, place):
        print(f"wrote {shown(path)}")
    size_mb = place.stat().st_size / 1e6
    print(f"next  open {shown(place)} in a browser ({size_mb:.1f} MB, needs nothing beside it)")
    steps = (f"calib report {quoted(folder)} --criteria standard",) if _is_not_judged(folder, origin.kind) else ()
    for step in steps:
        print(f"      {step}   # says whether the camera is good")
    is_bad = page.headline is not None and page.headline.level == "bad"
    return Summary(_answer(origin.kind, page), (*wrote, place), steps, exit_code=NEGATIVE if is_bad else 0)


def said(headline: "Headline") -> str:
    """The answer in a line."""
    return printable(f"{headline.word}: {headline.sentence}")


def _judge(folder: Path, kind: str, criteria: str) -> tuple[Path, ...]:
    """Judge a calibration by other limits; the file with the verdict."""
    from calib.show.run.judging import judge_folder
    from calib.verdict.criteria import read_criteria
    from calib.verdict.of_run import VERDICT_FILE

    if kind != CALIBRATION:
        raise InputError(f"--criteria: limits are for calibrations, and {folder} holds another kind: {printable(kind)}")
    judge_folder(folder, read_criteria(criteria))
    return (folder / VERDICT_FILE,)


def _is_not_judged(folder: Path, kind: str) -> bool:
    from calib.verdict.of_run import VERDICT_FILE

    return kind == CALIBRATION and not (folder / VERDICT_FILE).exists()


def _answer(kind: str, page: "Page") -> dict[str, Value]:
    headline = page.headline
    return {
        "kind": kind,
        "title": page.title,
        "level": None if headline is None else headline.level,
        "word": None if headline is None else headline.word,
        "sentence": None if headline is None else headline.sentence,
        "sections": [section.title for section in page.sections],
    }
