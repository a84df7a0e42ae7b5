"""From the photos of several cameras to a judged rig: `calib rig`, `calib.rig("t.json", ["left", "right"])`."""

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Annotated, TypeVar

from calib.app.options import FreeBend, Limits, Loss, Made, Minimise, PhotoJobs, Points, Reject, Weighted
from calib.app.solved_rig import SolvedRig, begun, finished, folder_for, settings_of
from designer.base.errors import InputError
from designer.base.options import argument, option
from designer.base.units import parse_quantity
from designer.base.words import shown, suggestion_or_all
from designer.page.capability import capability, written_to
from designer.page.progress import Progress, unheard

if TYPE_CHECKING:
    from calib.app.inputs import Pixels, Place
    from calib.cameras.camera import Camera
    from calib.core.types import RigObservations
    from calib.judge.joint_solution import CameraWishes, RigSeen
    from calib.observe.rig_search import RigInput
    from calib.rigs.problem import RigOptions
    from calib.solver.problem import SolveOptions
    from designer.page.output import Output
    from designer.target import TargetGeometry

T = TypeVar("T")

S_PER_UNIT = {"s": 1.0, "ms": 1e-3, "us": 1e-6}
LONGEST_S = 3600.0


def _seconds(text: str) -> float:
    return parse_quantity(text, S_PER_UNIT, "a time such as 20ms", LONGEST_S)


@capability(folder=lambda given: folder_for("rig", given, "observed"))
def rig(
    observed: Annotated[
        "RigObservations | TargetGeometry | Place | None",
        argument("the target file of what the photos show (a table of sightings needs none)", metavar="[TARGET]"),
    ] = None,
    photos: Annotated[
        "Place | Iterable[Place]",
        argument(
            "a folder or a clip a camera, one folder that holds these, or a robot's bag",
            is_many=True,
            metavar="FOLDER...",
        ),
    ] = (),
    *,
    images: "Mapping[str, Iterable[Pixels]] | None" = None,
    table: Annotated[
        "Place | None",
        option("instead of photos: files (camera,frame,file[,time_s]) or sightings (camera,frame,u,v,X,Y,Z)"),
    ] = None,
    pattern: Annotated[str | None, option("file names of all cameras in one folder: '{camera}_{frame}.png'")] = None,
    times: Annotated[
        "Place | None", option("time stamps (camera,file,time_s), which tell what was taken at once")
    ] = None,
    topics: Annotated[
        str | Sequence[str] | None,
        option(
            "of a robot's bag, instead of folders: a topic a camera, joined by time stamps", metavar="A,B", parse=str
        ),
    ] = None,
    tolerance_s: Annotated[
        float | None,
        option("of time stamps of one frame (default where they have to tell: 20ms)", 1e-6, LONGEST_S, parse=_seconds),
    ] = None,
    points: Points = None,
    diameter_mm: float | None = None,
    model: Annotated[
        "str | Mapping[str, str] | Sequence[str]",
        option(
            "of all cameras, or of one: left=fisheye (default: opencv, of a wide lens what leaves least)", is_many=True
        ),
    ] = (),
    cameras: Annotated[
        "Mapping[str, Camera | Place] | Sequence[str]",
        option(
            "a camera's lens from an earlier run, which is kept: left=left/camera.json", flag="--camera", is_many=True
        ),
    ] = (),
    refine: Annotated[
        "bool | Collection[str]",
        option("solve the lens of this camera on from the one that is given; or all", is_many=True),
    ] = (),
    fix: Annotated[Sequence[str], option("keep a parameter: k3, k3=0, of one camera left:k3=0", is_many=True)] = (),
    priors: Annotated[
        "Mapping[str, tuple[float, float]] | Sequence[str]",
        option(
            "what is known of a parameter, its value with a standard deviation: fx=1250+-10px, of one camera "
            "left:fx=1250+-1%",
            flag="--prior",
            is_many=True,
            parse=str,
            metavar="NAME=VALUE+-SIGMA",
        ),
    ] = (),
    reference: Annotated[str | None, option("camera whose frame the rig's is (default: the first)")] = None,
    loss: Loss = "squares",
    reject_sigma: Reject = None,
    weighted: Weighted = True,
    minimise: Minimise = "image",
    free_bend: FreeBend = None,
    delays: Annotated[bool, option("estimate how late each camera is, from time stamps of a moving target")] = False,
    made: Made = None,
    criteria: Limits = "standard",
    jobs: PhotoJobs = None,
    out: Annotated["Output | Place | None", written_to("folder (default: exports/NAME/rig, or rig)")] = None,
    progress: Progress = unheard,
) -> SolvedRig:
    """Solve where several cameras stand that saw one target together: `rig("ico.target.json", ["left", "right"])`.

    Also their lenses, and how surely all that is known. The exit code is 1 if the frames do not determine the rig, or
    if the verdict is: do not use.

    >>> found = calib.rig("ico.target.json", ["left", "right"])
    >>> found.verdict.grade, found.rig.names, found.rig.center_mm

    Args:
        observed: what the photos show, a geometry or its file; or observations; None: a table of sightings has points.
        diameter_mm: of circles.
        cameras: lenses from earlier runs, by the cameras' names: cameras, or their files.
        images: instead of photos arrays (H, W) or (H, W, 3) by the cameras' names; the first of each are a frame, ...
        refine: solve all of these on, or some by name; else they are kept.

    Raises:
        InputError: files or options that break a rule, or cameras that no frames tie together.
    """
    from calib.app.inputs import criteria_of, load_camera, points_of, with_bag
    from calib.judge.joint_solution import judged_rig, wishes_of
    from calib.observe.rig_observations import swapped_cameras, with_remarks
    from calib.observe.rig_photos import photos_of_images
    from calib.observe.rig_search import rig_input
    from calib.solver.plan import ALL, plan_from_words
    from calib.solver.priors import texts_of

    plan = plan_from_words(
        ALL, loss=loss, reject=reject_sigma, weighted=weighted, minimise=minimise, free_bend=free_bend
    )
    limits = criteria_of(criteria)
    lenses = {name: load_camera(one) for name, one in _of_each("--camera", cameras, "left=left/camera.json").items()}
    is_all = isinstance(refine, Collection) and tuple(refine) == (ALL,)
    wishes = wishes_of(_models(model), lenses, is_all or refine, fix, plan.options, texts_of(priors))
    to = begun(out)
    given = rig_input(photos, table, pattern, times, tolerance_s)
    if images is not None and (given.is_anything or given.needless):
        raise InputError("images: are all there is to solve from; leave photos and tables out")
    given = given if images is None else replace(given, images=photos_of_images(images))
    given = with_bag(given, topics.split(",") if isinstance(topics, str) else topics)
    seen = _seen(observed, given, points_of(points, diameter_mm), wishes, jobs, progress).with_made(made)
    options = _options(plan.options, seen.observations, reference, delays=delays)
    seen = replace(seen, observations=with_remarks(seen.observations, swapped_cameras(seen.observations, lenses)))
    settings = settings_of(("target", observed), *(("photos", one) for one in given.photos), ("table", given.table))
    settings = settings if made is None else (*settings, ("made", made))
    return finished(SolvedRig(*judged_rig(seen, wishes, options, limits, settings, progress)), to, out, progress)


