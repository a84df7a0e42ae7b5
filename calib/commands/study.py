"""The commands `calib study ...`: what thousands of calibrations say together."""

import json
import os
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from calib.cameras import DEFAULT, learned_models, solved_models
from calib.commands.folder_page import say_next, with_page, with_page_again
from calib.commands.solve import (
    FixOption,
    GridOption,
    ImageSizeOption,
    LossOption,
    PitchOption,
    RejectOption,
    ShareOption,
    WeightedOption,
    grid_of,
    image_size_of,
)
from calib.core.files import check_folder
from calib.show.screen import progress_bar, progress_bars, quoted, shown, table_console, waiting
from designer.base.answer import StoppedError, Summary, Value, program
from designer.base.command import command
from designer.base.errors import InputError
from designer.base.words import printable
from designer.kinds.presets import one_of

if TYPE_CHECKING:
    from calib.studies.findings import HeldClaim
    from calib.studies.paper_study import PaperStudy
    from calib.studies.store import Study
    from calib.studies.workers import CaseSpec

MAX_SIZE = 100_000
MAX_SAMPLES = 1_000_000
MAX_SEED = 2**63 - 1
KEPT = "stopped; what is finished is kept: go on with --resume"

app = typer.Typer(
    help="Calibrate thousands of samples of a set of photos: how sure is the camera, and what does a target do to it?",
    rich_markup_mode=None,
    pretty_exceptions_enable=False,
)

OutOption = Annotated[Path, typer.Option("--out", "-o", help="folder for the study")]
SeedOption = Annotated[int, typer.Option(min=0, max=MAX_SEED, help="of all that is random")]
JobsOption = Annotated[int | None, typer.Option(min=1, max=1024, help="processes (default: one per core)")]
DaskOption = Annotated[
    str | None, typer.Option(help="have the samples computed by the Dask cluster of this scheduler: tcp://host:8786")
]
ResumeOption = Annotated[bool, typer.Option("--resume", help="go on with the study in the folder")]


@app.callback(invoke_without_command=True)
def _commands(context: typer.Context) -> None:
    if context.invoked_subcommand is None:
        print(context.get_help())


@command(app)
def bootstrap(
    *,
    target: Annotated[Path | None, typer.Option(help="the target file of detections.csv")] = None,
    detections: Annotated[
        Path, typer.Option(help="detections.csv, a CSV with image,u,v,X,Y,Z, or a corners.vnl", metavar="FILE")
    ],
    truth: Annotated[Path | None, typer.Option(help="truth.json of rendered photos: adds the error of poses")] = None,
    sizes: Annotated[str, typer.Option(help="views of a sample, drawn with replacement")] = "20,50,120",
    samples: Annotated[int, typer.Option(min=1, max=MAX_SAMPLES, help="of each size")] = 10_000,
    model: Annotated[
        str,
        typer.Option(
            help=f"{', '.join(solved_models())} ({', '.join(learned_models())} is slow)",
            autocompletion=one_of(solved_models()),
        ),
    ] = DEFAULT,
    out: OutOption,
    seed: SeedOption = 1,
    jobs: JobsOption = None,
    dask: DaskOption = None,
    resume: ResumeOption = False,
    weighted: WeightedOption = True,
    fix: FixOption = None,
    share: ShareOption = None,
    loss: LossOption = "squares",
    reject: RejectOption = None,
    image_size: ImageSizeOption = None,
    grid: GridOption = None,
    pitch: PitchOption = None,
) -> Summary:
    """Draw views with replacement, calibrate and measure, thousands of times: errors with their spread."""
    from calib.api.bootstrapping import bootstrap as find_spread
    from calib.studies.outputs import STUDY_FILE
    from calib.studies.store import read_study

    words = {"image_size": image_size, "grid": grid, "pitch": pitch}
    with kept_when_stopped(), stopped_in_a_line():
        with progress_bars() as progress:
            found = find_spread(
                detections, target, truth=truth, sizes=parse_sizes(sizes), samples=samples, model=model, fix=fix or (),
                share=share or (), loss=loss, reject_sigma=reject, weighted=weighted,
                image_size=image_size_of(image_size), grid=grid_of(grid, pitch), seed=seed, jobs=jobs, dask=dask,
                resume=resume, out=out, progress=progress,
                settings=tuple((name, text) for name, text in words.items() if text is not None),
            )  # fmt: skip
        for remark in found.remarks:
            print(printable(remark))
        done = found.sampled
        say_sampled(done.new, done.before, done.seconds, jobs or os.cpu_count() or 1, dask)
        with read_study(out / STUDY_FILE) as study:
            summary = show(study, out, found.remarks)
        return say_next(with_page(summary, out, "bootstrap"), out)


