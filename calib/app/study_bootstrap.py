"""How sure a camera or a rig is, by samples of its photos: `calib study bootstrap`, `calib.bootstrap("d.csv")`."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, cast

from calib.app.options import (
    Dask,
    Fix,
    Grid,
    ImageSize,
    Jobs,
    Loss,
    Pitch,
    Reject,
    Resume,
    Seed,
    Share,
    Weighted,
    grid_of,
)
from calib.app.study_result import FORMATS, STUDY_OUT, TABLES, StudyResult, kept_samples, rows_to_csv, sampling_in
from calib.cameras import DEFAULT, learned_models, solved_models
from designer.base.answer import program
from designer.base.errors import InputError
from designer.base.files import JsonValue, place_of, write_files
from designer.base.marks import INLINE, NOT_IN_FILE, Gap
from designer.base.options import option, whole_number
from designer.base.words import cut, printable, several, shown
from designer.page.capability import capability, instead
from designer.page.output import Output
from designer.page.progress import Progress, unheard
from designer.page.result import Result

if TYPE_CHECKING:
    from calib.app.inputs import Place
    from calib.core.types import Detections, Observations
    from calib.draw.style import FigureSheet
    from calib.observe.corners_vnl import PointGrid
    from calib.renderer.truth import Truth
    from calib.rigs.result import RigCalibration
    from calib.solver.plan import SolvePlan
    from calib.studies.identity import StudyIdentity
    from calib.studies.rig_bootstrap import PairSpread
    from calib.studies.runner import DrawCount
    from calib.studies.statistics import CaseSummary
    from calib.studies.study_table import StudyCases, StudyTable
    from designer.page.blocks import Page
    from designer.target import TargetGeometry

MOST_SAMPLES, MOST_SIZE, LEAST_FRAMES = 1_000_000, 100_000, 4
RUN_FOLDER = "calibration"
"""How `calib run` calls its folder."""


@dataclass(frozen=True, eq=False)
class Bootstrap(
    StudyResult, kind="bootstrap", title="Bootstrap study",
    files={**TABLES, "study.sqlite": "every sample; the study goes on from it"},
):  # fmt: skip
    """The spread of a camera's errors over samples of its photos: `found.summaries`, `found.save("study")`.

    In a notebook the result shows its page.
    """

    columns = "target,size"
    formats = FORMATS
    table: Annotated["StudyTable", INLINE]  # what the samples say
    cases: Annotated["StudyCases", NOT_IN_FILE]  # the samples
    identity: Annotated["StudyIdentity", NOT_IN_FILE]
    sampled: Annotated["DrawCount", NOT_IN_FILE]
    remarks: Annotated[tuple[str, ...], NOT_IN_FILE]  # on the photos, one line each
    study: Annotated[bytes, NOT_IN_FILE]  # every sample, as `study.sqlite` holds them; b"": it stays where it is
    place: Annotated[str, NOT_IN_FILE]  # its folder, as it is typed

    @property
    def summaries(self) -> "tuple[CaseSummary, ...]":
        """The errors of each size."""
        return self.table.cases

    def save(self, folder: "Place", *, command: str = "", has_page: bool = True) -> tuple[Path, ...]:
        """Write every sample, the tables and the figures; return the files.

        Raises:
            InputError: the folder takes no files, or holds another study.
        """
        place = place_of(folder, "a folder, such as '.'")
        self.check(place)
        path = place / "study.sqlite"
        if self.study and path.exists() and path.read_bytes() != self.study:
            raise InputError(f"{path}: there is another study; choose another folder")
        if self.study and not path.exists():
            write_files({path: self.study})
        return super().save(place, command=command, has_page=has_page)

    def page(self) -> "Page":
        """Errors with their spread, what more views bring, and how parameters go together."""
        from calib.app.bootstrap_page import bootstrap_page

        return bootstrap_page(self)

    def sheets(self) -> "tuple[FigureSheet, ...]":
        """Histograms, correlations, and sigma over the number of views."""
        from calib.app.bootstrap_page import study_sheets

        return tuple(study_sheets(self.cases, self.table))

    def csv(self) -> bytes:
        """A line for each case, error, and set of samples that the statistics are over."""
        from calib.studies.statistics import CaseSummary, Distribution
        from designer.base.codec import encode

        heads = []
        for one in self.table.cases:
            keys = cast("dict[str, JsonValue]", encode(CaseSummary, one))
            del keys["metrics"]
            heads += [keys] * len(one.metrics)
        return rows_to_csv(Distribution, [found for one in self.table.cases for found in one.metrics], heads)


@dataclass(frozen=True, eq=False)
class RigBootstrap(
    Result, kind="rig_bootstrap", title="Bootstrap of a rig",
    files={"study.sqlite": "every sample; the study goes on from it"},
):  # fmt: skip
    """How far samples of a rig scatter: `found.ratio`, `found.pairs[0].baseline_spread_mm`.

    In a notebook the result shows its page.
    """

    program: str
    settings: dict[str, str]
    rig: str
    cameras: tuple[str, ...]
    frames: int
    samples: int  # that were solved
    failed: int  # that do not determine the rig
    ratio: Gap  # spread over stated sigma by the noise, root mean square over places and turns of all pairs
    ratio_of_all: Gap  # over all that is stated, what the target may have done, too; nan: that is not known
    pairs: "tuple[PairSpread, ...]"
    remarks: tuple[str, ...]

    def page(self) -> "Page":
        """Whether the stated sigmas hold, pair by pair."""
        from calib.app.bootstrap_page import rig_bootstrap_page

        return rig_bootstrap_page(self)


def _sizes(text: str) -> tuple[int, ...]:
    """Numbers of views, `20,50,120`."""
    try:
        return tuple(whole_number(word) for word in text.split(","))
    except ValueError:
        raise ValueError(f"must be numbers of views from 1 to {MOST_SIZE}, such as 20,50,120") from None


@capability
def rig_bootstrap(
    rig: Annotated[
        "RigCalibration | Place",
        option("instead: the folder of calib rig, of which frames are drawn", metavar="FOLDER"),
    ],
    *,
    samples: Annotated[int, option("each of as many frames as there are", 2, 100_000)] = 200,
    seed: Seed = 1,
    jobs: Jobs = None,
    dask: Dask = None,
    resume: Resume = False,
    out: Annotated["Place | Output | None", STUDY_OUT] = None,
    progress: Progress = unheard,
) -> RigBootstrap:
    """Solve samples of a rig's frames, drawn with replacement: `rig_bootstrap("rig").ratio`.

    >>> found = calib.rig_bootstrap("rig", samples=100)
    >>> [(one.names, one.baseline_sigma_mm, one.baseline_spread_mm) for one in found.pairs]

    Args:
        rig: a solved rig, or its folder.

    Raises:
        InputError: a folder that cannot be read, a rig that is not determined or that a robot or a table carried, or
            too few frames.
        StudyStoppedError: interrupted; the samples in a folder are kept.
    """
    import numpy as np

    from calib.rigs.result import RigCalibration
    from calib.rigs.rig_calibration_file import read_rig
    from calib.solver.problem import SolveOptions
    from calib.studies import rig_bootstrap as frames_drawn
    from calib.studies.samples import Case
    from calib.studies.workers import CaseSpec

    options = SolveOptions()
    if isinstance(rig, RigCalibration):
        name, found = "the rig", rig
    else:
        name, (found, provenance) = str(rig), read_rig(Path(rig))
        options = provenance.options
    frames = found.observations.frame_count
    if len(found.cameras) < 2 or found.carrier is not None:
        raise InputError(f"{name}: samples are drawn of rigs of two cameras or more, without a robot or a turntable")
    if found.status == "degenerate":
        raise InputError(f"{name}: its frames do not determine the cameras ({found.remarks[0]}); take more first")
    if frames < LEAST_FRAMES:
        raise InputError(
            f"{name}: {frames} frames; samples need at least {LEAST_FRAMES}, and say little of fewer than 20"
        )
    if found.delay_s is not None:
        raise InputError(f"{name}: its time offsets were estimated, which needs the frames in their order")
    output = RigBootstrap.begun(out)
    pool = frames_drawn.frame_pool(found, options)
    case = CaseSpec(Case("rig", frames, frames), pool, samples)
    identity = frames_drawn.identity(pool, seed)
    drawn = kept_samples(case, identity, output, jobs, dask, resume=resume, progress=progress)
    has_rig, is_lost = drawn.status != "failed", np.isin(drawn.status, ("failed", "degenerate"))
    pairs = frames_drawn.rig_spread(found, drawn)
    result = RigBootstrap(
        program=program(), settings={"samples": str(samples), "seed": str(seed)}, rig=printable(Path(name).name),
        cameras=tuple(map(printable, found.observations.camera_names)), frames=frames,
        samples=int(has_rig.sum()), failed=int(is_lost.sum()),
        ratio=frames_drawn.spread_ratio(pairs), ratio_of_all=frames_drawn.spread_ratio(pairs, of_all=True), pairs=pairs,
        remarks=found.observations.remarks,
    )  # fmt: skip
    return result.saved(output, progress)


@instead(rig=rig_bootstrap)
@capability
def bootstrap(
    detections: Annotated[
        "Observations | Place | Iterable[Detections]",
        option("detections.csv, a CSV with image,u,v,X,Y,Z, or a corners.vnl", metavar="FILE"),
    ],
    target: Annotated["TargetGeometry | Place | None", option("the target file of detections.csv")] = None,
    *,
    truth: Annotated["Truth | Place | None", option("truth.json of rendered photos: adds the error of poses")] = None,
    sizes: Annotated[Sequence[int], option("views of a sample, drawn with replacement", parse=_sizes)] = (20, 50, 120),
    samples: Annotated[int, option("of each size", 1, MOST_SAMPLES)] = 10_000,
    model: Annotated[
        str, option(f"{', '.join(solved_models())} ({', '.join(learned_models())} is slow)", names=solved_models)
    ] = DEFAULT,
    weighted: Weighted = True,
    fix: Fix = (),
    share: Share = (),
    loss: Loss = "squares",
    reject_sigma: Reject = None,
    image_size: ImageSize = None,
    grid: Grid = None,
    pitch_mm: Pitch = None,
    seed: Seed = 1,
    jobs: Jobs = None,
    dask: Dask = None,
    resume: Resume = False,
    out: Annotated["Place | Output | None", STUDY_OUT] = None,
    progress: Progress = unheard,
) -> Bootstrap:
    """Draw views with replacement, calibrate and measure, thousands of times: `bootstrap("d.csv", "t.target.json")`.

    Errors with their spread.

    Args:
        detections: a file of observations, what was found in photos, or observations.
        target: that they show; None: points from elsewhere.

    Raises:
        InputError: files or options that break a rule, photos too few, or no workers are left; the samples in a folder
            are kept.
        StudyStoppedError: interrupted; so they are.
    """
    from calib.app.inputs import file_or_observations, target_of, truth_from
    from calib.core.types import Observations
    from calib.renderer.quantities import whole
    from calib.renderer.truth import Truth
    from calib.solver.plan import plan_from_words
    from calib.studies import bootstrap as pools
    from calib.studies.identity import identity_of, photos_read
    from calib.studies.samples import Case
    from calib.studies.workers import CaseSpec

    plan = plan_from_words(
        model, fix=fix, share=share, focal_px=None, loss=loss, reject=reject_sigma, weighted=weighted
    )
    views = [whole("--sizes", size, 1, MOST_SIZE) for size in several("--sizes", sizes)]
    corners = grid_of(grid, pitch_mm)
    if len(set(views)) < len(views):
        raise InputError(f"--sizes {', '.join(map(str, views))}: a size stands there twice; give each once")
    output = Bootstrap.begun(out)
    if isinstance(detections, Observations) and target is not None:
        raise InputError(f"target {shown(target)}: is of a file, or of detections; observations say it; leave it out")
    observations = file_or_observations(detections, target, image_size, grid, pitch_mm)
    known = truth_from(truth)
    if known is not None and target is not None and known.layout_id != target_of(target).layout_id:
        told = "the truth" if isinstance(truth, Truth) else truth
        raise InputError(f"{told}: of photos of another target; give the truth.json beside the photos")
    name = _name_of(*(one for one in (target, detections) if isinstance(one, str | PathLike)))
    kept = {"model": model, "name": name, **_settings(plan, image_size, corners)}
    identity = identity_of(seed, kept, photos_read(observations, detections, target=target, truth=truth))
    with sampling_in(output, jobs, dask, resume=resume, progress=progress) as sampling:
        sampling.check(identity)
        progress("solving all views", 0, 0)
        pool = pools.make_pool(observations, model, plan.options_of(model), known)
        for size in views:
            pools.require_enough(pool, size)
        cases = [CaseSpec(Case(name, size, pool.view_count), pool, samples) for size in views]
        if output is not None:
            output.finished.append(sampling.path)
        sampled = sampling.run(identity, cases)
        found = sampled_study(sampling.path, sampled, (*observations.remarks, *pool.remarks))
    return found.saved(output, progress)


def sampled_study(path: Path, sampled: "DrawCount", remarks: Sequence[str]) -> Bootstrap:
    """What the samples say that are kept now."""
    from calib.studies.store import read_study
    from calib.studies.study_table import cases_of, study_table

    with read_study(path) as study:
        cases, identity, mixed = cases_of(study), study.identity, study.mixed_programs()
    said, place = (*remarks, *mixed), str(path.parent)
    return Bootstrap(study_table(cases), cases, identity, sampled, said, path.read_bytes(), place)


def _settings(plan: "SolvePlan", image_size: tuple[int, int] | None, grid: "PointGrid | None") -> dict[str, str]:
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


def _name_of(*places: "Place") -> str:
    """What a target is called in tables: after the first file there is."""
    from calib.studies.statistics import TARGETS

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
