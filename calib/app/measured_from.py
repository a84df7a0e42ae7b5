"""What a print is measured from: detections, tables or observations of one camera or several, photos, or a rig."""

import os
from collections.abc import Iterable, Sequence
from dataclasses import replace
from itertools import chain
from numbers import Integral
from os import PathLike
from pathlib import Path
from typing import TypeAlias

import numpy as np

from calib.app.inputs import Place, load_observations, observations_of, photos_of, require_told_apart, target_of
from calib.cameras import COMMON, fitted_models
from calib.core.types import Detections, Observations
from calib.coupon_reading.ink_of_rings import InkBleed, ink_of_rings
from calib.judge.folders import read_rig_run
from calib.judge.judge import VERDICT, VERDICT_FILE
from calib.measure_target.earlier_lens import is_another_lens, seen_through, with_shared_error
from calib.measure_target.lengths import CaliperLength, doubt_about, usual_sigmas
from calib.measure_target.result import AsBuilt
from calib.measure_target.solve import measure, measure_rig
from calib.measure_target.unknowns import AsBuiltOptions
from calib.observe.correspondences import is_detections
from calib.observe.dataset import read_detections
from calib.observe.observations import known_points
from calib.observe.photos import FoundPhotos, named_photos
from calib.observe.search import PhotoSearch
from calib.rigs.result import RigCalibration
from calib.solver.metrics.evaluation import evaluate
from calib.solver.plan import SolvePlan
from calib.solver.solve import solve
from designer.base.errors import InputError
from designer.base.words import several, shown
from designer.page.progress import Progress
from designer.target import TargetGeometry, bounding_radius_mm
from designer.tolerance.made import EXACT, Made, how_made

LEAST_VIEWS = 3
"""Of a camera: from fewer, a target that may have any shape does not tell the camera."""
LEAST_PARTS, USUAL_PARTS = 2, 5
LEAST_FRAMES = 3
"""From fewer, a target that may have any shape does not tell the cameras."""
FAR_OFF = 0.05
"""Part of a target's size that no print of it is off."""
Several: TypeAlias = Observations | Place | Iterable[Observations | Detections | Place]
"""What was observed of a print: of one camera, or of several a file or observations each."""
Item: TypeAlias = Observations | Detections | Place


def nominal_of(target: TargetGeometry | Place) -> TargetGeometry:
    """The target that a print is measured against."""
    geometry = target_of(target)
    require_told_apart(geometry, "measuring")
    if geometry.source != "nominal":
        name = "the target" if isinstance(target, TargetGeometry) else target
        raise InputError(
            f"{name}: a {geometry.source} target; deviations are told against the design: give the nominal target file"
        )
    return geometry


def way_of(target: TargetGeometry, made: str | None) -> Made:
    """What is taken for granted where the photos do not tell."""
    way = how_made(target, made)
    if way is None or way.name == EXACT:
        raise InputError(f"--made {EXACT}: there is nothing to measure then; give an error template, or leave it out")
    return way


def doubts_about(lengths: Sequence[CaliperLength], way: Made, nominal: TargetGeometry) -> tuple[str, ...]:
    """What is assumed of lengths, and why they may be no readings."""
    return (*usual_sigmas(lengths), *filter(None, (doubt_about(one, nominal, way.errors) for one in lengths)))


def items_of(observed: Several) -> tuple[Item, ...]:
    """What was given, one by one.

    Raises:
        InputError: nothing, something else, or the photos of one camera among those of others.
    """
    items = (observed,) if isinstance(observed, Observations | PathLike) else several("observed", observed)
    if not items:
        raise InputError(
            "no detections: give the detections.csv of photos of the print, or what was detected in them; --rig with "
            "the folder of calib rig; or --measured-length to rescale without"
        )
    for one in items:
        if not isinstance(one, Observations | Detections | str | PathLike):
            raise InputError(f"{shown(one)}: give files, observations, or what was detected in photos")
    if len({isinstance(one, Detections) for one in items}) > 1:
        raise InputError(
            "detections beside files or observations: detections of several photos are of one camera; make each "
            "camera's a file, or observations"
        )
    return items


def ink_of_each(items: Sequence[Item], nominal: TargetGeometry) -> list[InkBleed]:
    """What each file of detections, or the detections given, tell of the ink; tables and observations tell nothing."""
    return [ink for seen in detections_in(items, nominal) if (ink := ink_of_rings(seen, nominal)) is not None]


def detections_in(items: Sequence[Item], nominal: TargetGeometry) -> list[tuple[Detections, ...]]:
    """The detections among what was given, and those of each file."""
    paths = [path for path in paths_in(items) if is_detections(path)]
    read = [read_detections(path, nominal, target_path=Path("the target")) for path in paths]
    return [tuple(one for one in items if isinstance(one, Detections)), *read]