@command(app)
def paper(
    *,
    out: OutOption,
    quick: Annotated[bool, typer.Option("--quick", help="60 photos a set and 300 samples a case, in minutes")] = False,
    seed: SeedOption = 1,
    jobs: JobsOption = None,
    dask: DaskOption = None,
    resume: ResumeOption = False,
) -> Summary:
    """Make the paper's study again from nothing: both targets, photos, detections, 10,000 samples a case, its table.

    It takes about half an hour on two cores; photos, detections and samples are kept, so that it can be stopped.
    """
    from calib.studies import paper_study
    from calib.studies.outputs import STUDY_FILE
    from calib.studies.store import check_place, open_study

    check_folder(out)
    work = paper_study.quick_study(out, seed) if quick else paper_study.full_study(out, seed)
    check_place(out / STUDY_FILE, paper_study.settings_of(work), resume=resume)
    with kept_when_stopped():
        _check_cluster(dask)
        _photograph_and_search(work, jobs)
        identity = paper_study.identity(work)
        with waiting("solving all views of each set"):
            specs = list(paper_study.cases_of(work))
        with open_study(out / STUDY_FILE, identity, resume=resume) as study:
            sample(specs, study, samples=work.samples, seed=seed, jobs=jobs, dask=dask)
            summary = show(study, out)
        return say_next(with_page(summary, out, "paper"), out)


@command(app)
def plot(
    folder: Annotated[Path, typer.Argument(help="folder of a study, or its study.sqlite")],
    *,
    out: Annotated[
        Path | None, typer.Option("--out", "-o", help="folder for tables and figures (default: the study's)")
    ] = None,
) -> Summary:
    """Make the tables and figures of a study again, of a running one too."""
    from calib.studies.outputs import STUDY_FILE
    from calib.studies.store import read_study

    path = folder / STUDY_FILE if folder.is_dir() else folder
    place = path.parent if out is None else out
    check_folder(place)
    with read_study(path) as study:
        summary = show(study, place)
    return say_next(with_page_again(summary, place, ("bootstrap", "paper")), place)


def parse_sizes(text: str) -> tuple[int, ...]:
    """Numbers of views, `20,50,120`.

    Raises:
        InputError: one is none, or stands there twice.
    """
    sizes = []
    for word in text.split(","):
        digits = word.strip()
        if not (digits.isascii() and digits.isdigit() and 0 < len(digits) < 10 and 0 < int(digits) <= MAX_SIZE):
            raise InputError(
                f"--sizes {text[:60]!r}: {digits[:20]!r} is no number of views from 1 to {MAX_SIZE}; "
                "give such as 20,50,120"
            )
        sizes.append(int(digits))
    if len(set(sizes)) < len(sizes):
        raise InputError(f"--sizes {text[:60]!r}: a size stands there twice; give each once")
    return tuple(sizes)


def sample(
    specs: "Sequence[CaseSpec]", study: "Study", *, samples: int, seed: int, jobs: int | None, dask: str | None
) -> None:
    """Compute the samples that are missing, and say how long it took."""
    from calib.studies.runner import run_cases

    total, counts = samples * len(specs), [0]
    processes = jobs or os.cpu_count() or 1
    start = time.perf_counter()
    with stopped_in_a_line(), progress_bar("sampling", total, rate=True) as bar:
        run_cases(specs, study, samples=samples, seed=seed, jobs=processes, dask=dask, on_progress=_told(counts, bar))
    say_sampled(counts[-1] - counts[1], counts[1], time.perf_counter() - start, processes, dask)


def say_sampled(new: int, before: int, seconds: float, processes: int, dask: str | None) -> None:
    """Say how many samples were computed, and how fast."""
    from calib.core.number_text import figure

    by = f"{processes} process{'es' if processes > 1 else ''}" if dask is None else f"the cluster at {dask}"
    there = f", {before} were there" if before else ""
    if new:
        print(f"{new} samples in {seconds:.1f} s, {figure(new / seconds, 3)} a second by {printable(by)}{there}")


def _told(counts: list[int], bar: Callable[[float], None]) -> Callable[[int], None]:
    """Note progress, and show it."""

    def tell(done: int) -> None:
        counts.append(done)
        bar(done)

    return tell


