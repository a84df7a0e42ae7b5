"""A target before a camera, as a study of its errors photographs it."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from os import fspath
from pathlib import Path

from calib.cameras.camera import Camera
from calib.solver.problem import SolveOptions
from calib.studies.tolerance.explore import PhotographedTarget
from calib.studies.tolerance.record import PhotographedSetting
from calib.studies.tolerance.seen import view_fit
from calib.studies.tolerance.setting import make_setting
from designer.base.errors import InputError
from designer.base.words import printable
from designer.kinds.layout import Viewpoints, advised_photos
from designer.kinds.presets import preset_names
from designer.target import TargetGeometry, bounding_radius_mm
from designer.tolerance.error_file import error_model
from designer.tolerance.model import ErrorModel


@dataclass(frozen=True)
class Photographing:
    """How targets are photographed and calibrated: the same for both that are compared."""

    views: int
    camera: Camera
    camera_name: str
    model: str
    weighted: bool
    seed: int
    aim_offset_mm: float | None  # None: as advised


def photographed(
    geometry: TargetGeometry, name: str, file: Path, errors: str, changes: Sequence[str],
    distance_mm: tuple[float, float] | None, by: Photographing,
) -> PhotographedTarget:  # fmt: skip
    """A target with its errors, and its photos.

    Args:
        geometry: of the target.
        name: what it is called in tables.
        file: with it, which tells a study from another.
        errors: an error template, or a TOML file.
        changes: other sizes of single errors: `face_tilt=0.1deg`.
        distance_mm: between which two the cameras stand; None: as the page of a design advises.
        by: the rest.

    Raises:
        InputError: errors or a distance that break a rule.
    """
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
        f"{_count(by.views, 'view')} from {range_words(photos.distance_mm)}, looking up to "
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
    way = printable(fspath(errors))
    ways = {way: error_model(errors), **templates_for(geometry)}
    return PhotographedTarget(name, file, setting, made, words, way, ways)


def _photos(target: TargetGeometry, distance_mm: tuple[float, float] | None, aim_offset_mm: float | None) -> Viewpoints:
    """What was asked for, and what was left open as a design's page advises.

    Raises:
        InputError: a camera would stand in the target, or in what it looks at.
    """
    photos = advised_photos(target, distance_mm)
    photos = photos if aim_offset_mm is None else replace(photos, aim_offset_mm=aim_offset_mm)
    near, far = photos.distance_mm
    inside = bounding_radius_mm(target)
    if not inside + photos.aim_offset_mm < near <= far:
        past = f", and the aim {photos.aim_offset_mm:g}mm" if photos.aim_offset_mm else ""
        raise InputError(
            f"--distance {range_words((near, far))}: the target reaches {inside:.0f}mm from its origin{past}; stay "
            "farther away"
        )
    return photos


def range_words(distance_mm: tuple[float, float]) -> str:
    """`250mm..500mm`, or one of them where both are the same."""
    near, far = distance_mm
    return f"{near:g}mm" if near == far else f"{near:g}mm..{far:g}mm"


def templates_for(target: TargetGeometry) -> dict[str, ErrorModel]:
    """The ways of making that travel with the program and suit a target, by name."""
    models = {name: error_model(name) for name in preset_names("errors")}
    return {name: model for name, model in models.items() if model.suits_target(target)}


def _count(number: int, noun: str) -> str:
    return f"{number} {noun}{'' if number == 1 else 's'}"
