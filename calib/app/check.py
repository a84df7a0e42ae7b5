"""Whether cameras are still as their file says: `calib check`, `calib.check("camera.json", "t.json", "photos")`."""

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from os import PathLike, fspath
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal, cast

from calib.app.options import Made, PhotoJobs
from designer.base.errors import InputError
from designer.base.files import place_of
from designer.base.marks import NOT_IN_FILE, Gap
from designer.base.options import argument, option
from designer.base.words import figure, printable
from designer.page.capability import capability
from designer.page.progress import Progress, unheard
from designer.page.result import Result

if TYPE_CHECKING:
    from calib.app.calibration import Run
    from calib.app.check_history import PastCheck
    from calib.app.inputs import Place
    from calib.app.solved_rig import SolvedRig
    from calib.cameras.camera import Camera
    from calib.cameras.rig import Rig
    from calib.core.types import Detections, Observations, RigObservations
    from calib.judge.drift import DriftHypothesis, DriftTest, LeftOut
    from calib.judge.reference import Reference
    from calib.observe.photos import Search
    from calib.rigs.result import RigCalibration
    from calib.solver.calibration import Calibration, PlaneBend
    from designer.page.blocks import Page
    from designer.target import TargetGeometry

Verdict = Literal["yes", "no", "cannot say"]
MOST_NAMED, MISFITS, SURELY_FREE = 6, 1.2, 4.0
TABLES = (".csv", ".vnl")
NO_SIGMA = (
    "the file does not say how sure it is: it is taken to be as sure as from 20 photos such as these; a no may also "
    "mean that it never was better"
)
NOT_AS_SOLVED = "the file says something else than the calibration beside it, which tells how sure it may be"
UNITS: Mapping[str, tuple[float, str]] = {
    "focal length": (100.0, "%"), "size": (100.0, "%"), "turn": (180 / math.pi, "deg"),
    "principal point": (1.0, "px"), "shift": (1.0, "mm"),
}  # fmt: skip
"""Of what is told: what its numbers are multiplied by, and the unit then."""
TOLD = ("focal length", "principal point", "turn", "shift")


@dataclass(frozen=True, eq=False)
class Change:
    """What the photos say of one change, as if it were the only one; nan where they tell nothing."""

    camera: str
    what: str  # "focal length", "principal point", and of a rig's camera "turn", "shift"
    unit: str
    amount: tuple[Gap, ...]  # of vectors along the camera's x, y, z
    sigma: tuple[Gap, ...]
    visible: Gap  # the least that would be found with 95 %

    @property
    def size(self) -> float:
        """The amount, or the length of a vector."""
        return self.amount[0] if len(self.amount) == 1 else math.hypot(*self.amount)

    @property
    def size_sigma(self) -> float:
        """The standard deviation of the size."""
        parts = (one * error for one, error in zip(self.amount, self.sigma, strict=True))
        return math.hypot(*parts) / max(abs(self.size), 1e-300)

    @property
    def text(self) -> str:
        """The size with its standard deviation."""
        sign = "" if len(self.amount) > 1 else "+" if self.size >= 0 else "-"
        return f"{sign}{figure(abs(self.size), 3)} \N{PLUS-MINUS SIGN} {figure(self.size_sigma, 2)} {self.unit}"


@dataclass(frozen=True)
class Cause:
    """What explains all that is seen."""

    camera: str  # "": the target
    what: str
    text: str