def show(study: "Study", folder: Path, remarks: Sequence[str] = ()) -> Summary:
    """Write tables and figures, print the tables and what they say.

    Args:
        study: finished or not.
        folder: for the files.
        remarks: on the photos, said already.
    """
    from calib.core.files import write_files
    from calib.show.studies.study_words import OWN
    from calib.studies.outputs import FIGURES_FOLDER, study_output
    from calib.studies.table import notes, screen_tables
    from calib.studies.table_files import CSV_FILE, JSON_FILE, MARKDOWN_FILE

    with waiting("drawing"):
        output = study_output(study, folder)
        write_files(output.files)
    console = table_console()
    for table in screen_tables(output.summaries):
        console.print(table)
        print()
    for line in notes(output.summaries):
        print(f"- {printable(line)}")
    if output.findings:
        print()
        _say_findings(output.findings)
        for line in output.reasons:
            print(f"- {printable(line.removeprefix(OWN))}")
    mixed = tuple(_mixed_programs(study))
    for line in mixed:
        print(f"- {line}")
    pictures = [path for path in output.files if path.suffix == ".png"]
    print(f"\nwrote {shown(folder / MARKDOWN_FILE)}, {CSV_FILE}, {JSON_FILE}: the tables")
    print(f"      {shown(folder / FIGURES_FOLDER)}: {', '.join(path.name for path in pictures)}, as PDF and SVG too")
    print(f"      {shown(study.path)}: every sample")
    step = f"calib study plot {quoted(study.path)} -o {quoted(folder)}   # draws all again"
    answer = table_answer(output.files[folder / JSON_FILE])
    return Summary(answer, (*output.files, study.path), (step,), (*remarks, *mixed))


def _say_findings(found: "Sequence[HeldClaim]") -> None:
    """What holds of the paper's findings; of a person's own photos only how sigma falls, which is no claim."""
    from calib.show.studies.study_words import fall_in_words
    from calib.studies.table import finding_in_words, findings_table

    if not any(one.ratios for one in found):
        falls = {(fall.target, fall.metric): fall for one in found for fall in one.falls}
        for fall in falls.values():
            print(f"- {printable(fall.target)}, {fall.metric} error: {fall_in_words(fall.exponent, fall.error)}")
        return
    table_console().print(findings_table(found))
    for one in found:
        if one.verdict != "holds":
            print(f"- {printable(finding_in_words(one))}")


def table_answer(table: bytes) -> dict[str, Value]:
    """What a study's table.json holds, which is made for programs."""
    document: dict[str, Value] = json.loads(table)
    return {key: value for key, value in document.items() if key not in ("format", "version")}


def _mixed_programs(study: "Study") -> Iterator[str]:
    """Programs of which several versions computed the samples."""
    programs = [name for name, _ in study.programs()]
    for name in sorted({name for name in programs if programs.count(name) > 1}):
        versions = ", ".join(version for other, version in study.programs() if other == name)
        yield f"the samples were computed by several versions of {printable(name)}: {printable(versions)}"


def _photograph_and_search(work: "PaperStudy", jobs: int | None) -> None:
    """Targets, photos and detections, as far as they are not there."""
    from calib.core.files import write_files
    from calib.studies import paper_study

    processes = jobs or os.cpu_count() or 1
    write_files(paper_study.missing_targets(work))
    with progress_bar("rendering", work.photo_count) as tell:
        paper_study.make_photos(work, jobs=processes, tell=tell)
    with progress_bar("searching", work.photo_count) as tell:
        paper_study.make_detections(work, detector=program(), jobs=processes, tell=tell)
    print(f"{shown(work.folder / 'photos')}: {work.photo_count} photos in {len(work.sets)} sets, detected")


def _check_cluster(dask: str | None) -> None:
    """Refuse a cluster that cannot be used before there is much work behind us."""
    if dask is not None:
        from calib.studies.dask_cluster import check_cluster

        with waiting("asking the cluster"):
            check_cluster(dask)


@contextmanager
def stopped_in_a_line() -> Iterator[None]:
    """Say in one line that a run was stopped, and how to go on."""
    from calib.studies.runner import StudyStoppedError

    try:
        yield
    except StudyStoppedError as error:
        if not error.by_user:
            raise InputError(str(error)) from None
        raise StoppedError(str(error), Summary({"samples": error.done, "asked": error.total})) from None


@contextmanager
def kept_when_stopped() -> Iterator[None]:
    """Say after Ctrl-C that what is finished stays."""
    try:
        yield
    except KeyboardInterrupt:
        raise StoppedError(KEPT) from None
