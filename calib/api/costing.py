"""Which distances to minimise, measured: what `calib study cost` does."""

from collections.abc import Sequence
from dataclasses import dataclass
from os import PathLike
from pathlib import Path

from calib.api.bootstrapping import Sampling
from calib.api.page_shown import ShownAsPage
from calib.app.inputs import (
    MAX_SEED,
    Observed,
    Place,
    load_observations,
    observations_of,
    processes_of,
)
from calib.cameras import DEFAULT, fitted_models
from calib.core.types import Observations
from calib.observe.corners_vnl import PointGrid
from calib.renderer.quantities import whole
from calib.show.studies.study_folder import STUDY_FILE
from calib.studies.cost import cases
from calib.studies.cost.results import CostTable, table_of
from calib.studies.identity import digest_of, sha256_of
from calib.studies.progress import DrawCount
from calib.studies.store import read_study
from designer.base.errors import InputError
from designer.base.files import check_folder, write_files
from designer.base.words import cut, printable, shown, suggestion
from designer.page.progress import Progress, unheard
from designer.target import TargetGeometry

MAX_SETS, MAX_STARTS = 10_000, 100_000
USUAL, QUICK = (30, 60), (8, 20)
"""Sets and starts; such as are enough to see which way it goes."""
OWN = "own photos"


@dataclass(frozen=True, eq=False)
class CostResult(ShownAsPage):
    """Each cost against the distances in the image: `found.table.compared("ray")`, `found.save("cost")`.

    In a notebook the result shows its page.
    """

    table: CostTable
    sampled: DrawCount
    kind = "cost"

    def save(self, folder: Place) -> tuple[Path, ...]:
        """Write the tables and the figures; return the files."""
        from calib.show.studies.cost_page import cost_files

        files = cost_files(self.table, Path(folder))
        write_files(files)
        return tuple(files)


def study_cost(
    folder: Place,
    observed: Observed | None = None,
    target: TargetGeometry | Place | None = None,
    *,
    model: str | None = None,
    sets: int | None = None,
    starts: int | None = None,
    quick: bool = False,
    image_size: tuple[int, int] | None = None,
    grid: PointGrid | None = None,
    seed: int = 1,
    jobs: int | None = None,
    resume: bool = False,
    progress: Progress = unheard,
) -> CostResult:
    """Measure which distances are best minimised, in the image or in space: `study_cost("cost").save("cost")`.

    >>> found = calib.study_cost("cost", "detections.csv", "ico.target.json", model="opencv")
    >>> [row.ratio for row in found.table.compared("ray") if row.measure == "held_out_mm"]

    Args:
        folder: where every set of photos is kept, so that a stopped study goes on.
        observed: photos of one's own too, of which each is held out in turn; None: simulated ones alone.
        target: that these show; None: points from elsewhere.
        model: that they are solved with; None: the usual one.
        sets: of simulated photos of each scene and condition; None: 30, or quick 8.
        starts: bad ones of each scene; None: 60, or quick 20.
        quick: 8 sets and 20 starts, where nothing else is said.
        image_size: of a file that does not say it.
        grid: of a `corners.vnl`.
        seed: of all that is random.
        jobs: processes; None: one per core.
        resume: go on with the study in the folder.
        progress: is told what is being done.

    Raises:
        InputError: numbers, photos or a folder that cannot be used.
        StudyStoppedError: interrupted; what is finished is kept.
    """
    processes, seed = processes_of(jobs), whole("--seed", seed, 0, MAX_SEED)
    usual = QUICK if quick else USUAL
    sets, starts = (
        whole("--sets", usual[0] if sets is None else sets, 3, MAX_SETS),
        whole("--starts", usual[1] if starts is None else starts, 1, MAX_STARTS),
    )
    check_folder(Path(folder))
    real = None
    digests: tuple[tuple[str, str], ...] = ()
    if observed is not None:
        real = _real_photos(observed, target, model or DEFAULT, image_size, grid)
        digests = _digests(observed, target, real.observations)
    elif of_photos := [
        option
        for option, one in (("--target", target), ("--model", model), ("--image-size", image_size), ("--grid", grid))
        if one is not None
    ]:
        raise InputError(f"{of_photos[0]}: says nothing without photos of your own; give --detections too")
    plan = cases.CostPlan(sets, starts, seed, *(("", "") if real is None else (real.name, real.model)))
    identity = cases.identity(plan, digests)
    sampling = Sampling(Path(folder) / STUDY_FILE, processes, None, resume, progress)
    sampling.check(identity)
    progress("placing cameras", 0, 0)
    groups = cases.groups_of(plan, real)
    sampled = sampling.run(identity, [(group.specs, group.samples) for group in groups])
    with read_study(sampling.path) as study:
        return CostResult(table_of(study, plan, groups), sampled)


def _real_photos(
    observed: Observed, target: TargetGeometry | Place | None, model: str,
    image_size: tuple[int, int] | None, grid: PointGrid | None,
) -> cases.RealPhotos:  # fmt: skip
    """Photos of a person's own, and how they are solved.

    Raises:
        InputError: they cannot be read, or there is no such model.
    """
    if model not in fitted_models():
        hint = suggestion(str(model), list(fitted_models())) or f"; there are {', '.join(fitted_models())}"
        raise InputError(f"--model {shown(str(model))}: none that is solved by one descent{hint}")
    if isinstance(observed, str | PathLike):
        name = cut(printable(Path(observed).name)) or OWN
        seen = load_observations(observed, target, image_size=image_size, grid=grid)
        return cases.RealPhotos(name, seen, model)
    return cases.RealPhotos(OWN, observations_of(observed, target), model)


def _digests(
    observed: Observed, target: TargetGeometry | Place | None, seen: Observations
) -> tuple[tuple[str, str], ...]:
    """What tells these photos from others."""
    named: Sequence[tuple[str, object]] = (("detections", observed), ("target", target))
    found = tuple((name, sha256_of(Path(one))) for name, one in named if isinstance(one, str | PathLike))
    return found if dict(found).get("detections") else (("detections", digest_of(seen)), *found)
