"""A printed target as photos of it show it: what `calib measure` does."""

import math
import os
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from numbers import Integral
from os import PathLike
from pathlib import Path
from typing import TypeAlias

from calib.api.measuring_rigs import rig_to_measure_from, told_of
from calib.api.page_shown import ShownAsPage
from calib.app.inputs import (
    Place,
    load_observations,
    observations_of,
    photos_of,
    target_of,
)
from calib.as_built.back import tells_thickness, with_thickness
from calib.as_built.cross_validation import cross_validate
from calib.as_built.deviations import Compensation, Estimate
from calib.as_built.earlier_lens import is_another_lens, seen_through, with_shared_error
from calib.as_built.lengths import (
    CaliperLength,
    asked_length,
    asked_lengths,
    doubt_about,
    length_in,
    rescaled,
    usual_sigmas,
)
from calib.as_built.options import AsBuiltOptions
from calib.as_built.result import AsBuilt
from calib.as_built.seats import Seat
from calib.as_built.solve import measure as measure_print
from calib.as_built.solve import measure_rig, with_known_weights
from calib.cameras import COMMON, fitted_models
from calib.core.types import Detections, Observations
from calib.coupons.ink_of_rings import InkBleed, ink_of_cameras, ink_of_rings
from calib.metrics.evaluation import evaluate
from calib.observe.correspondences import is_detections
from calib.observe.dataset import read_detections
from calib.observe.photos import FoundPhotos, named_photos
from calib.observe.search import PhotoSearch
from calib.records.as_built_file import AsBuiltRecord, record_of
from calib.renderer.quantities import number
from calib.rigs.result import RigCalibration
from calib.show.measured.files import TARGET_SUFFIX, check_places, measured_files, places_of
from calib.show.measured.words import why_not
from calib.solver.plan import ALL, SolvePlan, plan_from_words
from calib.solver.solve import solve
from calib.verdict.judge import VERDICT, VERDICT_FILE
from designer.base.answer import program
from designer.base.errors import InputError
from designer.base.files import write_files
from designer.base.small_file import place_of
from designer.base.units import NO_SKEW, Skew, format_skew
from designer.base.words import several, shown
from designer.page.progress import Progress, unheard
from designer.target import TargetGeometry, target_to_json
from designer.tolerance.made import EXACT, Made, how_made

LEAST_VIEWS = 3
"""Of a camera: from fewer, a target that may have any shape does not tell the camera."""
LEAST_PARTS, USUAL_PARTS = 2, 5
Several: TypeAlias = Observations | Place | Iterable[Detections] | Iterable[Place | Observations]
"""What was observed of a print: of one camera, or of several a file or observations each."""


@dataclass(frozen=True, eq=False)
class MeasureResult(ShownAsPage):
    """A target as it was printed, and what that is worth: `measured.target`, `measured.record.whole.size`.

    In a notebook the result shows its page.
    """

    found: AsBuilt  # the solution: cameras, faces, rings and their covariances
    record: AsBuiltRecord  # all that is told of it, as `NAME.as_built.json` has it
    measured_against: Path | None = None  # the file of the target as designed, which `save` leaves alone
    kind = "measure"

    @property
    def target(self) -> TargetGeometry:
        """The target as it was printed."""
        return self.found.target

    @property
    def remarks(self) -> tuple[str, ...]:
        """What a person must know, a line each."""
        return self.record.remarks

    @property
    def seats(self) -> tuple[Seat, ...]:
        """How each piece sits of a target put together from tiles or stickers, in the order of the faces; else none.

        >>> [one.face for one in measured.seats if one.verdict == "sits badly"]
        """
        return () if self.record.seats is None else self.record.seats.seats

    @property
    def why_not(self) -> str:
        """Why the measured target is not to be used, in a line; "" if it is, or if nobody asked."""
        return why_not(self.record)

    def save(self, path: Place) -> tuple[Path, ...]:
        """Write `NAME.target.json`, and `NAME.as_built.json`, `.csv` and `.png` beside it; return the files.

        Raises:
            InputError: another name, a file of somebody else's, or the target it was measured against.
        """
        places = places_of(place_of(path, "a name, such as as_built.target.json"))
        check_places(places, self.measured_against)
        files = measured_files(places, self.record, self.target, self.found.nominal)
        write_files(files)
        return tuple(files)

    def _save_in(self, folder: Path) -> None:
        self.save(folder / f"measured{TARGET_SUFFIX}")


