"""A printed target as photos of it show it: what `calib measure` does."""

import os
from collections.abc import Sequence
from dataclasses import dataclass, replace
from os import PathLike
from pathlib import Path
from typing import TypeAlias

from calib.api.loading import Place, load_observations, observations_of, target_of
from calib.api.page_shown import ShownAsPage
from calib.api.progress import Progress, unheard
from calib.as_built.lengths import CaliperLength, length_in, rescaled
from calib.as_built.options import AsBuiltOptions
from calib.as_built.result import AsBuilt
from calib.as_built.solve import measure as measure_print
from calib.as_built.solve import with_known_weights
from calib.as_built_report.deviations import Estimate
from calib.as_built_report.files import TARGET_SUFFIX, MeasureReport, check_places, places_of, report_files, report_of
from calib.as_built_report.held_out import LEAST_FOLDS, HeldOut, gain_on_held_out
from calib.as_built_report.join import joined
from calib.as_built_report.length_words import AskedLength, doubt_about, parse_length
from calib.as_built_report.words import no_gain_line
from calib.cameras import COMMON, DEFAULT, fitted_models, learned_models
from calib.core.files import write_files
from calib.core.types import Detections, Observations
from calib.observe.dataset import read_detections
from calib.observe.observations import observations_from_detections
from calib.pipeline.solving import plan_from_words
from designer.base.answer import program
from designer.base.errors import InputError
from designer.base.units import NO_SKEW, Skew
from designer.base.words import suggestion
from designer.target import TargetGeometry, target_to_json
from designer.tolerance.made import EXACT, Made, how_made

LEAST_VIEWS = 3
"""Of a camera: from fewer, a target that may have any shape does not tell the camera."""
USUAL_FOLDS = 5
Several: TypeAlias = Observations | Place | Sequence[Detections] | Sequence[Place] | Sequence[Observations]
"""What was observed of a print: of one camera, or of several a file or observations each."""
MOST_COMPENSATION_PERCENT = 50.0


@dataclass(frozen=True, eq=False)
class MeasureResult(ShownAsPage):
    """A target as it was printed, and what that is worth: `measured.target`, `measured.report.whole.size`.

    In a notebook the result shows its page.
    """

    report: MeasureReport
    remarks: tuple[str, ...]  # on photos, lengths and the way of making, one line each; `found` has its own
    is_judged: bool  # whether the gain on photos held out was asked for
    measured_against: Path | None = None  # the file of the target as designed, which `save` leaves alone

    @property
    def found(self) -> AsBuilt:
        """The solution: cameras, faces, rings and their covariances."""
        return self.report.found

    @property
    def target(self) -> TargetGeometry:
        """The target as it was printed."""
        return self.found.target

    @property
    def why_not(self) -> str:
        """Why the measured target is not to be used, in a line; "" if it is, or if nobody asked."""
        if self.found.status == "degenerate":
            return "no camera is determined"
        return no_gain_line(self.report.held_out) if self.is_judged else ""

    def save(self, path: Place) -> tuple[Path, ...]:
        """Write `NAME.target.json`, and `NAME.as_built.json`, `.csv` and `.png` beside it; return the files.

        Raises:
            InputError: another name, a file of somebody else's, or the target it was measured against.
        """
        from calib.as_built_report.picture import report_picture

        places = places_of(Path(path))
        check_places(places, self.measured_against)
        files = {**report_files(self.report, places), places.picture: report_picture(self.report)}
        write_files(files)
        return tuple(files)

    def _write_all(self, folder: Path) -> tuple[Path, ...]:
        from calib.show.folder import write_folder_page

        return (*self.save(folder / f"measured{TARGET_SUFFIX}"), *write_folder_page(folder, "measure", "")[0])


