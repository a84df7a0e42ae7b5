"""What manufacturing errors cost a calibration, and how large they may be: what `design tolerance` does."""

import shlex
from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import dataclass, replace
from os import fspath
from pathlib import Path
from tempfile import TemporaryDirectory

from calib.api.page_shown import ShownAsPage
from calib.app.inputs import (
    DISTANCES_MM,
    MAX_SEED,
    Place,
    ask_cluster,
    camera_of,
    folder_of,
    processes_of,
    target_of,
)
from calib.cameras import DEFAULT
from calib.cameras.camera import Camera
from calib.renderer.poses import MAX_VIEWS
from calib.renderer.quantities import real, whole
from calib.solver.options import SolveOptions
from calib.studies.progress import DrawCount
from calib.studies.tolerance.explore import PhotographedTarget, TolerancePlan, compared, explore
from calib.studies.tolerance.quantities import parse_requirements, quantity_named
from calib.studies.tolerance.record import PhotographedSetting, ToleranceStudy
from calib.studies.tolerance.seen import view_fit
from calib.studies.tolerance.setting import make_setting
from calib.studies.tolerance.stored import Keeping
from calib.studies.tolerance.what_if import WhatIf
from designer.base.errors import InputError
from designer.base.files import check_folder, write_files
from designer.base.small_file import place_of
from designer.base.words import cut, printable, several
from designer.kinds.layout import Viewpoints, advised_photos
from designer.kinds.presets import preset_names
from designer.page.progress import Progress, unheard
from designer.target import TargetGeometry, bounding_radius_mm, target_to_json
from designer.tolerance.error_file import error_model
from designer.tolerance.made import error_model_for
from designer.tolerance.model import ErrorModel
from designer.tolerance.sources import source_named

MAX_DRAWS = 1_000_000


@dataclass(frozen=True, eq=False)
class ToleranceResult(ShownAsPage):
    """What errors cost, and how large they may be: `found.study.cost("scale", "pose").cost`, `found.save("tolerance")`.

    In a notebook the result shows its page.
    """

    study: ToleranceStudy
    drawn: DrawCount
    kind = "tolerance"

    @property
    def is_kept(self) -> bool:
        """Whether all limits are kept."""
        return self.study.is_kept

    def what_if(self, errors: str | None = None, **sizes: str) -> WhatIf:
        """What the calibration would be with other errors: `found.what_if("resin", skew="0.05deg").total("pose")`.

        As `calib.studies.tolerance.record.ToleranceStudy.what_if`: predicted, in less than a millisecond.
        """
        return self.study.what_if(errors, **sizes)

    def save(self, folder: Place, *, formats: Sequence[str] = ()) -> tuple[Path, ...]:
        """Write the tables and figures; return the files.

        Args:
            folder: for them; the draws are in the folder that `tolerance` was given, if it was.
            formats: of the figures besides PNG: `pdf`, `svg`.

        Raises:
            InputError: the folder takes no files, or holds somebody else's.
        """
        from calib.show.studies.tolerance_files import tolerance_files

        place = folder_of(folder)
        check_folder(place)
        files = tolerance_files(self.study, place, formats)
        write_files(files)
        return tuple(files)


@dataclass(frozen=True)
class _Photographing:
    """How targets are photographed and calibrated: the same for both."""

    views: int
    camera: Camera
    camera_name: str
    model: str
    weighted: bool
    seed: int
    aim_offset_mm: float | None  # None: as advised


