"""How sure a camera is, by thousands of samples of its photos: what `calib study bootstrap` does."""

import time
from collections.abc import Sequence
from dataclasses import dataclass
from os import PathLike
from pathlib import Path
from tempfile import TemporaryDirectory

from calib.api.page_shown import ShownAsPage
from calib.app.inputs import (
    MAX_SEED,
    Observed,
    Place,
    ask_cluster,
    folder_of,
    load_observations,
    observations_of,
    processes_of,
    target_of,
    truth_from,
)
from calib.cameras import DEFAULT, solved_models
from calib.core.types import Observations
from calib.observe.corners_vnl import PointGrid
from calib.renderer.quantities import whole
from calib.renderer.truth import Truth
from calib.show.studies.study_folder import STUDY_FILE
from calib.solver.plan import SolvePlan, plan_from_words
from calib.studies import bootstrap as pools
from calib.studies.identity import StudyIdentity, digest_of, identity_of
from calib.studies.paper_table import TARGETS
from calib.studies.progress import DrawCount
from calib.studies.runner import StudyStoppedError, run_cases
from calib.studies.statistics import Case, CaseSummary
from calib.studies.store import check_place, open_study, read_study
from calib.studies.study_table import StudyCases, StudyTable, cases_of, study_table
from calib.studies.workers import CaseSpec
from designer.base.errors import InputError
from designer.base.files import check_folder, write_files
from designer.base.words import cut, printable, several
from designer.page.progress import Progress, unheard
from designer.target import TargetGeometry

MAX_SAMPLES, MAX_SIZE = 1_000_000, 100_000
RUN_FOLDER = "calibration"
"""How `calib run` calls its folder."""


@dataclass(frozen=True, eq=False)
class BootstrapResult(ShownAsPage):
    """The spread of a camera's errors over samples of its photos: `found.summaries`, `found.save("study")`.

    In a notebook the result shows its page.
    """

    table: StudyTable  # what the samples say
    cases: StudyCases  # the samples
    sampled: DrawCount
    remarks: tuple[str, ...]  # on the photos, one line each
    study: bytes  # every sample, as `study.sqlite` holds them
    kind: str = "bootstrap"  # of its page

    @property
    def summaries(self) -> tuple[CaseSummary, ...]:
        """The errors of each size."""
        return self.table.cases

    def save(self, folder: Place) -> tuple[Path, ...]:
        """Write every sample, the tables and the figures; return the files.

        Raises:
            InputError: the folder takes no files, or holds another study.
        """
        from calib.show.studies.study_page import study_files

        place = folder_of(folder)
        check_folder(place)
        path = place / STUDY_FILE
        if path.exists() and path.read_bytes() != self.study:
            raise InputError(f"{path}: there is another study; choose another folder")
        if not path.exists():
            write_files({path: self.study})
        files = study_files(self.cases, self.table, place)
        write_files(files)
        return (*files, path)


@dataclass(frozen=True, eq=False)
class Sampling:
    """Where the samples of a study are kept, and who computes them."""

    path: Path  # of the study's file
    jobs: int  # processes
    dask: str | None  # address of a cluster's scheduler, which computes the samples instead
    resume: bool
    progress: Progress

    def check(self, identity: StudyIdentity) -> None:
        """Refuse a place or a cluster that cannot be used, before there is much work behind us.

        Raises:
            InputError: so it is.
        """
        check_place(self.path, identity, resume=self.resume)
        ask_cluster(self.dask, self.progress)

    def run(
        self, identity: StudyIdentity, groups: Sequence[tuple[Sequence[CaseSpec], int]], chunk: int | None = None
    ) -> DrawCount:
        """Compute the samples that are missing.

        Args:
            identity: what makes it this study.
            groups: cases, and how many samples are wanted of each of them.
            chunk: samples that are computed at a time; None: as many as take a moment.

        Raises:
            StudyStoppedError: interrupted, or no workers are left; what there is, is kept.
        """
        total, start = sum(len(specs) * count for specs, count in groups), time.perf_counter()
        self.path.parent.mkdir(parents=True, exist_ok=True)
        new = before = 0
        with open_study(self.path, identity, resume=self.resume) as study:
            for specs, samples in groups:
                counts: list[int] = []
                done = before + new

                def tell(count: int, counts: list[int] = counts, done: int = done) -> None:
                    counts.append(count)
                    self.progress("sampling", done + count, total)

                try:
                    run_cases(
                        specs, study, samples=samples, seed=identity.seed, jobs=self.jobs,
                        dask=self.dask, on_progress=tell, chunk=chunk,
                    )  # fmt: skip
                except StudyStoppedError as error:
                    raise StudyStoppedError(error.reason, done + error.done, total, by_user=error.by_user) from None
                before, new = before + counts[0], new + counts[-1] - counts[0]
        return DrawCount(new, before, time.perf_counter() - start)

    def result(self, sampled: DrawCount, remarks: Sequence[str], kind: str) -> BootstrapResult:
        """What the samples say that are kept now."""
        with read_study(self.path) as study:
            cases, mixed = cases_of(study), study.mixed_programs()
        return BootstrapResult(study_table(cases), cases, sampled, (*remarks, *mixed), self.path.read_bytes(), kind)