@dataclass(frozen=True, eq=False)
class CameraCheck(Result, kind="check", title="Check", doing="checking", files={}):
    """Whether cameras are as their file says: `found.verdict`, `found.changes[0].amount`."""

    verdict: Verdict
    reason: str
    p: Gap  # probability of photos like these if nothing changed
    false_alarms: float
    checked: str  # the file
    changes: tuple[Change, ...]
    causes: tuple[Cause, ...]  # one: it is that; several: these photos do not tell them apart; none: none explains it
    photos: tuple[str, ...]  # that counted; of a rig frames
    left_out: "tuple[LeftOut, ...]"
    remarks: tuple[str, ...]
    history: Annotated["tuple[PastCheck, ...]", NOT_IN_FILE] = ()
    test: Annotated["DriftTest | None", NOT_IN_FILE] = None
    image_sizes: Annotated[tuple[tuple[int, int], ...], NOT_IN_FILE] = ()

    @property
    def is_negative(self) -> bool:
        """Whether the answer is not yes: nothing that nobody knows passes a cron job."""
        return self.verdict != "yes"

    @property
    def remedy(self) -> str:
        """What to do before it is asked again."""
        if self.verdict == "no":
            return "solve again what is not as it was"
        return "" if self.verdict == "yes" else "take more photos: near, tilted by 20 to 50 deg, all over the image"

    def page(self) -> "Page":
        """The verdict with its numbers, residuals, and earlier checks."""
        from calib.app.check_page import check_page

        return check_page(self, is_drawn=True)

    def words(self, page: "Page | None" = None) -> "Page":
        """The same without figures."""
        from calib.app.check_page import check_page

        return check_page(self, is_drawn=False)


@capability
def check(
    camera: Annotated[
        "Camera | Rig | Calibration | RigCalibration | Run | SolvedRig | Place",
        argument("camera or rig file, or the folder of a calibration, which knows best", metavar="CAMERA|RIG"),
    ],
    target: Annotated[
        "TargetGeometry | Place | None",
        argument("the target file (NAME.target.json) of what the photos show; a table with X, Y, Z needs none"),
    ] = None,
    photos: Annotated[
        "Observations | RigObservations | Place | Iterable[Place | Detections]",
        argument("photos; of a rig a folder a camera, or one that holds these; or a table of sightings", is_many=True),
    ] = (),
    *,
    false_alarms_share: Annotated[
        float, option("how often a camera that is as its file says may be called changed", 0.001, 0.5)
    ] = 0.01,
    focal_percent: Annotated[
        float, option("a change of the focal length that matters: else it cannot be said", 1e-4, 100)
    ] = 0.1,
    turn_deg: Annotated[
        float, option("a turn of a rig's camera that matters; also a shift that moves its picture as far", 1e-4, 90)
    ] = 0.05,
    pattern: Annotated[
        str | None, option("of a rig: file names of all cameras in one folder: '{camera}{frame}.jpg'")
    ] = None,
    history: Annotated[
        "Place | None", option("folder with a table of all checks, to which this is added", metavar="DIR")
    ] = None,
    made: Made = None,
    jobs: PhotoJobs = None,
    progress: Progress = unheard,
) -> CameraCheck:
    """Tell whether a camera or a rig is still as its file says: `check("camera.json", "t.json", "photos").verdict`.

    From one photo or a few, of which only the poses are solved. The answer is yes, no, or cannot say: a change that
    matters would not have been seen. The exit code is 0 for yes, and 1 for no and for cannot say.

    >>> found = calib.check("camera.json", "board.target.json", "photos/*.jpg")
    >>> found.verdict, found.changes[0].amount, found.causes

    Raises:
        InputError: files that cannot be read, photos of another size, or a camera that has no parameters.
    """
    from calib.app.check_history import added, history_in
    from calib.app.inputs import in_order, target_of
    from calib.judge.drift import drift_test
    from calib.solver.target_error import unbent
    from designer.tolerance.made import EXACT, how_made

    folder = None if history is None else place_of(history, "a folder")
    if folder is not None:
        history_in(folder)  # refuses what is somebody else's before any work is done
    if (
        isinstance(photos, list | tuple)
        and not photos
        and isinstance(target, str | PathLike)
        and Path(target).suffix.lower() in TABLES
    ):
        photos, target = target, None
    reference, bend, bent_id, remarks = _reference(
        in_order(
            camera,
            "calib check CAMERA|RIG TARGET PHOTO...",
            camera_rig_calibration=camera,
            target=target,
            photos=photos,
        )
    )
    geometry = None if target is None else target_of(target)
    seen, unseen, rendered_id, said = _observed(reference, geometry, photos, pattern, jobs, progress)
    way = how_made(geometry, made, rendered_id=rendered_id)
    prior = None if way is None else way.prior
    if bend is not None and seen is not None and bent_id in (seen.points.geometry_id or None,):
        prior = None if prior is None else unbent(prior, bend, seen.points)
        seen = replace(seen, sightings=tuple(bend.bent(one) for one in seen.sightings))
    test = None
    if seen is not None:
        progress("comparing", 0, 0)
        test = drift_test(
            reference, seen, prior, false_alarms=false_alarms_share, is_exact=way is not None and way.name == EXACT
        )
    name = fspath(camera) if isinstance(camera, str | PathLike) else f"a {type(camera).__name__}"
    if way is not None and way.because and way.prior is not None:
        remarks = (*remarks, way.sentence)
    matters = focal_percent, turn_deg
    found = _told(test, reference, matters, false_alarms_share, name, unseen, (*remarks, *said))
    return found if folder is None else replace(found, history=added(folder, found))