def _of_each(flag: str, given: "Mapping[str, T] | Sequence[str]", example: str) -> "dict[str, T | str]":
    """What is given for cameras by their names, or in texts as in `left=fisheye`."""
    from calib.observe.rig_observations import require_names

    if isinstance(given, Mapping):
        return dict(given)
    pairs = [text.partition("=") for text in given]
    for (name, equals, value), text in zip(pairs, given, strict=True):
        if not (equals and name and value):
            raise InputError(f"{flag} {shown(text)}: needs a camera's name, as in {example}")
    if len(pairs) > 1:
        require_names([name for name, _, _ in pairs])
    return {name: value for name, _, value in pairs}


def _models(model: "str | Mapping[str, str] | Sequence[str]") -> str | dict[str, str]:
    """A model for all cameras, or by their names."""
    if isinstance(model, str):
        return model
    plain = [] if isinstance(model, Mapping) else [text for text in model if "=" not in text]
    if len(plain) > 1 or (plain and len(model) > 1):
        raise InputError(f"--model {shown(plain[-1])}: give one for all cameras, or each its own as in left=fisheye")
    return plain[0] if plain else _of_each("--model", model, "left=fisheye") if model else "all"


def _seen(
    observed: "RigObservations | TargetGeometry | Place | None", given: "RigInput",
    kind: tuple[str | None, float | None], wishes: "CameraWishes", jobs: int | None, progress: Progress,
) -> "RigSeen":  # fmt: skip
    """What was seen, of which target, and in which photos."""
    from calib.app.inputs import require_photos_for_jobs, target_of
    from calib.capture.clips import clips_of_rig
    from calib.core.types import RigObservations
    from calib.judge.joint_solution import RigSeen, require_wishes
    from calib.observe.rig_observations import read_rig_sightings
    from calib.observe.rig_search import observations_of_rig, photos_of_rig, search_cameras

    if kind != (None, None) and not given.has_sightings:
        raise InputError("--points: says what the points of a table of sightings are; leave it out")
    if isinstance(observed, RigObservations):
        require_photos_for_jobs(jobs)
        if given.is_anything or given.needless:
            raise InputError("observations: are all there is to solve from; leave photos and tables out")
        require_wishes(wishes, observed.camera_names)
        return RigSeen(observed)
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
        return RigSeen(seen, target)
    if observed is None:
        raise InputError("no target; give the target file of what the photos show")
    target = target_of(observed, "rings")
    photos = clips_of_rig(given, target, progress) or photos_of_rig(given)
    require_wishes(wishes, photos.camera_names)
    search = search_cameras(target, photos, wishes.given, wishes.plan_of, jobs, progress)
    return RigSeen(observations_of_rig(search), target, search)


def _options(
    options: "SolveOptions", observations: "RigObservations", reference: str | None, *, delays: bool
) -> "RigOptions":
    """How the cameras are solved together."""
    from calib.rigs.problem import RigOptions

    names = observations.camera_names
    if reference is not None and reference not in names:
        hint = suggestion_or_all(reference, names)
        raise InputError(f"--reference {shown(reference)}: no such camera{hint}")
    if delays and observations.time_s is None:
        raise InputError(
            "--delays: time offsets are told by time stamps; give them in a column time_s, or with --times"
        )
    return RigOptions(
        reference=0 if reference is None else names.index(reference), weighted=options.weighted, loss=options.loss,
        reject_sigma=options.reject_sigma, estimates_delays=delays, minimise=options.minimise,
    )  # fmt: skip
