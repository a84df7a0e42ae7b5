"""A run on a terminal: the verdict, what matters, what was written, what to do next; all tables if they are wanted."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from calib.api.run_result import RunResult
from calib.commands.photo_screen import photo_table
from calib.core.number_text import figure
from calib.metrics.errors import summarise
from calib.observe.photos import Search
from calib.show.run.evaluation_table import comparison_table, focal_length, parameters_table
from calib.show.run.sections import finding_of, headline_of
from calib.show.screen import quoted, shown, table_console
from calib.verdict.words import checks_table, criteria_line
from designer.base.command import command_line
from designer.page.blocks import Facts, Finding
from designer.page.terminal import say_facts, say_findings, say_headline, say_line, say_lines, say_table, say_written

MOST_SKIPPED, MOST_STEPS = 5, 3
LONGEST_LINE = 400
"""Of a command that is said again; of thousands of file names nobody reads more."""
LEAST_VIEWS_HELD_OUT = 6
"""Fewer are not worth the advice to hold some out."""


@dataclass(frozen=True)
class NextSteps:
    """What to do after a run, and what of it is a command line."""

    lines: tuple[str, ...]
    commands: tuple[str, ...]


def say_run(run: RunResult, *, verbose: bool) -> None:
    """The verdict and what it rests on."""
    if verbose:
        _say_tables(run)
    say_headline(headline_of(run.verdict))
    say_facts(Facts(_facts(run)))
    checks = tuple(finding_of(check) for check in run.verdict.checks if check.grade not in ("good", "unknown"))
    failed = (f"{one.model} was not solved: {one.failure}" for one in run.solutions if one.failure)
    of_photos = () if run.search is None else _photo_remarks(run.search)
    remarks = dict.fromkeys((*failed, *of_photos, *run.remarks, *run.observations.remarks))
    say_findings([*checks, *(Finding("note", "", remark) for remark in remarks)])
    if run.search is not None:
        _say_skipped(run.search)
    say_lines("better", run.verdict.advice[:MOST_STEPS])


def _facts(run: RunResult) -> tuple[tuple[str, str], ...]:
    """Camera, photos and checks, a line each."""
    calibration = run.best.calibration
    width, height = calibration.camera.image_size
    focal = "" if calibration.camera.learned is not None else f", fx {focal_length(calibration)} px"
    residual = None if run.best.evaluation is None else run.best.evaluation.of("reprojection")
    rms = "" if residual is None else f", RMS residual {figure(summarise(residual).rmse, 3)} px"
    known = [check for check in run.verdict.checks if check.grade != "unknown"]
    good = sum(check.grade == "good" for check in known)
    return (
        ("camera", f"{calibration.camera.model}, {width} x {height} px{focal}{rms}"),
        ("photos", photo_words(run.search) if run.search is not None else _observation_words(run)),
        ("checks", f"{good} of {len(known)} good; {criteria_line(run.judged.criteria)}"),
    )


def photo_words(search: Search) -> str:
    """How many photos show the target, and how much of it."""
    found, expected = search.counts
    counts = f", {found} of {expected} features of the faces seen that could be measured" if found else ""
    return (
        f"{len(search.with_target) or 'none'} of {len(search.results)} with the target{counts}; "
        f"{len(search.results) - len(search.detections)} failures; {search.seconds:.1f} s"
    )


def _photo_remarks(search: Search) -> tuple[str, ...]:
    """Photos without the target, and pictures that could not be drawn."""
    empty = [f"{seen.image}: {'; '.join(seen.remarks)}" for seen in search.detections if not len(seen.ring)]
    without = (f"without the target: {line}" for line in _some(empty, MOST_SKIPPED))
    return (*without, *(result.overlay_failure for result in search.results if result.overlay_failure))


def _observation_words(run: RunResult) -> str:
    seen = run.observations
    return f"{seen.view_count} photo{'s' if seen.view_count > 1 else ''}, {len(seen.view)} observations"


def _say_skipped(search: Search) -> None:
    for line in _some(search.failures, MOST_SKIPPED):
        say_line("skipped", line)


def _some(lines: Sequence[str], most: int) -> tuple[str, ...]:
    more = (f"and {len(lines) - most} more",) if len(lines) > most else ()
    return (*lines[:most], *more)


def _say_tables(run: RunResult) -> None:
    """Photos, parameters of each model, models side by side, and checks."""
    console = table_console()
    if run.search is not None:
        say_table(photo_table(run.search))
    evaluations = [one.evaluation for one in run.solutions if one.evaluation is not None]
    for one in evaluations:
        print(f"{one.calibration.camera.model}: {_status(run, one.calibration.camera.model)}")
        console.print(parameters_table(one))
        print()
    print("root mean square errors, of the photos solved from:")
    console.print(comparison_table(evaluations))
    print()
    console.print(checks_table(run.verdict))
    print()


def _status(run: RunResult, model: str) -> str:
    """Status, and what the scale says."""
    one = next(solution.calibration for solution in run.solutions if solution.model == model)
    scale = f"{one.scale:.3g} times the stated sigma" if one.weighted else f"{one.scale:.4f} px"
    return f"{one.status}; an observation's standard deviation is {scale}; {one.seconds:.2f} s"


def say_files(folder: Path, files: Sequence[Path], remarks: Sequence[str]) -> None:
    """What was written, and why something was not."""
    say_written(folder, files)
    say_lines("note", remarks)


def next_steps(run: RunResult, folder: Path, files: Sequence[Path], *, more: str, evaluate: str) -> NextSteps:
    """What to do next.

    Args:
        run: what came of it.
        folder: that holds it.
        files: that were written.
        more: what to do with more photos, as in "add them to the photos".
        evaluate: what to type to evaluate the best camera; "" for nothing.
    """
    page = next((path for path in files if path.name == "index.html"), None)
    look = (f"open {shown(page)} in a browser",) if page else (f"calib report {quoted(folder)}   # draws its page",)
    if run.verdict.grade == "bad":
        where = "the page proposes" if page else "next_views.json describes"
        photos = "the photo" if len(run.next_views) == 1 else f"the {len(run.next_views)} photos"
        take = f"take {photos} that {where}, {more}" if run.next_views else "do what is said above"
        line = command_line()
        none = "no camera is determined: " if run.best.calibration.status == "degenerate" else ""
        said = (f"{none}{take}; then run the same command again", *((line,) if 0 < len(line) <= LONGEST_LINE else ()))
        return NextSteps((*look, *said), (line,) if line else ())
    place = folder if (folder / "camera.json").exists() else folder / run.best.model
    convert = (
        f"calib convert {quoted(place / 'camera.json')} --to colmap -o cameras.txt   # or opencv, ros, kalibr, ..."
    )
    commands = (*((evaluate,) if evaluate else ()), convert)
    return NextSteps((*look, *commands), commands)


def say_next(steps: NextSteps) -> None:
    """What to do next, a line each."""
    for number, line in enumerate(steps.lines):
        print(f"{'' if number else 'next'}".ljust(9) + line)
