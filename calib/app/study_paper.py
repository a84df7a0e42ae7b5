"""The paper's study made again from nothing, and tables and figures of any study from its samples."""

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from calib.app.options import Dask, Jobs, Resume, Seed
from calib.app.study_bootstrap import Bootstrap, sampled_study
from calib.app.study_result import STUDY_OUT
from designer.base.files import place_of, write_files
from designer.base.options import argument, option
from designer.page.capability import OUTPUT, capability
from designer.page.output import Output, output_of
from designer.page.progress import Progress, unheard

if TYPE_CHECKING:
    from collections.abc import Mapping

    from calib.app.inputs import Place


@capability
def study_paper(
    out: Annotated["Place | Output", STUDY_OUT],
    *,
    quick: Annotated[bool, option("60 photos a set and 300 samples a case, in minutes")] = False,
    seed: Seed = 1,
    jobs: Jobs = None,
    dask: Dask = None,
    resume: Resume = False,
    progress: Progress = unheard,
) -> Bootstrap:
    """Make the paper's study again from nothing: both targets, photos, detections, 10,000 samples a case, its table.

    It takes about a quarter of an hour on two cores; photos, detections and samples are kept, so that it can be
    stopped.

    Args:
        out: a folder for all of it.

    Raises:
        InputError: the folder holds something else, the cluster cannot be used, or no workers are left; the samples are
            kept.
        StudyStoppedError: interrupted; so they are.
    """
    from calib.renderer.quantities import processes_of
    from calib.studies import paper_study
    from calib.studies.runner import Sampling

    output, processes = output_of(out), processes_of(jobs)
    Bootstrap.check(output.place)
    work = paper_study.quick_study(output.place, seed) if quick else paper_study.full_study(output.place, seed)
    sampling = Sampling(output.place, processes, dask, resume, progress)
    sampling.check(paper_study.settings_of(work))
    write_files(paper_study.missing_targets(work))
    output.finished.append(output.place)
    count = work.photo_count
    paper_study.make_photos(work, jobs=processes, tell=lambda done: progress("rendering", done, count))
    paper_study.make_detections(work, jobs=processes, tell=lambda done: progress("searching", done, count))
    progress("solving all views of each set", 0, 0)
    sampled = sampling.run(paper_study.identity(work), list(paper_study.cases_of(work)))
    return sampled_study(sampling.path, sampled, ()).saved(output, progress)


def _folder_of(given: "Mapping[str, object]") -> Path:
    """Where a study lies."""
    place = Path(str(given["study"]))
    return place if place.is_dir() else place.parent


@capability(folder=_folder_of)
def study_plot(
    study: Annotated["Place", argument("folder of a study, or its study.sqlite")],
    *,
    out: Annotated[
        "Place | Output | None",
        option("folder for tables and figures (default: the study's)", short="-o", group=OUTPUT),
    ] = None,
    progress: Progress = unheard,
) -> Bootstrap:
    """Make the tables and figures of a study again, of a running one too.

    Args:
        out: for the files; None: the study's folder.

    Raises:
        InputError: there is no study, it has no samples, or the folder takes no files.
    """
    from calib.studies.runner import STUDY_FILE, DrawCount

    path = place_of(study, "a study's folder")
    path = path / STUDY_FILE if path.is_dir() else path
    output = output_of(path.parent if out is None else out)
    Bootstrap.check(output.place)
    return replace(sampled_study(path, DrawCount(), ()), study=b"").saved(output, progress)