def _reference(known: object) -> "tuple[Reference, PlaneBend | None, str, tuple[str, ...]]":
    """The cameras, how the target of an id is bent if that is known, and what is to be said of the file."""
    from calib.app.calibration import Run
    from calib.app.inputs import opened_camera, rig_named
    from calib.app.solved_rig import SolvedRig
    from calib.cameras import ABILITIES
    from calib.cameras.camera import Camera
    from calib.cameras.rig import Rig, rig_of_one
    from calib.judge.reference import reference_of
    from calib.rigs.result import RigCalibration
    from calib.solver.calibration import Calibration

    remarks: tuple[str, ...] = ()
    given, told = known, None
    if isinstance(known, str | PathLike):
        given, told, remarks = _calibration_at(Path(known))
        if given is None and (rig := rig_named(known)) is not None and len(rig.read.rig.names) > 1:
            given, remarks = rig.read.rig, rig.read.remarks
        elif given is None:
            opened = opened_camera(known)
            given, remarks = opened.read.camera, opened.read.remarks
    given = given.best.calibration if isinstance(given, Run) else given
    given = given.calibration if isinstance(given, SolvedRig) else given
    if not isinstance(given, Camera | Rig | Calibration | RigCalibration):
        raise InputError(f"{type(known).__name__}: give a camera, a rig, their file, or a calibration")
    reference = reference_of(given)
    if told is not None:
        other = rig_of_one(told) if isinstance(told, Camera) else told
        checked = replace(reference.rig, cameras=other.cameras, cam_from_rig=other.cam_from_rig)
        reference = replace(reference, rig=checked, solved=reference.rig)
    if odd := next((one.model for one in reference.rig.cameras if ABILITIES[one.model].is_learned), ""):
        raise InputError(f"model {odd}: is a learned map, without parameters that could change; check another model")
    remarks = (*remarks, NO_SIGMA) if reference.rig.covariance is None else remarks
    if isinstance(given, Camera | Rig):
        return reference, None, "", remarks
    if given.status != "converged":
        raise InputError("the calibration does not determine its camera; solve it from more photos")
    if isinstance(given, Calibration) and given.told_of_camera:
        remarks = (*remarks, given.told_of_camera)
    return reference, given.target_bend, given.observations.points.geometry_id, remarks


