"""What a plan of photos is made for: the lens, the side of the target, and who or what holds it."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from calib.app.inputs import DISTANCES_MM, Place
from calib.cameras import COMMON, WIDE, fitted_models
from calib.cameras.camera import Camera
from calib.cameras.refit import refit
from calib.cameras.surface import surface_model
from calib.core.types import KnownPoints
from calib.records.hand_eye_file import HAND_EYE, HAND_EYE_FILE, HandEye
from calib.renderer.quantities import real
from calib.solver.calibration import Calibration
from calib.verdict.before_photos import usual_hold
from calib.verdict.views import Habits, TargetShape
from designer.base.errors import InputError
from designer.base.number_text import figure
from designer.base.small_file import place_of
from designer.target import TargetGeometry

Array = NDArray[np.float64]

TABLE_STEP_DEG = 5.0


@dataclass(frozen=True, eq=False)
class Carried:
    """What holds target or camera, and how it may."""

    held: Habits
    hand: HandEye | None = None  # None: a person holds the target
    table_deg: Array | None = None  # (C,) that a table can have
    at: Array | None = None  # (C, 4, 4) cam_from_target of these


def hand_of(hand_eye: HandEye | Place | None) -> HandEye | None:
    """What holds camera or target, or that of a file or a folder; None: a person does."""
    if hand_eye is None or isinstance(hand_eye, HandEye):
        return hand_eye
    place = place_of(hand_eye, "a hand_eye.json, or its folder")
    return HAND_EYE.read(place / HAND_EYE_FILE if place.is_dir() else place)


def planned_camera(camera: Camera, goal_px: float) -> tuple[Camera, str]:
    """The camera in a model that few photos determine, and what is to be said of the lens."""
    if camera.model in fitted_models():
        return camera, "the lens is taken to be one that its model follows, and photos to be sharp; calib run tells"
    surface = surface_model(camera.model)
    plain = {COMMON, WIDE} if surface is None else {COMMON, WIDE, surface.base.name}
    found = min((refit(camera, model) for model in sorted(plain)), key=lambda one: one.max_px)
    near, model = figure(found.max_px, 2), found.camera.model
    said = f"planned for a camera of the model {model}, from which this one, {camera.model}, differs by up to {near} px"
    if found.max_px > goal_px:
        said += ", more than is wanted: what is promised is of that model, not of this camera"
    return found.camera, said


def front_of(target: TargetGeometry, points: KnownPoints) -> KnownPoints:
    """The points of what is photographed: of a board with two sides those of the front; the others lie on no face."""
    if not target.is_plate or target.is_planar:
        return points
    return replace(points, face=np.where(points.face == 0, 0, -1))


def carried_by(
    hand: HandEye | None, before: Calibration, shape: TargetShape, distance_mm: tuple[float, float] | None
) -> Carried:
    """Who holds the target, and from where to where."""
    reach = None if distance_mm is None else _distances(distance_mm)
    held = usual_hold(before, shape, reach)
    if hand is None or hand.frame != "table":
        return Carried(held, hand)
    if reach is not None:
        raise InputError("--distance: a turntable's target stays where it stands; leave it out")
    angle_deg = np.arange(0.0, 360.0, TABLE_STEP_DEG)
    at = hand.cam_from_target_on_table(np.radians(angle_deg))
    away = np.linalg.norm(at[:, :3, :3] @ shape.center_mm + at[:, :3, 3], axis=1)
    return Carried(replace(held, distance_mm=(float(away.min()), float(away.max()))), hand, angle_deg, at)


def _distances(distance_mm: tuple[float, float]) -> tuple[float, float]:
    near, far = (real("--distance", one, *DISTANCES_MM, " mm") for one in distance_mm)
    if near > far:
        raise InputError(f"--distance {near:g}..{far:g} mm: the smaller comes first")
    return near, far
