"""A run and its parts on a terminal: the lead of the page, what was written, what to do next; tables if wanted."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from calib.api.run_result import RunResult
from calib.metrics.evaluation import Evaluation
from calib.records.evaluation_files import metrics_of
from calib.records.run_folder import Run
from calib.show.run.sections import check_findings, headline_of, key_facts, steps_of
from calib.show.run.tables import checks_table, errors_table, faces_table, models_table, parameters_table
from designer.base.command import command_line
from designer.base.number_text import figure
from designer.page.blocks import Finding, Headline
from designer.page.terminal import (
    few_rows,
    quoted,
    say_facts,
    say_findings,
    say_headline,
    say_line,
    say_lines,
    say_table,
    say_written,
    shown,
)

if TYPE_CHECKING:
    from calib.observe.photos import Search

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


def say_run(run: RunResult, told: Run, *, verbose: bool) -> None:
    """The lead of the run's page, and with `verbose` its tables."""
    say_headline(headline_of(told))
    say_facts(key_facts(told))
    verdict = run.verdict
    checks = check_findings(verdict)
    said = [
        finding
        for check, finding in zip(verdict.checks, checks, strict=True)
        if check.grade not in ("good", "unknown") and check.name != verdict.leads_with
    ]
    failed = (f"{one.model} was not solved: {one.failure}" for one in run.solutions if one.failure)
    of_photos = () if run.search is None else _photo_remarks(run.search)
    remarks = dict.fromkeys((*failed, *of_photos, *run.remarks, *run.observations.remarks))
    say_findings([*said, *(Finding("note", "", remark) for remark in remarks)])
    if run.search is not None:
        _say_skipped(run.search)
    say_lines("better", steps_of(told)[:MOST_STEPS])
    if verbose:
        _say_tables(told)


def _photo_remarks(search: "Search") -> tuple[str, ...]:
    """Photos without the target, and pictures that could not be drawn."""
    empty = [f"{seen.image}: {'; '.join(seen.remarks)}" for seen in search.detections if not len(seen.ring)]
    without = (f"without the target: {line}" for line in _some(empty, MOST_SKIPPED))
    return (*without, *(result.overlay_failure for result in search.results if result.overlay_failure))


def _say_skipped(search: "Search") -> None:
    for line in _some(search.failures, MOST_SKIPPED):
        say_line("skipped", line)


def _some(lines: Sequence[str], most: int) -> tuple[str, ...]:
    more = (f"and {len(lines) - most} more",) if len(lines) > most else ()
    return (*lines[:most], *more)


def _say_tables(told: Run) -> None:
    """The tables of the page: checks, photos, faces, models side by side, parameters of each."""
    from calib.show.run.photos import photo_rows, views_table

    best = told.best
    plane = best.calibration.observations.points.plane
    print()
    if told.verdict is not None:
        say_table(checks_table(told.verdict))
    say_table(few_rows(views_table(photo_rows(best.evaluation, told.records), is_flat=len(plane) == 1)))
    if len(plane) > 1:
        say_table(faces_table(best.evaluation, told.records))
    say_table(models_table((best, *told.others)))
    for one in (best, *told.others):
        say_table(parameters_table(one.metrics))


def say_files(folder: Path, files: Sequence[Path], remarks: Sequence[str]) -> None:
    """What was written, and why something was not."""
    say_written(folder, files)
    say_lines("note", remarks)


def next_steps(
    run: RunResult, folder: Path, files: Sequence[Path], *, more: str, evaluate: str, again: str = ""
) -> NextSteps:
    """What to do next.

    Args:
        run: what came of it.
        folder: that holds it.
        files: that were written.
        more: what to do with more photos, as in "add them to the photos".
        evaluate: what to type to evaluate the best camera; "" for nothing.
        again: what to type to go on; "" for the same command.
    """
    page = next((path for path in files if path.name == "index.html"), None)
    look = (f"open {shown(page)} in a browser",) if page else (f"calib report {quoted(folder)}   # draws its page",)
    if run.verdict.grade == "bad":
        where = "the page proposes" if page else "next_views.json describes"
        photos = "the photo" if len(run.next_views) == 1 else f"the {len(run.next_views)} photos"
        take = f"take {photos} that {where}, {more}" if run.next_views else "do what is said above"
        line, which = again or command_line(), "run this" if again else "then run the same command again"
        none = "no camera is determined: " if run.best.calibration.status == "degenerate" else ""
        said = (f"{none}{take}; {which}", *((line,) if 0 < len(line) <= LONGEST_LINE else ()))
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


def say_evaluation(path: Path, evaluation: Evaluation, *, verbose: bool) -> None:
    """A camera's errors and what was left out of them; with `verbose` its parameters, and errors by photo and face."""
    from calib.show.run.photos import photo_rows, views_table

    calibration = evaluation.calibration
    seen, metrics = calibration.observations, metrics_of(evaluation)
    width, height = seen.image_size
    photos = f"{seen.view_count} photos, {len(seen.view)} observations"
    say_headline(_errors_headline(evaluation))
    say_line("camera", f"{path}: model {calibration.camera.model}, {width} x {height} px, {calibration.status}")
    left_out = (f"{errors.metric}: {count} left out: {reason}" for errors in evaluation.errors
                for reason, count in errors.left_out)  # fmt: skip
    say_line("photos", photos)
    remarks = dict.fromkeys((*calibration.remarks, *evaluation.remarks, *left_out, _sample(evaluation)))
    say_findings(Finding("note", "", remark) for remark in remarks)
    print()
    say_table(errors_table(metrics))
    if verbose:
        say_table(parameters_table(metrics))
    if verbose or evaluation.on:
        say_table(few_rows(views_table(photo_rows(evaluation, None), is_flat=len(seen.points.plane) == 1)))
    if verbose and len(seen.points.plane) > 1:
        say_table(faces_table(evaluation, None))


def _errors_headline(evaluation: Evaluation) -> Headline:
    """The root mean square of each error, and of which photos."""
    if evaluation.calibration.status == "degenerate":
        return Headline("bad", "do not use", "The photos do not determine the camera.")
    found = metrics_of(evaluation).metrics.items()
    rms = (f"{name} {figure(one.errors.rmse)} {one.unit}" for name, one in found if one.errors.count)
    photos = "held out" if evaluation.folds else "that the camera was solved from"
    if evaluation.on:
        photos = "that the camera was not solved from"
    return Headline("note", "evaluated", f"Root mean square errors of photos {photos}: {', '.join(rms)}.")


def _sample(evaluation: Evaluation) -> str:
    """What the errors are worth."""
    if evaluation.on:
        return f"poses were found from {evaluation.on} itself, the camera from other photos"
    if not evaluation.folds:
        return "errors of the photos that the camera was solved from; those of other photos are larger as a rule"
    return "a photo's own pose is found from itself, the camera from others; reconstruction uses the photos of one part"