def _calibration_at(place: Path) -> "tuple[Calibration | RigCalibration | None, Camera | Rig | None, tuple[str, ...]]":
    """The calibration of a folder, of its own file, or that which a camera.json or rig.json lies beside.

    With it what that file says, if it is not what was solved; and what is to be said of the choice.

    Raises:
        InputError: one that was asked for cannot be read.
    """
    import numpy as np

    from calib.cameras.camera import load_camera
    from calib.cameras.formats.reading import solved_in
    from calib.cameras.rig import RIG
    from calib.judge.folders import RIG_FILE
    from calib.observe.calibration_file import CALIBRATION_FILE, CAMERA_FILE, RIG_CALIBRATION_FILE, read_calibration
    from calib.rigs.rig_calibration_file import read_rig

    said: tuple[str, ...] = ()
    folder = place if place.is_dir() else place.parent
    is_rig = place.is_dir() or place.name in (RIG_FILE, RIG_CALIBRATION_FILE)
    if is_rig and (folder / RIG_CALIBRATION_FILE).is_file():
        found = read_rig(folder)[0]
        told = RIG.read(folder / RIG_FILE) if (folder / RIG_FILE).is_file() else None
        if told is None or place.name == RIG_CALIBRATION_FILE:
            return found, None, ()
        pairs = list(zip(told.cameras, found.cameras, strict=False))
        if told.names != found.observations.camera_names or any(_is_another(*pair) for pair in pairs):
            return None, None, ()
        more = None if told.covariance is None else told.covariance - found.stated_covariance  # as halves enlarged it
        found = found if more is None else replace(found, covariance=found.covariance + more)
        as_solved = np.array_equal(told.cam_from_rig, found.cam_from_rig) and all(
            np.array_equal(one.params, other.params) for one, other in pairs
        )
        return (found, None, ()) if as_solved else (found, told, (NOT_AS_SOLVED,))
    if place.name == CALIBRATION_FILE:
        return read_calibration(place)[0], None, ()
    if place.is_dir() and not (place / CAMERA_FILE).is_file():
        if not any(place.rglob(CALIBRATION_FILE)):
            return None, None, ()
        found_in, said = solved_in(place, CALIBRATION_FILE)
        folder = found_in.parent
    path = folder / CAMERA_FILE
    if (place.is_dir() or (place == path and path.is_file())) and (folder / CALIBRATION_FILE).is_file():
        known = read_calibration(folder / CALIBRATION_FILE)[0]
        camera = load_camera(path) if path.is_file() else known.camera
        if not _is_another(camera, known.camera):
            as_solved = np.array_equal(camera.params, known.camera.params)
            return (known, None, said) if as_solved else (known, camera, (*said, NOT_AS_SOLVED))
    return None, None, ()


def _is_another(one: "Camera", other: "Camera") -> bool:
    """Whether two cameras do not even have the same parameters."""
    return (one.model, one.image_size) != (other.model, other.image_size)


def _observed(
    reference: "Reference", target: "TargetGeometry | None",
    photos: "Observations | RigObservations | Place | Iterable[Place | Detections]", pattern: str | None,
    jobs: int | None, progress: Progress,
) -> "tuple[RigObservations | None, tuple[LeftOut, ...], str, tuple[str, ...]]":  # fmt: skip
    """What is seen in photos or a table, photos that show nothing, the geometry they were rendered of, and remarks."""
    from calib.app.inputs import (
        file_or_observations,
        load_rig_observations,
        observations_of,
        photos_of,
        with_bag,
    )  # fmt: skip
    from calib.core.types import Detections, Observations, RigObservations
    from calib.judge.reference import of_one_camera
    from calib.observe.search import PhotoSearch, with_truth

    names, is_alone = reference.rig.names, len(reference.rig.names) == 1
    given = photos if isinstance(photos, Observations | RigObservations | str | PathLike) else list(photos)
    if isinstance(given, list) and len(given) == 1 and isinstance(given[0], str | PathLike):
        given = given[0]
    if isinstance(given, str | PathLike) and Path(given).suffix.lower() in TABLES:
        given = load_rig_observations(given, target) if not is_alone else file_or_observations(given, target)
    if isinstance(given, list) and given and all(isinstance(one, Detections) for one in given):
        given = observations_of(cast("list[Detections]", given), target)
    if pattern is not None and (is_alone or isinstance(given, Observations | RigObservations)):
        raise InputError("--pattern: tells the cameras of a rig's photos apart; leave it out")
    if isinstance(given, Observations) and is_alone:
        _require_size(reference, 0, given.image_size)
        return replace(of_one_camera(given), camera_names=names), (), "", given.remarks
    if isinstance(given, RigObservations):
        for name, seen in zip(given.camera_names, given.sightings, strict=True):
            _require_size(reference, reference.rig.row(name), seen.image_size)
        return given, (), "", given.remarks
    if isinstance(given, Observations):
        raise InputError("sightings of one camera, but a rig is checked; give those of its cameras, or one camera")
    if target is None:
        raise InputError("no target; give the file of what the photos show, after the camera's")
    places = cast("list[Place]", [given] if isinstance(given, str | PathLike) else given)
    if not places:
        raise InputError("no photos; give images, folders or patterns, after the target")
    if is_alone:
        found, _ = with_truth(photos_of(places, None, target, progress), None)
        search = PhotoSearch(target, found, jobs=jobs, progress=progress).once(reference.rig.cameras[0])
        return _of_searches(reference, names, (search,), {})
    from calib.capture.clips import clips_of_rig
    from calib.observe.rig_search import photos_of_rig, rig_input, search_cameras

    of_rig = with_bag(rig_input(places, pattern=pattern))
    taken = clips_of_rig(of_rig, target, progress) or photos_of_rig(of_rig)
    lenses = {name: reference.rig.cameras[reference.rig.row(name)] for name in taken.camera_names}
    searched = search_cameras(target, taken, lenses, None, jobs, progress)
    frames = {(photo.camera, photo.path): photo.frame for photo in taken.photos}
    every = _of_searches(reference, taken.camera_names, searched.searches, frames, taken.frame_names)
    return *every[:3], (*taken.remarks, *every[3])