def photos_to_search(
    photos: Place | Iterable[Place], items: Sequence[Item], nominal: TargetGeometry
) -> FoundPhotos | None:
    """The photos that detections were found in; None: none are given.

    Raises:
        InputError: not of one camera's detections, or not all of their photos.
    """
    if not photos:
        return None
    seen = list(chain(*detections_in(items, nominal)))
    if not seen or (len(items) > 1 and paths_in(items)):
        raise InputError(
            "--photos: they are searched again with one camera's lens; give the detections.csv of one camera"
        )
    given = photos_of(photos, None, nominal)
    named, wanted = named_photos(given.photos), {one.image for one in seen}
    if missing := sorted(wanted - {one.name for one in named}):
        raise InputError(f"--photos: {shown(missing[0])} is not among them; give all photos that the detections are of")
    return replace(given, photos=tuple(one for one in named if one.name in wanted))


def solved(
    sets: list[Observations],
    items: Sequence[Item],
    rig: RigCalibration | None,
    photos: FoundPhotos | None,
    nominal: TargetGeometry,
    model: str,
    options: AsBuiltOptions,
    lengths: Sequence[CaliperLength],
    progress: Progress,
) -> tuple[AsBuilt, list[Observations], tuple[str, ...]]:
    """The print, what it was measured from in the end, and what to know of that."""
    if rig is not None:
        return measure_rig(rig, nominal, options, lengths), sets, ()
    found = measure(sets, nominal, model, options, lengths)
    if photos is None:
        return _with_earlier_lens(found, sets, chain(*detections_in(items, nominal)), options, lengths), sets, ()
    if found.status == "degenerate":
        return found, sets, ("photos were not searched again: they do not determine the camera",)
    search = PhotoSearch(found.target, photos, progress=progress).once(found.cameras[0])
    # Seen with the lens and the target that were measured, to be measured against the design.
    again = observations_of([replace(one, geometry_id=nominal.geometry_id) for one in search.detections], nominal)
    return measure([again], nominal, model, options, lengths), [again], ()


def _with_earlier_lens(
    found: AsBuilt,
    sets: Sequence[Observations],
    seen: Iterable[Detections],
    options: AsBuiltOptions,
    lengths: Sequence[CaliperLength],
) -> AsBuilt:
    """What is measured, with what it did to centres to find them through another lens than the measured one."""
    nominal, model = found.nominal, found.cameras[0].model
    if found.status == "degenerate" or not any(one.geometry_id == nominal.geometry_id for one in seen):
        return found
    before = [solve(one, model, options.solve).camera for one in sets]
    if not is_another_lens(found, before):
        return found
    return with_shared_error(found, measure(seen_through(found, before), nominal, model, options, lengths))


def paths_in(items: Iterable[Item]) -> list[Path]:
    """The files among what was given."""
    return [Path(one) for one in items if isinstance(one, str | PathLike)]


def sets_of(
    items: Sequence[Item],
    nominal: TargetGeometry,
    target: TargetGeometry | Place,
    image_size: tuple[int, int] | None,
    *,
    one_camera: bool,
) -> list[Observations]:
    """What each camera saw."""
    paths = paths_in(items)
    for path in paths:
        if sum(os.path.realpath(other) == os.path.realpath(path) for other in paths) > 1:
            raise InputError(f"{path}: given twice; give each detections file once")
    photos = [one for one in items if isinstance(one, Detections)]
    if one_camera and len(items) > 1 and not photos:
        if len(paths) < len(items):
            raise InputError("one_camera: observations are of a camera each; give detections, or files of them")
        against = Path("the target") if isinstance(target, TargetGeometry) else Path(target)
        photos = [
            replace(photo, image=f"{number}-{path.stem}/{photo.image}")
            for number, path in enumerate(paths, start=1)
            for photo in read_detections(path, nominal, target_path=against)
        ]
    if photos:
        named = [(", ".join(map(str, paths)) or "the detections", observations_of(photos, nominal))]
    else:
        named = [
            ("the observations", one)
            if isinstance(one, Observations)
            else (str(one), load_observations(one, target, image_size=image_size))
            for one in items
            if not isinstance(one, Detections)
        ]
    for name, one in named:
        if one.view_count < LEAST_VIEWS:
            raise InputError(
                f"{name}: {one.view_count} photos can be used; a camera needs at least {LEAST_VIEWS}, and "
                "20 or more from all sides to measure a target well"
            )
    # Centres of circles count as points where the camera that they give takes them to.
    return [
        solve(one, COMMON, noise_px2=one.cov_px2).observations
        if one.points.circle_mm is not None and (one.points.circle_mm > 0).any()
        else one
        for _, one in named
    ]


