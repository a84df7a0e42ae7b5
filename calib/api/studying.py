"""The paper's studies made again from nothing, and the tables and figures of any study, from its samples."""

from dataclasses import dataclass
from pathlib import Path

from calib.api.bootstrapping import BootstrapResult, Sampling
from calib.api.page_shown import ShownAsPage
from calib.app.inputs import MAX_SEED, Place, processes_of
from calib.renderer.quantities import whole
from calib.show.studies.study_folder import STUDY_FILE
from calib.studies import paper_study
from calib.studies.compare import cases
from calib.studies.compare.objects import SETS
from calib.studies.compare.results import Results, results_of
from calib.studies.progress import DrawCount
from calib.studies.store import read_study
from calib.studies.study_table import StudyTable, cases_of, study_table
from designer.base.errors import InputError
from designer.base.files import check_folder, write_files
from designer.page.progress import Progress, unheard


def study_paper(
    folder: Place,
    *,
    quick: bool = False,
    seed: int = 1,
    jobs: int | None = None,
    dask: str | None = None,
    resume: bool = False,
    progress: Progress = unheard,
) -> BootstrapResult:
    """Make the paper's study again from nothing: `study_paper("paper", quick=True).save("paper")`.

    Targets, photos, detections and samples are kept in the folder, so that a stopped study goes on.

    Args:
        folder: for all of it.
        quick: 60 photos a set and 300 samples a case.
        seed: of all that is random.
        jobs: processes; None: one per core.
        dask: address of a cluster's scheduler, which computes the samples instead.
        resume: go on with the study in the folder.
        progress: is told what is being done.

    Raises:
        InputError: the folder holds something else, or the cluster cannot be used.
        StudyStoppedError: interrupted, or no workers are left; the samples are kept.
    """
    place, processes, seed = Path(folder), processes_of(jobs), whole("--seed", seed, 0, MAX_SEED)
    check_folder(place)
    work = paper_study.quick_study(place, seed) if quick else paper_study.full_study(place, seed)
    sampling = Sampling(place / STUDY_FILE, processes, dask, resume, progress)
    sampling.check(paper_study.settings_of(work))
    write_files(paper_study.missing_targets(work))
    count = work.photo_count
    paper_study.make_photos(work, jobs=processes, tell=lambda done: progress("rendering", done, count))
    paper_study.make_detections(work, jobs=processes, tell=lambda done: progress("searching", done, count))
    progress("solving all views of each set", 0, 0)
    sampled = sampling.run(paper_study.identity(work), [(list(paper_study.cases_of(work)), work.samples)])
    return sampling.result(sampled, (), "paper")


@dataclass(frozen=True, eq=False)
class DrawnStudy:
    """What a study says, and the files that were written to say it."""

    table: StudyTable
    remarks: tuple[str, ...]
    study: Path  # its samples
    folder: Path  # of the files
    files: tuple[Path, ...]


def draw_again(study: Place, out: Place | None = None) -> DrawnStudy:
    """Write the tables and figures of a study again, of a running one too: `draw_again("study")`.

    Args:
        study: its folder, or its `study.sqlite`.
        out: for the files; None: the study's folder.

    Raises:
        InputError: there is no study, it has no samples, or the folder takes no files.
    """
    from calib.show.studies.study_page import study_files

    path = Path(study) / STUDY_FILE if Path(study).is_dir() else Path(study)
    place = path.parent if out is None else Path(out)
    check_folder(place)
    with read_study(path) as kept:
        samples, mixed = cases_of(kept), kept.mixed_programs()
    table = study_table(samples)
    files = study_files(samples, table, place)
    write_files(files)
    return DrawnStudy(table, mixed, path, place, tuple(files))


@dataclass(frozen=True, eq=False)
class ComparisonResult(ShownAsPage):
    """The paper's real-world figure in simulation: `found.results.table`, `found.save("compare")`."""

    results: Results
    sampled: DrawCount
    kind = "compare"

    def save(self, folder: Place) -> tuple[Path, ...]:
        """Write the tables and figures; return the files."""
        from calib.show.studies.compare_page import comparison_files

        files = comparison_files(self.results, Path(folder))
        write_files(files)
        return tuple(files)


def compare_objects(
    folder: Place,
    *,
    camera: str = cases.CAMERA,
    prints: int | None = None,
    sets: int | None = None,
    virtual_sets: int = 1,
    quick: bool = False,
    seed: int = 1,
    jobs: int | None = None,
    resume: bool = False,
    progress: Progress = unheard,
) -> ComparisonResult:
    """Simulate the paper's five objects as made: `compare_objects("compare", quick=True).save("compare")`.

    Args:
        folder: where every set of photos is kept, so that a stopped comparison goes on.
        camera: template or file; it takes the photos.
        prints: of each object, each with errors of its own; None: 12, or quick 2.
        sets: of photos of each print; None: as many.
        virtual_sets: of them solved with the virtual camera, which is slow.
        quick: 2 prints and 2 sets, where nothing else is said.
        seed: of all that is random.
        jobs: processes; None: one per core.
        resume: go on with the comparison in the folder.
        progress: is told what is being done.

    Raises:
        InputError: numbers, a camera or a folder that cannot be used.
        StudyStoppedError: interrupted; what is finished is kept.
    """
    usual = cases.QUICK if quick else SETS
    prints, sets = (usual if one is None else one for one in (prints, sets))
    if virtual_sets > sets:
        raise InputError(f"--virtual-sets {virtual_sets}: there are {sets} sets of a print; give at most as many")
    processes, seed = processes_of(jobs), whole("--seed", seed, 0, MAX_SEED)
    check_folder(Path(folder))
    plan = cases.Plan(camera, prints, sets, virtual_sets, 1 if quick else cases.ALONE_PRINTS, seed)
    cases.usable_camera(camera)
    identity = cases.identity(plan)
    sampling = Sampling(Path(folder) / STUDY_FILE, processes, None, resume, progress)
    sampling.check(identity)
    progress("placing cameras", 0, 0)
    comparison = cases.comparison(plan)
    sampled = sampling.run(identity, [(group.specs, group.samples) for group in comparison.groups], chunk=1)
    with read_study(sampling.path) as study:
        return ComparisonResult(results_of(study, comparison), sampled)