def _of_searches(
    reference: "Reference", names: tuple[str, ...], searches: "tuple[Search, ...]",
    frames: "Mapping[tuple[str, Path], str]", frame_names: tuple[str, ...] = (),
) -> "tuple[RigObservations | None, tuple[LeftOut, ...], str, tuple[str, ...]]":  # fmt: skip
    """The same of photos that were searched; blurred ones count where there are no others."""
    import numpy as np

    from calib.core.types import keep_views
    from calib.judge.drift import LeftOut
    from calib.observe.observations import observations_for_poses
    from calib.observe.rig_observations import RigSightings, rig_observations

    left, cameras, owner = list[LeftOut](), list[RigSightings](), len(names) > 1
    for name, search in zip(names, searches, strict=True):
        of = f"{name}: " if owner else ""
        frame = {one.photo.name: frames.get((name, one.photo.path), one.photo.name) for one in search.results}
        left += [
            LeftOut(f"{of}{one.image}", one.remarks[0] if one.remarks else "the target was not found")
            for one in search.detections if not len(one.ring)
        ]  # fmt: skip
        seen = observations_for_poses(search.with_target, search.target) if search.with_target else None
        if seen is None:
            continue
        blurred = np.isin(seen.view_names, seen.smeared)
        if blurred.any() and not blurred.all():
            left += [
                LeftOut(f"{of}{seen.view_names[k]}", "a motion blurred it") for k in np.flatnonzero(blurred).tolist()
            ]
            seen = keep_views(seen, ~blurred)
        cameras.append(RigSightings(name, seen, frame))
    ids, failures = {one.rendered_id for one in searches}, tuple(line for one in searches for line in one.failures)
    if not cameras:
        return None, tuple(left), "", failures
    every = frame_names or tuple(one.photo.name for one in searches[0].results)
    observations = rig_observations(cameras, every, fewest=1)
    return observations, tuple(left), next(iter(ids)) if len(ids) == 1 else "", failures


def _require_size(reference: "Reference", row: int, size: tuple[int, int]) -> None:
    known = reference.rig.cameras[row].image_size
    if size != known:
        of = f" {reference.rig.names[row]}" if len(reference.rig.names) > 1 else ""
        raise InputError(
            f"sightings in images of {size[0]} x {size[1]} px, but the camera{of} has {known[0]} x {known[1]} px; "
            "give photos of the camera"
        )


