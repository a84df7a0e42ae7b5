"""From the photos of several cameras to a judged rig: what `calib rig` does."""

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from os import fspath

from calib.api.rig_choosing import CameraWishes, choices_of, require_wishes, wishes_of
from calib.api.rig_observing import RigInput, RigSearch, photos_of_rig, rig_input, search_rig, with_remarks
from calib.api.rig_result import RigResult, RigWriter
from calib.app.inputs import Place, folder_of, require_photos_for_jobs, target_of
from calib.cameras.camera import Camera
from calib.core.types import RigObservations
from calib.observe.rig_observations import swapped_cameras
from calib.observe.rig_sightings import read_rig_sightings
from calib.rigs.bent import with_bend_error
from calib.rigs.circle_doubt import with_circle_doubt
from calib.rigs.halves import RigHalves, half_solver, rig_halves
from calib.rigs.options import RigOptions
from calib.rigs.shared_errors import with_shared_errors
from calib.rigs.solve import solve_rig
from calib.rigs.target_error import with_target_error
from calib.solver.costs import IMAGE
from calib.solver.options import SolveOptions
from calib.solver.plan import ALL, plan_from_words
from calib.solver.plane_bend import PlaneBend
from calib.verdict.criteria import STANDARD, read_rig_criteria
from calib.verdict.rig_judge import judge_rig
from calib.verdict.verdict import Criteria
from designer.base.errors import InputError
from designer.base.small_file import place_of
from designer.base.words import shown, suggestion
from designer.page.progress import Progress, unheard
from designer.target import TargetGeometry
from designer.tolerance.made import Made, how_made


def rig(
    observed: RigObservations | TargetGeometry | Place | None,
    photos: Place | Iterable[Place] = (),
    *,
    table: Place | None = None,
    pattern: str | None = None,
    times: Place | None = None,
    tolerance_s: float | None = None,
    points: str | None = None,
    diameter_mm: float | None = None,
    model: str | Mapping[str, str] = ALL,
    cameras: Mapping[str, Camera | Place] | None = None,
    refine: bool | Collection[str] = False,
    fix: Sequence[str] = (),
    reference: str | None = None,
    loss: str = "squares",
    reject_sigma: float | None = None,
    weighted: bool = True,
    minimise: str = IMAGE,
    delays: bool = False,
    made: str | None = None,
    criteria: Criteria | Place = STANDARD,
    jobs: int | None = None,
    progress: Progress = unheard,
    out: RigWriter | Place | None = None,
    settings: Sequence[tuple[str, str]] = (),
) -> RigResult:
    """Solve where cameras stand that saw one target together: `rig("ico.target.json", ["left", "right"])`.

    >>> found = calib.rig("ico.target.json", ["left", "right"])
    >>> found.verdict.grade, found.rig.names, found.rig.center_mm

    Args:
        observed: what the photos show, a geometry or its file; or observations; None: a table of sightings has points.
        photos: a folder a camera, or one that holds such folders.
        table: instead of photos, of files (camera,frame,file) or of sightings (camera,frame,u,v,X,Y,Z).
        pattern: of file names in one folder: `{camera}_{frame}.png`.
        times: a table of time stamps (camera,file,time_s) that tell which photos were taken at once.
        tolerance_s: photos within it are a frame; None: 0.02, where time stamps have to tell.
        points: what the points of a table of sightings are: `corner`, `ring` or `circle`; None: as it says itself.
        diameter_mm: of circles.
        model: of all cameras, or of each by its name; `all` chooses for each.
        cameras: lenses from earlier runs, by the cameras' names: cameras, or their files.
        refine: solve all of these on, or some by name; else they are kept.
        fix: parameters to keep: `k3`, `k3=0`, or of one camera `left:k3=0`.
        reference: the camera whose frame is the rig's; None: the first.
        loss: as for `run`, like all options that are named alike.
        reject_sigma: leave out what is farther off.
        weighted: by covariances, or all alike.
        minimise: distances in the image, or in space.
        delays: estimate each camera's time offset, from time stamps of a target that moves.
        made: how the target was made.
        criteria: limits of the verdict: a template's name, a file, or criteria.
        jobs: photos at a time; None: one per core.
        progress: is told what is being done.
        out: a folder to write everything to.
        settings: names and values to keep in the record.

    Raises:
        InputError: files or options that break a rule, or cameras that no frames tie together.
        BlindCameraError: a camera sees the target in no photo.
    """
    plan = plan_from_words(
        ALL, fix=(), share=(), focal_px=None, loss=loss, reject=reject_sigma, weighted=weighted, minimise=minimise
    )
    limits = criteria if isinstance(criteria, Criteria) else read_rig_criteria(_criteria_name(criteria))
    wishes = wishes_of(model, cameras, refine, fix, plan.options)
    writer = out if out is None or isinstance(out, RigWriter) else RigWriter(folder_of(out))
    target, search, observations = _observed(
        observed, rig_input(photos, table, pattern, times, tolerance_s), (points, diameter_mm), wishes, jobs, progress
    )
    way = how_made(target, made, rendered_id="" if search is None else search.rendered_id)
    options = _options(plan.options, observations, reference, delays=delays)
    observations = with_remarks(observations, swapped_cameras(observations, wishes.given))
    result = judged_rig(RigSeen(target, search, observations, way), wishes, options, limits, progress, tuple(settings))
    if writer is not None:
        progress("writing", 0, 0)
        writer.write(result)
        if not isinstance(out, RigWriter) and (remark := writer.write_page(result, "")):
            raise InputError(remark)
    return result