def measure(
    target: TargetGeometry | Place,
    observed: Several = (),
    *,
    rig: RigCalibration | Place | None = None,
    lengths: str | CaliperLength | Iterable[str | CaliperLength] = (),
    photos: Place | Iterable[Place] = (),
    model: str | None = None,
    one_camera: bool = False,
    rings: str = "free",
    bow: bool | None = None,
    made: str | None = None,
    weighted: bool = True,
    reject_sigma: float | None = None,
    fix: Iterable[str] = (),
    share: Iterable[str] = (),
    shrink_compensation_percent: float = 0.0,
    skew_compensation_rad: Skew = NO_SKEW,
    bed_turn_rad: float = 0.0,
    image_size: tuple[int, int] | None = None,
    held_out: int | None = None,
    truth: TargetGeometry | Place | None = None,
    progress: Progress = unheard,
) -> MeasureResult:
    """Measure a print with photos of it: `measure("ico.target.json", "detections.csv").save("as_built.target.json")`.

    >>> measured = calib.measure("ico.target.json", "detections.csv", lengths=["face-to-face:151.20mm+-0.02mm"])
    >>> measured.target, measured.why_not

    Args:
        target: as designed: a geometry, or its file.
        observed: in photos of the print: a file, what was found in photos, or observations; several files or
            observations are of a camera each.
        rig: instead: a solved rig, or its folder, whose cameras saw the print in frames; all faces are then measured at
            once, with a pose a frame and not one a photo.
        lengths: of a caliper, which tell the size.
        photos: that `observed` was found in, of one camera: searched again with the lens and the target as measured,
            and measured once more. Centres found through the lens of the target as designed bend the camera.
        model: of the cameras; None: that of the best camera of the run whose `detections.csv` is given, else the one
            with the smaller residuals, as `run` chooses. `remarks` say which and why.
        one_camera: all files are of one camera.
        rings: `free`: each ring may be off a little; `rigid`: only faces move.
        bow: whether faces may be bent; None: a board may.
        made: how it was made, which says what to expect where the photos do not tell; None: assumed from its build.
        weighted: weigh observations by their covariances, or all alike.
        reject_sigma: leave out what is off by more than so many robust standard deviations.
        fix: parameters to keep as they start, or at a value.
        share: parameters that have one value.
        shrink_compensation_percent: that this print was made with, to tell that of the next.
        skew_compensation_rad: likewise, of xy, xz and yz.
        bed_turn_rad: by which the print was turned on the bed against `design`.
        image_size: of files that do not say it.
        held_out: hold every N-th photo out in turn (cross-validation) to judge the gain; None: 5, fewer of few; 0: do
            not.
        truth: of rendered photos: the target they show, to judge the gain by too.
        progress: is told what is being done.

    Raises:
        InputError: files or options that break a rule, or photos too few.
    """
    nominal = _nominal(target)
    way = _way(nominal, made)
    asked = asked_lengths(lengths, nominal)
    fix, share = several("--fix", fix), several("--share", share)
    plan = plan_from_words(
        model or ALL, fix=fix, share=share, focal_px=None, loss="squares", reject=reject_sigma, weighted=weighted
    )
    if model not in (None, *fitted_models()):
        raise InputError(
            f"--model {model}: its map is learned from the target's own rings, so it cannot measure them; measure with "
            f"one of {', '.join(fitted_models())}, then solve {model} with the measured target"
        )
    if rings not in ("free", "rigid"):
        raise InputError(f"--rings {rings!r}: it must be free or rigid")
    shrink_percent = number("--shrink-compensation", shrink_compensation_percent)
    skew_rad = [number("--skew-compensation", one) for one in several("--skew-compensation", skew_compensation_rad)]
    if len(skew_rad) != len(NO_SKEW):
        raise InputError(f"--skew-compensation {shown(skew_compensation_rad)}: give angles of xy, xz and yz")
    made_with = Compensation(shrink_percent, (skew_rad[0], skew_rad[1], skew_rad[2]))
    bed_turn_rad = number("--bed-turn", bed_turn_rad)
    if not abs(bed_turn_rad) <= math.tau:
        raise InputError(
            f"--bed-turn {math.degrees(bed_turn_rad):g}deg: must be a full turn at most; give it in degrees"
        )
    shape = None if truth is None else _truth(truth, nominal, target)
    items: tuple[_Item, ...] = ()
    cameras, sets = None, list[Observations]()
    if rig is None:
        items = _items(observed)
        sets = _sets(items, nominal, target, image_size, one_camera=one_camera)
    else:
        beside = (observed, photos, model, one_camera, fix, share, image_size)
        cameras = rig_to_measure_from(rig, nominal, is_alone=not any(beside))
        sets = list(cameras.observations.sightings)
    again = _to_search(photos, items, nominal)
    parts = _parts(held_out, min(one.view_count for one in sets) if cameras is None else len(cameras.rig_from_target))
    progress("measuring", 0, 0)
    chosen, why = _chosen(plan, items, sets) if cameras is None else (cameras.cameras[0].model, told_of(cameras))
    options = AsBuiltOptions(made=way, bow=bow, solve=plan.options_of(chosen))
    options = with_known_weights(options if rings == "free" else replace(options, ring_sigma_mm=None), sets)
    if cameras is None:
        found = measure_print(sets, nominal, chosen, options, asked)
        if again is None:
            found = _with_earlier_lens(found, sets, _detections(items, nominal), options, asked)
        elif found.status == "degenerate":
            why = (*why, "photos were not searched again: they do not determine the camera")
        else:
            sets = [_searched(again, nominal, found, progress)]
            found = measure_print(sets, nominal, chosen, options, asked)
    else:
        found = measure_rig(cameras, nominal, options, asked)
    held = None
    if held_out != 0 and found.status != "degenerate":
        held = cross_validate(
            found, chosen, options, parts, rig=cameras, truth=shape,
            done=lambda part: progress("judging parts", part, parts),
        )  # fmt: skip
    record = record_of(
        found, held, made_with, bed_turn_rad=bed_turn_rad, weighted=options.solve.weighted, program=program(),
        made=way.errors,
        ink_bleed=ink_of_cameras(_ink_of_each(items, nominal)),
        remarks=(*why, *_remarks(sets, way, asked, nominal)),
        settings={
            "target": _named(target), "detections": ", ".join(map(_named, _paths(items))),
            **({} if rig is None else {"rig": _rig_name(rig)}),
            "model": ", ".join(sorted({one.model for one in found.cameras})), "rings": rings,
            "one-camera": str(one_camera), "weighted": str(options.solve.weighted),
            "reject": f"{reject_sigma or ''}", "bow": {None: "default", True: "bow", False: "flat"}[bow],
            "photos": "" if again is None else "searched again",
            "fix": " ".join(fix), "made": made or "", "share": " ".join(share),
            "shrink-compensation": f"{made_with.shrink_percent:g}%",
            "skew-compensation": format_skew(made_with.skew_rad), "bed-turn": f"{math.degrees(bed_turn_rad):g}deg",
            "length": "; ".join(one.text for one in asked), "held-out": str(parts),
        },
    )  # fmt: skip
    return MeasureResult(found, record, None if isinstance(target, TargetGeometry) else Path(target))


