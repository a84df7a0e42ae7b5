"""What a check compares: cameras with what is known of them, and what new photos show."""

from collections.abc import Iterable, Mapping
from dataclasses import replace
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, cast

from designer.base.errors import InputError
from designer.page.progress import Progress

if TYPE_CHECKING:
    from calib.app.inputs import Place
    from calib.cameras.camera import Camera
    from calib.cameras.rig import Rig
    from calib.core.types import Detections, Observations, RigObservations
    from calib.judge.drift import LeftOut
    from calib.judge.reference import Reference
    from calib.observe.photos import Search
    from calib.rigs.result import RigCalibration
    from calib.solver.calibration import Calibration, PlaneBend
    from designer.target import TargetGeometry

TABLES = (".csv", ".vnl")
NO_SIGMA = (
    "the file does not say how sure it is: it is taken to be as sure as from 20 photos such as these; a no may also "
    "mean that it never was better"
)
NOT_AS_SOLVED = "the file says something else than the calibration beside it, which tells how sure it may be"


def reference_of_file(known: object) -> "tuple[Reference, PlaneBend | None, str, tuple[str, ...]]":
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


def observed_for(
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