def bootstrap(
    observed: Observed,
    target: TargetGeometry | Place | None = None,
    *,
    truth: Truth | Place | None = None,
    sizes: Sequence[int] = (20, 50, 120),
    samples: int = 10_000,
    model: str = DEFAULT,
    fix: Sequence[str] = (),
    share: Sequence[str] = (),
    loss: str = "squares",
    reject_sigma: float | None = None,
    weighted: bool = True,
    image_size: tuple[int, int] | None = None,
    grid: PointGrid | None = None,
    seed: int = 1,
    jobs: int | None = None,
    dask: str | None = None,
    resume: bool = False,
    out: Place | None = None,
    progress: Progress = unheard,
    settings: Sequence[tuple[str, str]] = (),
) -> BootstrapResult:
    """Calibrate thousands of samples of photos, drawn with replacement: `bootstrap("detections.csv", "t.target.json")`.

    Args:
        observed: a file of observations, what was found in photos, or observations.
        target: that they show; None: points from elsewhere.
        truth: of rendered photos, which adds the errors of poses.
        sizes: views of a sample.
        samples: of each size.
        model: a camera model's name.
        fix: parameters to keep as they start, or at a value.
        share: parameters that have one value.
        loss: how far-off observations count.
        reject_sigma: leave out what is farther off.
        weighted: by covariances, or all alike.
        image_size: of a file that does not say it.
        grid: of a `corners.vnl`.
        seed: of all samples.
        jobs: processes; None: one per core.
        dask: address of a cluster's scheduler, which computes the samples instead.
        resume: go on with the study in the folder.
        out: a folder to keep the samples in as they come, so that a stopped study goes on; None: `save` writes them.
        progress: is told what is being done.
        settings: what a study with other words for its options is told by, instead of these.

    Raises:
        InputError: files or options that break a rule, or photos too few.
        StudyStoppedError: interrupted, or no workers are left; the samples in a folder are kept.
    """
    plan = plan_from_words(
        model, fix=fix, share=share, focal_px=None, loss=loss, reject=reject_sigma, weighted=weighted
    )
    if len(plan.models) > 1:
        raise InputError(f"--model {model}: a study is of one model; give {', '.join(solved_models())}")
    views, count = (
        [whole("--sizes", size, 1, MAX_SIZE) for size in several("--sizes", sizes)],
        whole("--samples", samples, 1, MAX_SAMPLES),
    )
    if len(set(views)) < len(views):
        raise InputError(f"--sizes {', '.join(map(str, views))}: a size stands there twice; give each once")
    seed = whole("--seed", seed, 0, MAX_SEED)
    if dask is not None and jobs is not None:
        raise InputError("--jobs: is of processes on this machine; --dask has the cluster do it, leave one out")
    processes = processes_of(jobs)
    if out is not None:
        check_folder(folder_of(out))
    if isinstance(observed, str | PathLike):
        observations = load_observations(observed, target, image_size=image_size, grid=grid)
    else:
        observations = observations_of(observed, target)
    known = truth_from(truth)
    if known is not None and target is not None and known.layout_id != target_of(target).layout_id:
        name = "the truth" if isinstance(truth, Truth) else truth
        raise InputError(f"{name}: of photos of another target; give the truth.json beside the photos")
    name = _name_of(*(one for one in (target, observed) if isinstance(one, str | PathLike)))
    kept = _settings(plan, image_size, grid) | dict(settings)
    identity = _identity(seed, {"model": model, "name": name, **kept}, observations, observed, target, truth)
    with TemporaryDirectory() as aside:
        path = Path(aside if out is None else out) / STUDY_FILE
        sampling = Sampling(path, processes, dask, resume, progress)
        sampling.check(identity)
        progress("solving all views", 0, 0)
        pool = pools.make_pool(observations, model, plan.options_of(model), known)
        for size in views:
            pools.require_enough(pool, size)
        specs = [CaseSpec(Case(name, size, pool.view_count), pool) for size in views]
        sampled = sampling.run(identity, [(specs, count)])
        return sampling.result(sampled, (*observations.remarks, *pool.remarks), "bootstrap")


def _identity(
    seed: int,
    settings: dict[str, str],
    observations: Observations,
    observed: Observed,
    target: TargetGeometry | Place | None,
    truth: Truth | Place | None,
) -> StudyIdentity:
    """What makes it this study: its files, or what they would hold."""
    named = (("detections", observed), ("target", target), ("truth", truth))
    files = {name: Path(one) for name, one in named if isinstance(one, str | PathLike)}
    identity = identity_of(seed, settings, files)
    if "detections" in files:
        return identity
    return StudyIdentity(seed, identity.settings, (("detections", digest_of(observations)), *identity.inputs))


def _settings(plan: SolvePlan, image_size: tuple[int, int] | None, grid: PointGrid | None) -> dict[str, str]:
    """What decides a sample's result beside the model."""
    options = plan.options
    others = {
        "image_size": None if image_size is None else f"{image_size[0]}x{image_size[1]}",
        "grid": None if grid is None else f"{grid.columns}x{grid.rows}",
        "pitch": None if grid is None else f"{grid.pitch_mm:g}mm",
    }
    return {
        "weighted": "yes" if options.weighted else "no",
        "loss": options.loss,
        "reject": "" if options.reject_sigma is None else f"{options.reject_sigma!r}",
        "fix": ",".join(sorted(name if value is None else f"{name}={value!r}" for name, value in options.fixed)),
        "share": ";".join(map(",".join, options.shared)),
        **{name: value for name, value in others.items() if value is not None},
    }


def _name_of(*places: Place) -> str:
    """What a target is called in tables: after the first file there is."""
    if not places:
        return "own target"
    # A name stands above columns and pictures; in the folder of a run, the folder says more than target.json.
    path = Path(places[0])
    file = path.name.removesuffix(".json").removesuffix(".target") or path.name
    place = path.absolute().parent
    folder = place.parent.name if place.name == RUN_FOLDER else place.name
    name = printable((folder or file) if file == "target" else file)
    short = cut(name)
    # The paper's own targets are others, whose numbers must not stand beside.
    return f"own {short}" if short in TARGETS else short