@dataclass(frozen=True, eq=False)
class RigSeen:
    """What a rig is solved from, and what it was seen of."""

    target: TargetGeometry | None
    search: RigSearch | None
    observations: RigObservations
    made: Made | None
    bend: PlaneBend | None = None  # by which the points were moved; None: they are as the target's file says


def judged_rig(
    seen: RigSeen, wishes: CameraWishes, options: RigOptions, limits: Criteria, progress: Progress,
    settings: tuple[tuple[str, str], ...],
) -> RigResult:  # fmt: skip
    """Solve a rig and judge it, whatever moves it or its target.

    Raises:
        InputError: cameras that no frames tie together, or that cannot be solved.
    """
    choices, said = choices_of(seen.observations, wishes, progress)
    observations = with_remarks(seen.observations, said)
    progress("solving", 0, 0)
    solved = solve_rig(observations, choices, options)
    stated = with_circle_doubt(with_bend_error(with_target_error(solved, seen.made), seen.bend))
    found = with_shared_errors(stated)
    progress("judging", 0, 0)
    halves = rig_halves(found, half_solver(found, choices, options))
    if isinstance(halves, RigHalves) and halves.has_moved:  # which may look like anything that photos share
        found = replace(found, remarks=stated.remarks)
    judged = judge_rig(found, halves, limits)
    return RigResult(
        seen.target, seen.search, observations, choices, found, judged, seen.made, settings, wishes.options
    )


def _criteria_name(criteria: Place) -> str:
    place_of(criteria, "a template's name, or a TOML file")
    return fspath(criteria)


def _observed(
    observed: RigObservations | TargetGeometry | Place | None,
    given: RigInput,
    kind: tuple[str | None, float | None],
    wishes: CameraWishes,
    jobs: int | None,
    progress: Progress,
) -> tuple[TargetGeometry | None, RigSearch | None, RigObservations]:
    """What was seen, of which target, and in which photos."""
    if kind != (None, None) and not given.has_sightings:
        raise InputError("--points: says what the points of a table of sightings are; leave it out")
    if isinstance(observed, RigObservations):
        require_photos_for_jobs(jobs)
        if given.is_anything or given.needless:
            raise InputError("observations: are all there is to solve from; leave photos and tables out")
        require_wishes(wishes, observed.camera_names)
        return None, None, observed
    if not given.is_anything:
        raise InputError("no photos; give a folder a camera, or --table files.csv, or --table sightings.csv")
    if given.has_sightings and given.table is not None:
        require_photos_for_jobs(jobs)
        if given.needless:
            raise InputError(
                f"{given.needless}: is of photos; {given.table} holds sightings, which say their frames and, in a "
                "column time_s, their times; leave it out"
            )
        target = None if observed is None else target_of(observed)
        seen = read_rig_sightings(given.table, target, points=kind[0], diameter_mm=kind[1])
        require_wishes(wishes, seen.camera_names)
        return target, None, seen
    if observed is None:
        raise InputError("no target; give the target file of what the photos show")
    target = target_of(observed, "rings")
    photos = photos_of_rig(given)
    require_wishes(wishes, photos.camera_names)
    search, seen = search_rig(target, photos, wishes.given, wishes.plan_of, jobs, progress)
    return target, search, seen


def _options(
    options: SolveOptions, observations: RigObservations, reference: str | None, *, delays: bool
) -> RigOptions:
    """How the cameras are solved together."""
    names = observations.camera_names
    if reference is not None and reference not in names:
        hint = suggestion(reference, list(names)) or f"; there are {', '.join(names)}"
        raise InputError(f"--reference {shown(reference)}: no such camera{hint}")
    if delays and observations.time_s is None:
        raise InputError(
            "--delays: time offsets are told by time stamps; give them in a column time_s, or with --times"
        )
    return RigOptions(
        reference=0 if reference is None else names.index(reference),
        weighted=options.weighted,
        loss=options.loss,
        reject_sigma=options.reject_sigma,
        estimates_delays=delays,
        minimise=options.minimise,
    )