def measure(
    target: TargetGeometry | Place,
    observed: Several,
    *,
    lengths: Sequence[str | CaliperLength] = (),
    model: str = COMMON,
    one_camera: bool = False,
    rings: str = "free",
    bow: bool | None = None,
    made: str | None = None,
    weighted: bool = True,
    reject_sigma: float | None = None,
    fix: Sequence[str] = (),
    share: Sequence[str] = (),
    shrink_compensation_percent: float = 0.0,
    skew_compensation_rad: Skew = NO_SKEW,
    bed_turn_rad: float = 0.0,
    image_size: tuple[int, int] | None = None,
    held_out: int | None = None,
    truth: TargetGeometry | Place | None = None,
    progress: Progress = unheard,
    settings: Sequence[tuple[str, str]] = (),
) -> MeasureResult:
    """Measure a print with photos of it: `measure("ico.target.json", "detections.csv").save("as_built.target.json")`.

    >>> measured = calib.measure("ico.target.json", "detections.csv", lengths=["face-to-face:151.20mm+-0.02mm"])
    >>> measured.target, measured.why_not

    Args:
        target: as designed: a geometry, or its file.
        observed: in photos of the print: a file, what was found in photos, or observations; several files or
            observations are of a camera each.
        lengths: of a caliper, which tell the size.
        model: of the cameras.
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
        held_out: hold every N-th photo out in turn to judge the gain; None: 5, fewer of few; 0: do not.
        truth: of rendered photos: the target they show, to judge the gain by too.
        progress: is told what is being done.
        settings: names and values to keep in the record, instead of those that follow from the arguments.

    Raises:
        InputError: files or options that break a rule, or photos too few.
    """
    nominal = _nominal(target)
    way = _way(nominal, made)
    asked = [_asked(one, nominal) for one in lengths]
    options = _options(model, rings, fix, share, reject_sigma, way, weighted=weighted, bow=bow)
    if not -MOST_COMPENSATION_PERCENT < shrink_compensation_percent < MOST_COMPENSATION_PERCENT:
        raise InputError(f"--shrink-compensation {shrink_compensation_percent:g}%: must lie between -50% and 50%")
    shape = None if truth is None else _truth(truth, nominal, target)
    sets = _sets(observed, nominal, target, image_size, one_camera=one_camera)
    remarks = (
        *(line for one in sets for line in one.remarks),
        *((way.sentence,) if way.because else ()),
        *filter(None, (doubt_about(one, nominal, way.errors) for one in asked)),
    )
    options = with_known_weights(options, sets)
    folds = _folds(held_out, min(one.view_count for one in sets))
    progress("measuring", 0, 0)
    found = measure_print(sets, nominal, model, options, [one.length for one in asked])
    held = _held_out(found, model, options, folds, shape, progress)
    record = {
        "target": _named(target), "detections": ", ".join(map(_named, _places(observed))), "model": model,
        "rings": rings, "one-camera": str(one_camera), "weighted": str(options.solve.weighted),
        "reject": f"{reject_sigma or ''}", "bow": {None: "default", True: "bow", False: "flat"}[bow],
        "fix": " ".join(fix), "made": made or "", "share": " ".join(share),
        "shrink-compensation": f"{shrink_compensation_percent:g}%",
        "skew-compensation": " ".join(f"{one:g}rad" for one in skew_compensation_rad),
        "bed-turn": f"{bed_turn_rad:g}rad", "length": "; ".join(one.text for one in asked), "held-out": str(folds),
    }  # fmt: skip
    report = report_of(
        found, held, asked, made_with_percent=shrink_compensation_percent, made_with_skew_rad=skew_compensation_rad,
        bed_turn_rad=bed_turn_rad, weighted=options.solve.weighted, program=program(),
        settings=tuple({**record, **dict(settings)}.items()),
    )  # fmt: skip
    against = None if isinstance(target, TargetGeometry) else Path(target)
    return MeasureResult(report, remarks, held_out != 0, against)


@dataclass(frozen=True, eq=False)
class RescaledTarget:
    """A target made larger or smaller by one length: `resized.target`, `resized.save("as_built.target.json")`."""

    nominal: TargetGeometry
    target: TargetGeometry
    asked: AskedLength
    remarks: tuple[str, ...]  # why the length may be no reading
    measured_against: Path | None = None

    @property
    def factor(self) -> float:
        """How many times as large it is."""
        return self.asked.length.value_mm / length_in(self.nominal, self.asked.length.name)

    @property
    def size(self) -> Estimate:
        """How much larger than designed, as a share."""
        return Estimate(self.factor - 1, self.asked.length.sigma_mm / self.asked.length.value_mm)

    def save(self, path: Place) -> Path:
        """Write `NAME.target.json`; return its place.

        Raises:
            InputError: another name, a file of somebody else's, or the target as designed.
        """
        places = places_of(Path(path))
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
    asked = _asked(length, nominal, "--measured-length")
    against = None if isinstance(target, TargetGeometry) else Path(target)
    doubts = tuple(filter(None, (doubt_about(asked, nominal, way.errors),)))
    return RescaledTarget(nominal, rescaled(nominal, asked.length), asked, doubts, against)


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


def _asked(length: str | CaliperLength, target: TargetGeometry, option: str = "--length") -> AskedLength:
    if isinstance(length, str):
        return parse_length(option, length, target)
    return parse_length(option, f"{length.name}:{length.value_mm!r}mm+-{length.sigma_mm!r}mm", target)