def tolerance(
    target: TargetGeometry | Place,
    errors: str,
    *,
    changes: Sequence[str] = (),
    views: int = 90,
    distance_mm: float | tuple[float, float] | None = None,
    aim_offset_mm: float | None = None,
    camera: Camera | Place = "machine-vision",
    model: str = DEFAULT,
    weighted: bool = False,
    draws: int = 200,
    full: bool = False,
    linear: bool = False,
    require: Sequence[str] = (),
    by: str | None = None,
    against: TargetGeometry | Place | None = None,
    against_errors: str | None = None,
    against_changes: Sequence[str] = (),
    against_distance_mm: float | tuple[float, float] | None = None,
    vary: str | None = None,
    seed: int = 1,
    jobs: int | None = None,
    dask: str | None = None,
    resume: bool = False,
    out: Place | None = None,
    progress: Progress = unheard,
) -> ToleranceResult:
    """What errors of a target cost a calibration: `tolerance("ico.target.json", "fdm-dual", linear=True)`.

    >>> found = calib.tolerance("ico.target.json", "fdm-dual", require=["intersection=0.05mm"])
    >>> found.is_kept, found.study.total("intersection"), found.save("tolerance")

    Args:
        target: a geometry, or its file.
        errors: an error template, or a TOML file.
        changes: other sizes of single errors: `face_tilt=0.1deg`.
        views: how many photos.
        distance_mm: of the cameras from the target's origin, or between which two; None: near and far, as the page of
            a design advises.
        aim_offset_mm: how far they look past the target at most; None: as advised, into the image's corners.
        camera: a camera, a file, or a template.
        model: that is solved, one of `calib.cameras.fitted_models()`.
        weighted: weigh observations by their covariances, or all alike.
        draws: how many made targets to draw.
        full: render and detect real images in each draw, which takes minutes a draw.
        linear: no draws: predict from Jacobians, in seconds.
        require: limits, `intersection=0.05mm`, for which the largest errors are told.
        by: the quantity to rank errors by; None: the first that is required.
        against: another target to compare with.
        against_errors: the errors of that target.
        against_changes: other sizes of single errors of that target, as `changes`.
        against_distance_mm: to that target; None: the same, or as advised for it.
        vary: the error to compare by; None: the worst one of faces.
        seed: of all that is random.
        jobs: processes; None: one per core.
        dask: address of a cluster's scheduler, which computes the draws instead.
        resume: go on with the study in the folder.
        out: a folder to keep the draws in, so that a stopped study goes on; None: they are not kept.
        progress: is told what is being done.

    Raises:
        InputError: files or options that break a rule; the message names it.
        StudyStoppedError: interrupted, or no workers are left; the draws in a folder are kept.
    """
    requirements = parse_requirements(require)
    chosen = by or (requirements[0].quantity if requirements else "intersection")
    photographing = _Photographing(
        whole("--views", views, 1, MAX_VIEWS), camera_of(camera),
        camera.model if isinstance(camera, Camera) else fspath(camera), model, weighted,
        whole("--seed", seed, 0, MAX_SEED),
        None if aim_offset_mm is None else real("--aim-offset", aim_offset_mm, 0, DISTANCES_MM[1], "mm"),
    )  # fmt: skip
    count = whole("--draws", draws, 2, MAX_DRAWS)
    by = quantity_named(chosen).name
    processes = processes_of(jobs)
    _check_mode(full=full, linear=linear, resume=resume, dask=dask)
    _check_against(against, against_errors, against_changes, against_distance_mm, vary)
    ask_cluster(dask, progress)
    if out is not None:
        check_folder(folder_of(out))
    progress("setting up", 0, 0)
    with ExitStack() as stack:
        place = Path(stack.enter_context(TemporaryDirectory())) if out is None else Path(out)
        keeping = Keeping(place, processes, dask, resume)
        plan = TolerancePlan(count, seed, requirements, by, full, linear, keeping, progress)
        first = _photographed(target, errors, changes, distance_mm, photographing, stack)
        other = None
        if against is not None and against_errors is not None:
            distance = distance_mm if against_distance_mm is None else against_distance_mm
            other = _photographed(against, against_errors, against_changes, distance, photographing, stack)
            if other.name == first.name:
                same = other.errors.name == first.errors.name
                other = replace(other, name=f"{other.name} ({'other' if same else other.errors.name})")
        if vary is not None and first.errors.amount(source_named(vary).name).sigma == 0:
            raise InputError(f"--vary {vary}: has no size in {first.errors.name}; give it one, such as with --set")
        if full:
            remarks = (*first.words.remarks, "photos of every draw are rendered, detected and calibrated")
            first = replace(first, words=replace(first.words, remarks=remarks))
        keeping.check_unused(predicts=linear)
        study, table, drawn = explore(first, plan)
        if other is not None:
            study = compared(study, table, other, plan, vary)
    return ToleranceResult(study, drawn)