def remarks_on(
    sets: Sequence[Observations], way: Made, lengths: Sequence[CaliperLength], nominal: TargetGeometry
) -> tuple[str, ...]:
    """What to know of photos, lengths and the way of making."""
    assumed = (way.sentence,) if way.because else ()
    return (*(line for one in sets for line in one.remarks), *assumed, *doubts_about(lengths, way, nominal))


def model_for(plan: SolvePlan, items: Sequence[Item], sets: Sequence[Observations]) -> tuple[str, tuple[str, ...]]:
    """The model to measure with, and why it, in a line; nothing if it was asked for.

    Raises:
        InputError: the photos determine a camera of no model.
    """
    models = [model for model in plan.models if model in fitted_models()]
    if len(plan.models) == 1:
        return models[0], ()
    models = [model for model in plan.suited(sets[0])[0].models if model in fitted_models()]
    best = {model for path in paths_in(items) if (model := _best_of_run(path.parent))}
    if len(best) == 1 and (model := best.pop()) in models:
        return model, (f"cameras are solved as {model}, the model of the run's best camera; another with --model",)
    ranks, faults = {}, []
    for model in models:
        try:
            ranks[model] = max(evaluate(solve(one, model, plan.options_of(model))).preference for one in sets)
        except InputError as error:
            faults.append(error)
    if not ranks:
        raise faults[0]
    model = min(ranks, key=lambda name: ranks[name])
    return model, (
        f"cameras are solved as {model}, which of {' and '.join(models)} has the smaller residuals with the target as "
        "designed; another with --model",
    )


def _best_of_run(folder: Path) -> str:
    """The model of a run's best camera; "" if the folder is of no run."""
    try:
        judged = VERDICT.read_if_there(folder / VERDICT_FILE)
    except InputError:
        return ""
    return "" if judged is None else judged.verdict.model


def parts_of(asked: int | None, views: int) -> int:
    """In how many parts photos are held out, of the camera with the fewest; 0: not."""
    if asked is None:
        return min(USUAL_PARTS, views) if views > LEAST_VIEWS else 0
    if asked and not (isinstance(asked, Integral) and LEAST_PARTS <= asked <= views):
        raise InputError(
            f"--held-out {asked}: {views} photos fall into {LEAST_PARTS} to {views} parts; give one of these, or 0 for "
            "none"
        )
    return asked


def rig_to_measure_from(rig: RigCalibration | Place, nominal: TargetGeometry, *, is_alone: bool) -> RigCalibration:
    """The rig with the target's rings as designed.

    Args:
        is_alone: whether nothing else is given that says what was seen, or how cameras are solved.

    Raises:
        InputError: a folder that cannot be read, a rig of another target, too few frames, or what is given beside it.
    """
    if not is_alone:
        raise InputError(
            "--rig: the rig has its photos, and says how its cameras were solved; leave detections, --photos, "
            "--model, --fix, --share, --one-camera and --image-size out"
        )
    name = "the rig" if isinstance(rig, RigCalibration) else str(rig)
    found = rig if isinstance(rig, RigCalibration) else read_rig_run(Path(rig)).found
    points = found.observations.points.position_mm
    is_same_size = points.shape == nominal.center_mm.shape
    most_mm = FAR_OFF * bounding_radius_mm(nominal)
    if not is_same_size or np.linalg.norm(points - nominal.center_mm, axis=1).max() > most_mm:
        raise InputError(f"{name}: saw another target; give the target file that it was solved with, as designed")
    if found.status == "degenerate":
        raise InputError(f"{name}: its frames do not determine the cameras ({found.remarks[0]}); take more first")
    if found.observations.frame_count < LEAST_FRAMES:
        raise InputError(
            f"{name}: {found.observations.frame_count} frames; at least {LEAST_FRAMES} are needed, and 20 or more with "
            "the target turned to all sides measure it well"
        )
    drawn = known_points(nominal)
    seen = tuple(replace(one, points=drawn) for one in found.observations.sightings)
    return replace(found, observations=replace(found.observations, sightings=seen))


def remarks_on_rig(rig: RigCalibration) -> tuple[str, ...]:
    """What to know of the rig, a line each."""
    cameras, frames = len(rig.cameras), rig.observations.frame_count
    said = f"measured from {frames} frames by {cameras} cameras held together; where they stand was solved, too"
    return (said, *rig.remarks, *rig.observations.remarks)
