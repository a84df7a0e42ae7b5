"""The command `calib study compare`: the paper's real-world figure, simulated."""

import os
import time
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from calib.commands.folder_page import say_next, with_page
from calib.commands.study import KEPT, JobsOption, OutOption, ResumeOption, SeedOption, kept_when_stopped, table_answer
from calib.core.files import check_folder
from calib.show.screen import progress_bar, quoted, shown, table_console, waiting
from designer.base.answer import StoppedError, Summary
from designer.base.errors import InputError
from designer.base.words import printable
from designer.kinds.presets import camera_templates

if TYPE_CHECKING:
    from collections.abc import Sequence

    from calib.studies.compare.cases import Comparison
    from calib.studies.store import Study

MAX_PRINTS, MAX_SETS = 10_000, 1000


def compare(
    *,
    out: OutOption,
    quick: Annotated[bool, typer.Option("--quick", help="2 prints and 2 sets: which way it goes, in a minute")] = False,
    prints: Annotated[
        int, typer.Option(min=1, max=MAX_PRINTS, help="of each object, each with errors of its own")
    ] = 12,
    sets: Annotated[int, typer.Option(min=1, max=MAX_SETS, help="of photos of each print")] = 12,
    virtual_sets: Annotated[
        int, typer.Option(min=1, max=MAX_SETS, help="of them solved with the virtual camera, which is slow")
    ] = 1,
    camera: Annotated[
        str, typer.Option(help="template or file; it takes the photos", autocompletion=camera_templates)
    ] = "phase-one-ixg",
    seed: SeedOption = 1,
    jobs: JobsOption = None,
    resume: ResumeOption = False,
) -> Summary:
    """Simulate the paper's real-world figure: five made objects, three camera models, 12 sets of photos a print.

    Each print is one draw of the object's errors; errors are measured against the drawing, as the paper had to. Says
    which errors explain the paper's medians, and whether the virtual camera wins behind a lens no Brown model fits.
    """
    from calib.studies.compare.cases import Plan, comparison, identity, usable_camera
    from calib.studies.compare.cases import quick as quick_plan
    from calib.studies.outputs import STUDY_FILE
    from calib.studies.store import check_place, open_study

    if virtual_sets > sets:
        raise InputError(f"--virtual-sets {virtual_sets}: there are {sets} sets of a print; give at most as many")
    check_folder(out)
    plan = Plan(camera, prints, sets, virtual_sets, seed=seed)
    plan = quick_plan(plan) if quick else plan
    usable_camera(camera)
    check_place(out / STUDY_FILE, identity(plan), resume=resume)
    with kept_when_stopped():
        with waiting("placing cameras"):
            whole = comparison(plan)
        out.mkdir(parents=True, exist_ok=True)
        with open_study(out / STUDY_FILE, identity(plan), resume=resume) as study:
            _sample(whole, study, jobs or os.cpu_count() or 1)
            summary = _show(study, whole, out)
        return say_next(with_page(summary, out, "compare"), out)


def _sample(whole: "Comparison", study: "Study", jobs: int) -> None:
    """Compute the samples that are missing."""
    from calib.studies.progress import after
    from calib.studies.runner import StudyStoppedError, run_cases

    start, before = time.perf_counter(), 0
    with progress_bar("calibrating sets of photos", whole.total) as bar:
        for group in whole.groups:
            try:
                run_cases(
                    group.specs, study, samples=group.samples, seed=whole.plan.seed, jobs=jobs, chunk=1,
                    on_progress=after(before, bar),
                )  # fmt: skip
            except StudyStoppedError as error:
                if not error.by_user:
                    raise InputError(str(error)) from None
                raise StoppedError(KEPT, Summary({"samples": before + error.done, "asked": whole.total})) from None
            before += group.total
    print(f"{whole.total} sets of photos in {time.perf_counter() - start:.0f} s by {jobs} processes")


def _show(study: "Study", whole: "Comparison", folder: Path) -> Summary:
    """Write tables and figures, print what they say."""
    from calib.core.files import write_files
    from calib.studies.compare.outputs import FIGURES, comparison_output
    from calib.studies.compare.table import ALONE_HEAD, HEAD, LENS_HEAD, alone_rows, figure_rows, lens_rows, notes
    from calib.studies.compare.words import sentences
    from calib.studies.outputs import FIGURES_FOLDER
    from calib.studies.table_files import CSV_FILE, JSON_FILE, MARKDOWN_FILE

    with waiting("drawing"):
        results, files = comparison_output(study, whole, folder)
        write_files(files)
    _print_table("The paper's objects, simulated", HEAD, figure_rows(results))
    _print_table("A lens that no Brown model fits", LENS_HEAD, lens_rows(results))
    _print_table("Single errors scaled until the intersection error is the paper's", ALONE_HEAD, alone_rows(results))
    for line in (*notes(results), *sentences(results)):
        print(f"- {printable(line)}")
    pictures = folder / FIGURES_FOLDER
    print(f"\nwrote {shown(folder / MARKDOWN_FILE)}, {CSV_FILE}, {JSON_FILE}: the tables and what they say")
    print(f"      {shown(pictures)}: {', '.join(f'{name}.png' for name in FIGURES)}, as PDF and SVG too")
    print(f"      {shown(study.path)}: every set of photos")
    step = f"calib study compare -o {quoted(folder)} --resume --prints {2 * whole.plan.prints}   # adds prints"
    return Summary(table_answer(files[folder / JSON_FILE]), (*files, study.path), (step,))


def _print_table(title: str, head: "Sequence[str]", rows: "Sequence[Sequence[str]]") -> None:
    from rich.table import Table

    table = Table(*head, title=title, title_justify="left")
    for row in rows:
        table.add_row(*(printable(cell) for cell in row))
    table_console().print(table)
    print()