def ways(
    target: TargetGeometry | Place,
    *,
    by: str = "distortion_map",
    views: int = 90,
    distance_mm: float | tuple[float, float] | None = None,
    aim_offset_mm: float | None = None,
    camera: Camera | Place = "machine-vision",
    model: str = DEFAULT,
    weighted: bool = False,
    seed: int = 1,
    progress: Progress = unheard,
) -> ToleranceResult:
    """In which way a target is best made: `ways("ico.target.json").study.ways()`.

    >>> best = calib.ways("ico.target.json").study.ways()[0]
    >>> best.way.name, best.total("focal_length"), best.way.price_eur, best.way.hours

    All error templates that suit the target, predicted at once. The study is that of `tolerance`, of the way in which
    the file says that the target is made.

    Args:
        target: a geometry, or its file.
        by: the quantity that ways are ranked by.
        views: how many photos.
        distance_mm: of the cameras from the target's origin, or between which two; None: near and far, as the page of
            a design advises.
        aim_offset_mm: how far they look past the target at most; None: as advised, into the image's corners.
        camera: a camera, a file, or a template.
        model: that is solved.
        weighted: weigh observations by their covariances, or all alike.
        seed: of all that is random.
        progress: is told what is being done.

    Raises:
        InputError: files or options that break a rule; the message names it.
    """
    geometry = target_of(target, "rings")
    assumed = error_model_for(geometry)
    usual = next(iter(_templates(geometry)))
    return tolerance(
        target, usual if assumed is None else assumed.errors.name, views=views, distance_mm=distance_mm,
        aim_offset_mm=aim_offset_mm, camera=camera, model=model, weighted=weighted, linear=True, by=by, seed=seed,
        progress=progress,
    )  # fmt: skip


def _check_mode(*, full: bool, linear: bool, resume: bool, dask: str | None) -> None:
    """Refuse options that do not fit the prediction."""
    for option, is_given in (("--full", full), ("--resume", resume), (f"--dask {dask}", dask is not None)):
        if linear and is_given:
            raise InputError(f"{option} does not fit --linear, which draws nothing; leave one of them out")


def _check_against(
    against: TargetGeometry | Place | None,
    against_errors: str | None,
    against_changes: Sequence[str],
    against_distance_mm: float | tuple[float, float] | None,
    vary: str | None,
) -> None:
    """Refuse options that say nothing without another one."""
    if against is not None and against_errors is None:
        raise InputError(f"--against {_path_of(against)}: say how it is made too, such as --against-errors fdm-board")
    distance = None if against_distance_mm is None else _range_words(_both(against_distance_mm))
    sizes = " ".join(map(str, several("--against-set", against_changes))) or None
    for option, value in (
        ("--against-errors", against_errors), ("--against-set", sizes), ("--against-distance", distance),
        ("--vary", vary),
    ):  # fmt: skip
        if value is not None and against is None:
            raise InputError(f"{option} {value} says nothing without --against; name the other target's file")