def _told(
    test: "DriftTest | None", reference: "Reference", matters: tuple[float, float], false_alarms: float, checked: str,
    unseen: "tuple[LeftOut, ...]", remarks: tuple[str, ...],
) -> CameraCheck:  # fmt: skip
    """The verdict, and why."""
    none = "no photo shows enough of the target"
    if test is None:
        return CameraCheck("cannot say", none, math.nan, false_alarms, checked, (), (), (), unseen, remarks)
    every = [one for one in test.explanations if one.camera and one.what in TOLD]
    changes = tuple(_change_of(one) for one in every)
    causes = tuple(Cause(one.camera, one.what, _cause_text(test, one)) for one in test.causes)
    verdict, reason = _verdict(test, changes, causes, matters, reference)
    return CameraCheck(
        verdict, reason, test.p, false_alarms, checked, changes, causes, test.frames, (*unseen, *test.left_out),
        remarks, test=test, image_sizes=tuple(one.image_size for one in reference.rig.cameras),
    )  # fmt: skip


def _verdict(
    test: "DriftTest", changes: tuple[Change, ...], causes: tuple[Cause, ...], matters: tuple[float, float],
    reference: "Reference",
) -> tuple[Verdict, str]:  # fmt: skip
    """Yes only where what matters would have been seen."""
    if test.contradict:
        return "cannot say", "the photos contradict each other: something moved meanwhile, or another camera took one"
    if test.is_changed and reference.states_nothing and test.times_free < SURELY_FREE:
        return "cannot say", (
            f"the photos leave over {test.times_free:.1f} times what they would by a free camera, and the file does "
            "not say what it left over of those it was solved from; give the folder of the calibration"
        )
    if test.is_changed and not causes:
        return "no", "something changed, and no simple cause explains all of it"
    if test.is_changed:
        texts = " or ".join(one.text for one in causes[:MOST_NAMED])
        return "no", texts if len(causes) == 1 else f"{texts}: these photos do not tell which"
    least = {
        what: max((one for one in changes if one.what == what), key=lambda one: one.visible, default=None)
        for what in TOLD
    }  # fmt: skip
    focal, turn = matters
    wanted = {"focal length": focal, "turn": turn, "shift": test.distance_mm * math.tan(math.radians(turn))}
    for what, most in wanted.items():
        if (one := least[what]) is not None and one.visible > most:
            but = f"no change is seen, but {_visible(one)} would not be; what matters is {figure(most, 2)} {one.unit}"
            misfit = f"the calibration itself misfits, its own photos deviate {test.misfit:.1f} times what it states: "
            return "cannot say", f"{misfit if test.misfit > MISFITS else ''}{but}"
    if blind := [name for name in reference.rig.names if not any(one.camera == name for one in changes)]:
        return "cannot say", f"no photo of {', '.join(map(printable, blind))} shows the target"
    seen = [_visible(one) for what, one in least.items() if one is not None and (what in wanted or len(changes) == 2)]
    return "yes", f"as the file says: {', '.join(seen[:-1])} or {seen[-1]} would have been seen (95 %)"


def _visible(one: Change) -> str:
    size = f"{figure(one.visible, 2)} {one.unit}" if math.isfinite(one.visible) else "any size"
    word = {"focal length": "a change of the focal length", "principal point": "a move of the principal point"}
    return f"{word.get(one.what, 'a ' + one.what)} of {size}"


def _change_of(one: "DriftHypothesis") -> Change:
    scale, unit = UNITS[one.what]
    return Change(
        one.camera, one.what, unit, tuple((scale * one.amount).tolist()), tuple((scale * one.sigma).tolist()),
        scale * one.visible,
    )  # fmt: skip


def _cause_text(test: "DriftTest", one: "DriftHypothesis") -> str:
    """A cause with its number."""
    is_rig = len({each.camera for each in test.explanations if each.camera}) > 1
    name = printable(one.camera)
    of = f" of {name}" if is_rig else ""
    if one.what not in UNITS:
        return {
            "lens": f"the lens{of} is another (focal length, principal point and distortion together)",
            "place": f"{name} was turned and shifted", "bend": "the target is bent in another way",
        }[one.what]  # fmt: skip
    size = _change_of(one).text
    return {
        "focal length": f"the focal length{of} changed by {size}",
        "principal point": f"the principal point{of} moved by {size}", "turn": f"{name} was turned by {size}",
        "shift": f"{name} was shifted by {size}", "size": f"the target is larger than its file says by {size}",
    }[one.what]  # fmt: skip