@dataclass(frozen=True, eq=False)
class RescaledTarget:
    """A target made larger or smaller by one length: `resized.target`, `resized.save("as_built.target.json")`.

    The length over front and back of a board moves its back, and nothing else.
    """

    nominal: TargetGeometry
    target: TargetGeometry
    length: CaliperLength
    remarks: tuple[str, ...]  # on the length, a line each
    measured_against: Path | None = None

    @property
    def factor(self) -> float:
        """How many times as large it is."""
        return self.length.value_mm / length_in(self.nominal, self.length.name)

    @property
    def size(self) -> Estimate | None:
        """How much larger than designed, as a share; None: the length is a thickness, which says nothing of it."""
        if tells_thickness(self.nominal, self.length.name):
            return None
        return Estimate(self.factor - 1, self.length.sigma_mm / self.length.value_mm)

    def save(self, path: Place) -> Path:
        """Write `NAME.target.json`; return its place.

        Raises:
            InputError: another name, a file of somebody else's, or the target as designed.
        """
        places = places_of(place_of(path, "a name, such as as_built.target.json"))
        check_places(places, self.measured_against)
        write_files({places.target: target_to_json(self.target).encode()})
        return places.target


def rescale(target: TargetGeometry | Place, length: str | CaliperLength, *, made: str | None = None) -> RescaledTarget:
    """Give a target the size that a caliper shows, without photos: `rescale("ico.target.json", "edge:100.4mm")`.

    Args:
        target: as designed: a geometry, or its file.
        length: of the print.
        made: how it was made, to doubt a length that no such print has.

    Raises:
        InputError: a file that cannot be read, or a length that the target does not have.
    """
    nominal = _nominal(target)
    way = _way(nominal, made)
    asked = asked_length("--measured-length", length, nominal)
    against = None if isinstance(target, TargetGeometry) else Path(target)
    is_thickness = tells_thickness(nominal, asked.name)
    made_so = with_thickness(nominal, asked.value_mm) if is_thickness else rescaled(nominal, asked)
    return RescaledTarget(nominal, made_so, asked, _doubts([asked], way, nominal), against)