def _photographed(
    target: TargetGeometry | Place,
    errors: str,
    changes: Sequence[str],
    distance_mm: float | tuple[float, float] | None,
    by: _Photographing,
    stack: ExitStack,
) -> PhotographedTarget:
    """Read a target and its errors, and set up its photos.

    Raises:
        InputError: a file, a quantity or an option that breaks a rule.
    """
    geometry = target_of(target, "rings")
    made = error_model(errors, changes)
    photos = _photos(geometry, distance_mm, by.aim_offset_mm)
    fit = view_fit(geometry, by.camera, photos.distance_mm[1]).remark
    try:
        setting = make_setting(
            geometry, by.camera, views=by.views, photos=photos, model=by.model, seed=by.seed,
            options=SolveOptions(weighted=by.weighted),
        )  # fmt: skip
    except InputError as error:
        raise InputError(f"{error}{f' ({fit})' if fit else ''}") from None
    advised = " (as its design's page advises)" if photos == advised_photos(geometry) else ""
    photos_words = (
        f"{_count(geometry.face_count, 'face')}, {geometry.ring_count} rings; "
        f"{_count(by.views, 'view')} from {_range_words(photos.distance_mm)}, looking up to "
        f"{photos.aim_offset_mm:g}mm past the target's middle{advised}, by {by.camera_name}, "
        f"{len(setting.observations.view)} observations; solved: {by.model}{', weighted' if by.weighted else ''}"
    )
    is_nominal, is_solid = geometry.source == "nominal", not geometry.is_planar
    remarks = (
        *([] if is_nominal else [f"the target file is a {geometry.source} one; its shape is taken as the drawing"]),
        *(["layers and axes are those of a print that lies on its last face"] if is_solid else []),
        *setting.remarks,
    )
    words = PhotographedSetting(photos_words, f"{made.name}: {made.title}", remarks, (fit,) if fit else ())
    name, way = _name_of(_path_of(target)), printable(fspath(errors))
    ways = {way: error_model(errors), **_templates(geometry)}
    return PhotographedTarget(name, _file_of(target, stack), setting, made, words, way, ways)


def _photos(
    target: TargetGeometry, distance_mm: float | tuple[float, float] | None, aim_offset_mm: float | None
) -> Viewpoints:
    """What was asked for, and what was left open as a design's page advises.

    Raises:
        InputError: a camera would stand in the target, or in what it looks at.
    """
    both = None if distance_mm is None else _both(distance_mm)
    photos = advised_photos(target, both)
    photos = photos if aim_offset_mm is None else replace(photos, aim_offset_mm=aim_offset_mm)
    near, far = photos.distance_mm
    inside = bounding_radius_mm(target)
    if not inside + photos.aim_offset_mm < near <= far:
        past = f", and the aim {photos.aim_offset_mm:g}mm" if photos.aim_offset_mm else ""
        raise InputError(
            f"--distance {_range_words((near, far))}: the target reaches {inside:.0f}mm from its origin{past}; stay "
            "farther away"
        )
    return photos


def _both(distance_mm: float | tuple[float, float]) -> tuple[float, float]:
    """The nearest and the farthest distance."""
    near, far = distance_mm if isinstance(distance_mm, tuple) and len(distance_mm) == 2 else (distance_mm, distance_mm)
    near, far = (real("--distance", one, *DISTANCES_MM, "mm") for one in (near, far))
    return near, far


def _range_words(distance_mm: tuple[float, float]) -> str:
    near, far = distance_mm
    return f"{near:g}mm" if near == far else f"{near:g}mm..{far:g}mm"


def _templates(target: TargetGeometry) -> dict[str, ErrorModel]:
    """The ways of making that travel with the program and suit a target, by name."""
    models = {name: error_model(name) for name in preset_names("errors")}
    return {name: model for name, model in models.items() if model.suits_target(target)}


def _file_of(target: TargetGeometry | Place, stack: ExitStack) -> Path:
    """A file with the target, which tells a study from another."""
    if not isinstance(target, TargetGeometry):
        return Path(target)
    place = Path(stack.enter_context(TemporaryDirectory())) / "target.json"
    place.write_text(target_to_json(target))
    return place


def _path_of(target: TargetGeometry | Place) -> Path:
    return Path("target") if isinstance(target, TargetGeometry) else place_of(target, "a target geometry, or its file")


def _count(number: int, noun: str) -> str:
    return f"{number} {noun}{'' if number == 1 else 's'}"


def _name_of(path: Path) -> str:
    """What a target is called in tables."""
    return cut(printable(path.name.removesuffix(".json").removesuffix(".target")) or shlex.quote(str(path)))