def _options(
    model: str,
    rings: str,
    fix: Sequence[str],
    share: Sequence[str],
    reject_sigma: float | None,
    made: Made,
    *,
    weighted: bool,
    bow: bool | None,
) -> AsBuiltOptions:
    if model in learned_models():
        raise InputError(
            f"--model {model}: its map is learned from the target's own rings, so it cannot measure them; measure with "
            f"{COMMON} or {DEFAULT}, then solve {model} with the measured target"
        )
    if model not in fitted_models():
        hint = suggestion(model, list(fitted_models())) or f"; there are {', '.join(fitted_models())}"
        raise InputError(f"--model {model!r}: cannot measure a target{hint}")
    if rings not in ("free", "rigid"):
        raise InputError(f"--rings {rings!r}: it must be free or rigid")
    plan = plan_from_words(
        model, fix=fix, share=share, focal_px=None, loss="squares", reject=reject_sigma, weighted=weighted
    )
    options = AsBuiltOptions(made=made, bow=bow, solve=plan.options)
    return options if rings == "free" else replace(options, ring_sigma_mm=None)


def _truth(truth: TargetGeometry | Place, nominal: TargetGeometry, name: TargetGeometry | Place) -> TargetGeometry:
    """The geometry that rendered photos show."""
    shape = target_of(truth)
    if shape.layout_id != nominal.layout_id:
        raise InputError(f"--truth {_named(truth)}: has another layout than {_named(name)}; give the one rendered")
    return shape


def _named(place: TargetGeometry | Place) -> str:
    """What the record calls a file."""
    return "NAME.target.json" if isinstance(place, TargetGeometry) else Path(place).name


def _sets(
    observed: Several,
    nominal: TargetGeometry,
    target: TargetGeometry | Place,
    image_size: tuple[int, int] | None,
    *,
    one_camera: bool,
) -> list[Observations]:
    """What each camera saw."""
    paths = _places(observed)
    for path in paths:
        if sum(os.path.realpath(other) == os.path.realpath(path) for other in paths) > 1:
            raise InputError(f"{path}: given twice; give each detections file once")
    if one_camera and len(paths) > 1:
        against = Path("the target") if isinstance(target, TargetGeometry) else Path(target)
        files = [read_detections(path, nominal, target_path=against) for path in paths]
        whole, origin = joined(files, [path.stem for path in paths]), ", ".join(map(str, paths))
        named = [(origin, observations_from_detections(whole, nominal, origin=origin))]
    elif paths:
        named = [(str(path), load_observations(path, target, image_size=image_size)) for path in paths]
    else:
        named = [("the observations", one) for one in _values(observed, nominal)]
    for name, one in named:
        if one.view_count < LEAST_VIEWS:
            raise InputError(
                f"{name}: {one.view_count} photos can be used; a camera needs at least {LEAST_VIEWS}, and "
                "20 or more from all sides to measure a target well"
            )
    return [one for _, one in named]


def _places(observed: Several) -> list[Path]:
    """The files that were given; none if values were."""
    if isinstance(observed, Observations):
        return []
    every = [observed] if isinstance(observed, str | PathLike) else observed
    return [Path(one) for one in every if isinstance(one, str | PathLike)]


def _values(observed: Several, nominal: TargetGeometry) -> list[Observations]:
    """The observations of each camera that were given as values; detections are of one camera."""
    if isinstance(observed, Observations):
        return [observed]
    if isinstance(observed, str | PathLike):
        return []
    every = [one for one in observed if isinstance(one, Observations)]
    seen = [one for one in observed if isinstance(one, Detections)]
    return [*every, *([observations_of(seen, nominal)] if seen or not every else [])]


def _folds(asked: int | None, views: int) -> int:
    """In how many parts photos are held out, of the camera with the fewest; 0: not."""
    if asked is None:
        return min(USUAL_FOLDS, views) if views > LEAST_VIEWS else 0
    if asked and not LEAST_FOLDS <= asked <= views:
        raise InputError(
            f"--held-out {asked}: {views} photos fall into {LEAST_FOLDS} to {views} parts; give one of these, or 0 for "
            "none"
        )
    return asked


def _held_out(
    found: AsBuilt,
    model: str,
    options: AsBuiltOptions,
    folds: int,
    truth: TargetGeometry | None,
    progress: Progress,
) -> HeldOut | None:
    """What is gained on photos that take no part; None if it was not asked for, or is not to be had."""
    if not folds or found.status == "degenerate":
        return None
    return gain_on_held_out(
        found, model, options, folds, truth=truth, done=lambda part: progress("judging parts", part, folds)
    )