def _nominal(target: TargetGeometry | Place) -> TargetGeometry:
    """The target that a print is measured against."""
    geometry = target_of(target)
    if geometry.source != "nominal":
        name = "the target" if isinstance(target, TargetGeometry) else target
        raise InputError(
            f"{name}: a {geometry.source} target; deviations are told against the design: give the nominal target file"
        )
    return geometry


def _way(target: TargetGeometry, made: str | None) -> Made:
    """What is taken for granted where the photos do not tell."""
    way = how_made(target, made)
    if way is None or way.name == EXACT:
        raise InputError(f"--made {EXACT}: there is nothing to measure then; give an error template, or leave it out")
    return way


def _doubts(lengths: Sequence[CaliperLength], way: Made, nominal: TargetGeometry) -> tuple[str, ...]:
    """What is assumed of lengths, and why they may be no readings."""
    return (*usual_sigmas(lengths), *filter(None, (doubt_about(one, nominal, way.errors) for one in lengths)))


def _truth(truth: TargetGeometry | Place, nominal: TargetGeometry, name: TargetGeometry | Place) -> TargetGeometry:
    """The geometry that rendered photos show."""
    shape = target_of(truth)
    if shape.layout_id != nominal.layout_id:
        raise InputError(f"--truth {_named(truth)}: has another layout than {_named(name)}; give the one rendered")
    return shape


def _rig_name(rig: RigCalibration | Place) -> str:
    """What the record calls a rig."""
    return "a rig" if isinstance(rig, RigCalibration) else Path(rig).name


def _named(place: TargetGeometry | Place) -> str:
    """What the record calls a file."""
    return "NAME.target.json" if isinstance(place, TargetGeometry) else Path(place).name


_Item: TypeAlias = Observations | Detections | Place


def _items(observed: Several) -> tuple[_Item, ...]:
    """What was given, one by one.

    Raises:
        InputError: nothing, something else, or the photos of one camera among those of others.
    """
    items = (observed,) if isinstance(observed, Observations | PathLike) else several("observed", observed)
    if not items:
        raise InputError("no detections: give the detections.csv of photos of the print, or what was detected in them")
    for one in items:
        if not isinstance(one, Observations | Detections | str | PathLike):
            raise InputError(f"{shown(one)}: give files, observations, or what was detected in photos")
    if len({isinstance(one, Detections) for one in items}) > 1:
        raise InputError(
            "detections beside files or observations: detections of several photos are of one camera; make each "
            "camera's a file, or observations"
        )
    return items


