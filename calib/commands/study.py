"""The commands `calib study ...`: what thousands of calibrations say together."""

import os
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, TypeVar, cast

import typer

from calib.cameras import DEFAULT, fitted_models, learned_models, solved_models
from calib.commands import options
from calib.commands.folder_page import say_next, with_page, with_page_again
from calib.commands.options import grid_of, image_size_of
from calib.commands.study_rig import SAMPLES, bootstrap_of_rig
from designer.base.answer import StoppedError, Summary, Value
from designer.base.codec import encode
from designer.base.command import command, only_these
from designer.base.errors import InputError
from designer.kinds.presets import one_of
from designer.page.progress import progress_bars, waiting
from designer.page.terminal import quoted, say_findings, say_headline, say_line, say_table, say_written

if TYPE_CHECKING:
    from calib.api.bootstrapping import BootstrapResult
    from calib.studies.progress import DrawCount
    from calib.studies.study_table import StudyTable

T = TypeVar("T")

MAX_PRINTS, MAX_SETS = 10_000, 1000
KEPT = "stopped; what is finished is kept: go on with --resume"

app = typer.Typer(
    help="Calibrate thousands of samples of a set of photos: how sure is the camera, and what does a target do to it?",
    rich_markup_mode=None,
    pretty_exceptions_enable=False,
)

OutOption = Annotated[Path, typer.Option("--out", "-o", help="folder for the study")]


@app.callback(invoke_without_command=True)
def _commands(context: typer.Context) -> None:
    if context.invoked_subcommand is None:
        print(context.get_help())


@command(app)
def bootstrap(
    context: typer.Context,
    *,
    target: Annotated[Path | None, typer.Option(help="the target file of detections.csv")] = None,
    detections: Annotated[
        Path | None, typer.Option(help="detections.csv, a CSV with image,u,v,X,Y,Z, or a corners.vnl", metavar="FILE")
    ] = None,
    rig: Annotated[
        Path | None, typer.Option(help="instead: the folder of calib rig, of which frames are drawn", metavar="FOLDER")
    ] = None,
    truth: Annotated[Path | None, typer.Option(help="truth.json of rendered photos: adds the error of poses")] = None,
    sizes: Annotated[str, typer.Option(help="views of a sample, drawn with replacement")] = "20,50,120",
    samples: Annotated[int | None, typer.Option(help="of each size (default: 10000; of a rig 200)")] = None,
    model: Annotated[
        str,
        typer.Option(
            help=f"{', '.join(solved_models())} ({', '.join(learned_models())} is slow)",
            autocompletion=one_of(solved_models()),
        ),
    ] = DEFAULT,
    out: OutOption,
    seed: options.SeedOption = 1,
    jobs: options.JobsOption = None,
    dask: options.DaskOption = None,
    resume: options.ResumeOption = False,
    weighted: options.WeightedOption = True,
    fix: options.FixOption = None,
    share: options.ShareOption = None,
    loss: options.LossOption = "squares",
    reject: options.RejectOption = None,
    image_size: options.ImageSizeOption = None,
    grid: options.GridOption = None,
    pitch: options.PitchOption = None,
) -> Summary:
    """Draw views with replacement, calibrate and measure, thousands of times: errors with their spread."""
    from calib.api.bootstrapping import bootstrap as find_spread

    if rig is not None:
        only_these(context, "--rig", {"rig", "samples", "out", "seed"})
        return bootstrap_of_rig(rig, SAMPLES if samples is None else samples, seed, out)
    if detections is None:
        raise InputError("no detections: give --detections FILE, or --rig with the folder of calib rig")
    words = {"image_size": image_size, "grid": grid, "pitch": pitch}
    with kept_when_stopped():
        with progress_bars() as progress:
            found = find_spread(
                detections, target, truth=truth, sizes=parse_sizes(sizes),
                samples=10_000 if samples is None else samples, model=model, fix=fix or (), share=share or (),
                loss=loss, reject_sigma=reject, weighted=weighted,
                image_size=image_size_of(image_size), grid=grid_of(grid, pitch), seed=seed, jobs=jobs, dask=dask,
                resume=resume, out=out, progress=progress,
                settings=tuple((name, text) for name, text in words.items() if text is not None),
            )  # fmt: skip
        return _told(found, out, jobs, dask)


@command(app)
def paper(
    *,
    out: OutOption,
    quick: Annotated[bool, typer.Option("--quick", help="60 photos a set and 300 samples a case, in minutes")] = False,
    seed: options.SeedOption = 1,
    jobs: options.JobsOption = None,
    dask: options.DaskOption = None,
    resume: options.ResumeOption = False,
) -> Summary:
    """Make the paper's study again from nothing: both targets, photos, detections, 10,000 samples a case, its table.

    It takes about a quarter of an hour on two cores; photos, detections and samples are kept, so that it can be
    stopped.
    """
    from calib.api.studying import study_paper

    with kept_when_stopped():
        with progress_bars() as progress:
            found = study_paper(out, quick=quick, seed=seed, jobs=jobs, dask=dask, resume=resume, progress=progress)
        return _told(found, out, jobs, dask)


@command(app)
def compare(
    *,
    out: OutOption,
    quick: Annotated[bool, typer.Option("--quick", help="2 prints and 2 sets: which way it goes, in a minute")] = False,
    prints: Annotated[
        int | None,
        typer.Option(min=1, max=MAX_PRINTS, help="of each object, each with errors of its own (default: 12)"),
    ] = None,
    sets: Annotated[int | None, typer.Option(min=1, max=MAX_SETS, help="of photos of each print (default: 12)")] = None,
    virtual_sets: Annotated[
        int, typer.Option(min=1, max=MAX_SETS, help="of them solved with the virtual camera, which is slow")
    ] = 1,
    camera: options.CameraTemplateOption = "phase-one-ixg",
    seed: options.SeedOption = 1,
    jobs: options.JobsOption = None,
    resume: options.ResumeOption = False,
) -> Summary:
    """Simulate the paper's real-world figure: five made objects, three camera models, 12 sets of photos a print.

    Each print is one draw of the object's errors; errors are measured against the drawing, as the paper had to. Says
    which errors explain the paper's medians, and whether the virtual camera wins behind a lens no Brown model fits.
    """
    from calib.api.studying import compare_objects
    from calib.show.studies.compare_page import compare_headline
    from calib.show.studies.compare_tables import objects_table
    from calib.show.studies.study_folder import STUDY_FILE

    with kept_when_stopped():
        with progress_bars() as progress:
            found = compare_objects(
                out, camera=camera, prints=prints, sets=sets, virtual_sets=virtual_sets, quick=quick, seed=seed,
                jobs=jobs, resume=resume, progress=progress,
            )  # fmt: skip
        with waiting("drawing"):
            files = (*found.save(out), out / STUDY_FILE)
        table = found.results.table
        say_headline(compare_headline(table))
        print()
        say_table(objects_table(table))
        say_sampled(found.sampled, jobs)
        say_written(out, files)
        step = f"calib study compare -o {quoted(out)} --resume --prints {2 * table.plan.prints}   # adds prints"
        summary = Summary(answer_of(type(table), table), files, (step,))
        return say_next(with_page(summary, out, "compare"), out)


@command(app)
def cost(
    *,
    detections: Annotated[
        Path | None, typer.Option(help="photos of your own too: detections.csv, or a CSV with image,u,v,X,Y,Z")
    ] = None,
    target: Annotated[Path | None, typer.Option(help="the target file of detections.csv")] = None,
    model: Annotated[
        str | None,
        typer.Option(
            help=f"of your photos: {', '.join(fitted_models())} (default: {DEFAULT})",
            autocompletion=one_of(fitted_models()),
        ),
    ] = None,
    out: OutOption,
    quick: Annotated[bool, typer.Option("--quick", help="8 sets and 20 starts: which way it goes")] = False,
    sets: Annotated[
        int | None, typer.Option(help="of simulated photos of each scene and condition (default: 30)")
    ] = None,
    starts: Annotated[int | None, typer.Option(help="bad ones of each scene (default: 60)")] = None,
    image_size: options.ImageSizeOption = None,
    grid: options.GridOption = None,
    pitch: options.PitchOption = None,
    seed: options.SeedOption = 1,
    jobs: options.JobsOption = None,
    resume: options.ResumeOption = False,
) -> Summary:
    """Measure what to minimise: distances in the image, or in space between rays and rings (--minimise).

    Boards and icosahedra, as drawn, as made and with outliers, and photos of your own: errors of camera, poses and
    photos held out, each cost against the image's on the same sightings; and from how bad starts each comes back.
    """
    from calib.api.costing import study_cost
    from calib.show.studies.cost_page import cost_headline
    from calib.show.studies.cost_tables import costs_table, starts_table
    from calib.show.studies.study_folder import STUDY_FILE

    with kept_when_stopped():
        with progress_bars() as progress:
            found = study_cost(
                out, detections, target, model=model, sets=sets, starts=starts, quick=quick,
                image_size=image_size_of(image_size), grid=grid_of(grid, pitch), seed=seed, jobs=jobs, resume=resume,
                progress=progress,
            )  # fmt: skip
        with waiting("drawing"):
            files = (*found.save(out), out / STUDY_FILE)
        table = found.table
        say_headline(cost_headline(table))
        print()
        for one in (costs_table(table), starts_table(table)):
            say_table(one)
        say_sampled(found.sampled, jobs)
        say_written(out, files)
        more = f"calib study cost -o {quoted(out)} --resume --sets {2 * table.plan.sets}   # adds sets"
        summary = Summary(answer_of(type(table), table), files, (more,))
        return say_next(with_page(summary, out, "cost"), out)