def _ink_of_each(items: Sequence[_Item], nominal: TargetGeometry) -> list[InkBleed]:
    """What each file of detections, or the detections given, tell of the ink; tables and observations tell nothing."""
    photos = [one for one in items if isinstance(one, Detections)]
    paths = [path for path in _paths(items) if is_detections(path)]
    read = [read_detections(path, nominal, target_path=Path("the target")) for path in paths]
    return [ink for seen in (photos, *read) if (ink := ink_of_rings(seen, nominal)) is not None]


def _detections(items: Iterable[_Item], nominal: TargetGeometry) -> list[Detections]:
    """All detections among what was given, those of files too."""
    items = tuple(items)
    paths = [path for path in _paths(items) if is_detections(path)]
    read = [read_detections(path, nominal, target_path=Path("the target")) for path in paths]
    return [*(one for one in items if isinstance(one, Detections)), *(one for photos in read for one in photos)]


def _to_search(photos: Place | Iterable[Place], items: Sequence[_Item], nominal: TargetGeometry) -> FoundPhotos | None:
    """The photos that detections were found in; None: none are given.

    Raises:
        InputError: not of one camera's detections, or not all of their photos.
    """
    if not isinstance(photos, str | PathLike) and not (photos := tuple(photos)):
        return None
    seen = _detections(items, nominal)
    if not seen or (len(items) > 1 and _paths(items)):
        raise InputError(
            "--photos: they are searched again with one camera's lens; give the detections.csv of one camera"
        )
    given = photos_of(photos)
    named, wanted = named_photos(given.paths), {one.image for one in seen}
    if missing := sorted(wanted - {one.name for one in named}):
        raise InputError(f"--photos: {shown(missing[0])} is not among them; give all photos that the detections are of")
    return replace(given, paths=tuple(one.path for one in named if one.name in wanted))


def _searched(photos: FoundPhotos, nominal: TargetGeometry, found: AsBuilt, progress: Progress) -> Observations:
    """What is seen with the lens and the target that were measured, to be measured against the design."""
    search = PhotoSearch(found.target, photos, progress=progress).once(found.cameras[0])
    return observations_of([replace(one, geometry_id=nominal.geometry_id) for one in search.detections], nominal)


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
    return with_shared_error(found, measure_print(seen_through(found, before), nominal, model, options, lengths))


def _paths(items: Iterable[_Item]) -> list[Path]:
    """The files among what was given."""
    return [Path(one) for one in items if isinstance(one, str | PathLike)]


def _sets(
    items: Sequence[_Item],
    nominal: TargetGeometry,
    target: TargetGeometry | Place,
    image_size: tuple[int, int] | None,
    *,
    one_camera: bool,
) -> list[Observations]:
    """What each camera saw."""
    paths = _paths(items)
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


def _remarks(
    sets: Sequence[Observations], way: Made, lengths: Sequence[CaliperLength], nominal: TargetGeometry
) -> tuple[str, ...]:
    """What to know of photos, lengths and the way of making."""
    assumed = (way.sentence,) if way.because else ()
    return (*(line for one in sets for line in one.remarks), *assumed, *_doubts(lengths, way, nominal))


def _chosen(plan: SolvePlan, items: Sequence[_Item], sets: Sequence[Observations]) -> tuple[str, tuple[str, ...]]:
    """The model to measure with, and why it, in a line; nothing if it was asked for.

    Raises:
        InputError: the photos determine a camera of no model.
    """
    models = [model for model in plan.models if model in fitted_models()]
    if len(plan.models) == 1:
        return models[0], ()
    models = [model for model in plan.suited(sets[0])[0].models if model in fitted_models()]
    best = {model for path in _paths(items) if (model := _best_of_run(path.parent))}
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


def _parts(asked: int | None, views: int) -> int:
    """In how many parts photos are held out, of the camera with the fewest; 0: not."""
    if asked is None:
        return min(USUAL_PARTS, views) if views > LEAST_VIEWS else 0
    if asked and not (isinstance(asked, Integral) and LEAST_PARTS <= asked <= views):
        raise InputError(
            f"--held-out {asked}: {views} photos fall into {LEAST_PARTS} to {views} parts; give one of these, or 0 for "
            "none"
        )
    return asked