@command(app)
def plot(
    folder: Annotated[Path, typer.Argument(help="folder of a study, or its study.sqlite")],
    *,
    out: Annotated[
        Path | None, typer.Option("--out", "-o", help="folder for tables and figures (default: the study's)")
    ] = None,
) -> Summary:
    """Make the tables and figures of a study again, of a running one too."""
    from calib.api.studying import draw_again

    with waiting("drawing"):
        drawn = draw_again(folder, out)
    _say(drawn.table, drawn.remarks)
    say_written(drawn.folder, drawn.files)
    step = f"calib study plot {quoted(drawn.study)} -o {quoted(drawn.folder)}   # draws all again"
    summary = Summary(answer_of(type(drawn.table), drawn.table), (*drawn.files, drawn.study), (step,), drawn.remarks)
    return say_next(with_page_again(summary, drawn.folder, ("bootstrap", "paper")), drawn.folder)


def _told(found: "BootstrapResult", folder: Path, jobs: int | None, dask: str | None) -> Summary:
    """Write the tables and figures, and say what they say."""
    with waiting("drawing"):
        files = found.save(folder)
    _say(found.table, found.remarks)
    say_sampled(found.sampled, jobs, dask)
    say_written(folder, files)
    step = f"calib study plot {quoted(files[-1])} -o {quoted(folder)}   # draws all again"
    summary = Summary(answer_of(type(found.table), found.table), files, (step,), found.remarks)
    return say_next(with_page(summary, folder, found.kind), folder)


def _say(table: "StudyTable", remarks: tuple[str, ...]) -> None:
    """The answer, its tables, and what is to be known of them."""
    from calib.show.studies.study_page import study_headline, study_tables
    from calib.show.studies.study_words import not_converged

    say_headline(study_headline(table))
    print()
    for one in study_tables(table):
        say_table(one)
    say_findings(finding for one in table.cases if (finding := not_converged(one)) is not None)
    for remark in remarks:
        say_line("note", remark)


def answer_of(kind: type[T], table: T) -> Mapping[str, Value]:
    """What a study's `table.json` holds, which is made for programs."""
    return cast("dict[str, Value]", encode(kind, table))


def say_sampled(sampled: "DrawCount", jobs: int | None, dask: str | None = None) -> None:
    """Say how many samples were computed, and how fast."""
    from designer.base.number_text import figure

    count = jobs or os.cpu_count() or 1
    by = f"{count} process{'es' if count > 1 else ''}" if dask is None else f"the cluster at {dask}"
    there = f", {sampled.before} were there" if sampled.before else ""
    if sampled.new:
        rate = figure(sampled.new / sampled.seconds, 3)
        say_line("sampled", f"{sampled.new} samples in {sampled.seconds:.1f} s, {rate} a second by {by}{there}")


def parse_sizes(text: str) -> tuple[int, ...]:
    """Numbers of views, `20,50,120`.

    Raises:
        InputError: one is none.
    """
    from calib.api.bootstrapping import MAX_SIZE

    words = [word.strip() for word in text.split(",")]
    for word in words:
        if not (word.isascii() and word.isdigit() and len(word) < 10):
            raise InputError(
                f"--sizes {text[:60]!r}: {word[:20]!r} is no number of views from 1 to {MAX_SIZE}; "
                "give such as 20,50,120"
            )
    return tuple(map(int, words))


@contextmanager
def kept_when_stopped() -> Iterator[None]:
    """Say in one line that a run was stopped, and how to go on: what is finished stays."""
    from calib.studies.runner import StudyStoppedError

    try:
        yield
    except KeyboardInterrupt:
        raise StoppedError(KEPT) from None
    except StudyStoppedError as error:
        if not error.by_user:
            raise InputError(str(error)) from None
        raise StoppedError(str(error), Summary({"samples": error.done, "asked": error.total})) from None
