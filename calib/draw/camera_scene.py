"""Where photos were taken from, in 3D: around their target, or around the axes of its frame."""

import numpy as np

from calib.cameras.camera import Camera
from calib.core.types import KnownPoints
from calib.draw.rig_scene import CAMERA, body_words, seen_from_both_sides, unit, view_of
from calib.judge.next_views import NextView
from calib.judge.solutions import Solution
from calib.judge.views import view_facts
from calib.solver.metrics.errors import centers_mm
from calib.solver.metrics.evaluation import by_view
from designer.base.arrays import Array
from designer.base.words import counted, printable, span
from designer.base.words import figure as digits
from designer.page.blocks import View3d
from designer.page.scene import Layer, Rings, Scene, Segments, Surface
from designer.target import TargetGeometry
from designer.target_scene import AXES, camera_layer, camera_size_mm, target_layers

BODY, INK = "#f4f4f2", "#2b2b2b"
NEXT = "#D55E00"
"""Of photos that are still to be taken: Okabe and Ito's vermilion."""
UNKNOWN = "#8a9099"
RING_SHARE, HOLE_SHARE, MARGIN_SHARE = 0.33, 0.45, 0.6
"""Of a target that is known by its points only: outer radius and margin over the distance of neighbours, and the hole
over the radius."""
STEPS = 5
"""Colours of the legend."""
READABLE = (0.35, 0.9)
"""The part of a scale of colours that stands out from a light and from a dark page."""
MOST_POINTS_FOR_PITCH = 2000
SIDE = 0.9
"""How far from the cameras' mean direction the viewer stands at first, as a tangent."""


def camera_view(one: Solution, target: TargetGeometry | None, proposed: tuple[NextView, ...]) -> View3d:
    """The scene and what it shows in words; a target that is not known is drawn from its points."""
    calibration = one.calibration
    errors = one.evaluated.of("reprojection")
    summaries = None if errors is None else by_view(one.evaluated, errors)
    views = calibration.observations.view_count
    rmse = np.full(views, np.nan) if summaries is None else np.array([summary.rmse for summary in summaries])
    colours, legend = _colours(rmse)
    names = tuple(
        f"{printable(name)}: RMS {digits(value, 2)} px"
        for name, value in zip(calibration.observations.view_names, rmse.tolist(), strict=True)
    )
    poses, sight = calibration.cam_from_target, view_of(calibration.camera)
    size_mm = camera_size_mm(poses)
    points = calibration.observations.points
    body = points_layers(points) if target is None else target_layers(target, body_colour=BODY, ink_colour=INK)
    layers = [*body, camera_layer(poses, sight, names, colours, size_mm)]
    if proposed:
        where = np.stack([view.cam_from_target for view in proposed])
        said = tuple(f"next {number}: {printable(view.sentence)}" for number, view in enumerate(proposed, start=1))
        layer = camera_layer(where, sight, said, (NEXT,), size_mm)
        layers.append(Layer("next photos", layer.shapes))
        legend = (*legend, (NEXT, "photo to take next"))
    centre = centers_mm(poses)
    up, from_direction = first_look(poses, centre, is_flat=len(points.plane) == 1)
    colours_mean = "its colour the root mean square of its residuals"
    return View3d(
        "Cameras around the target", Scene(tuple(layers), up, from_direction, legend), spread_words(one),
        f"Each {body_words(sight)} is a photo, {colours_mean}. Point at one for its name.",
    )  # fmt: skip


def spread_words(one: Solution) -> str:
    """From where photos were taken, as a sentence."""
    points, facts = one.calibration.observations.points, view_facts(one.calibration)
    words = f"{len(facts.name)} photos from {span(facts.distance_mm.tolist(), 3)} mm away"
    known = facts.tilt_deg[np.isfinite(facts.tilt_deg[:, 2]), 2]
    if facts.is_flat and len(known):
        words += f", tilted by {known.min():.0f} to {known.max():.0f}° against the image"
    elif len(points.plane) > 1:
        seen = np.unique(points.face[one.calibration.observations.point])
        words += f", which show {len(seen[seen >= 0])} of {len(points.plane)} faces"
    return f"{words}."


def _colours(rmse: Array) -> tuple[tuple[str, ...], tuple[tuple[str, str], ...]]:
    """A colour of each photo by its residuals, and what some colours mean."""
    from matplotlib import colormaps
    from matplotlib.colors import to_hex

    known = rmse[np.isfinite(rmse)]
    if not len(known):
        return (UNKNOWN,), ()
    least, most = float(known.min()), float(known.max())
    span = most - least if most > least else 1.0
    dim, bright = READABLE

    def colour(x: float) -> str:
        return to_hex(colormaps["cividis"](dim + (bright - dim) * (x - least) / span))

    colours = tuple(colour(x) if np.isfinite(x) else UNKNOWN for x in rmse.tolist())
    steps = np.linspace(least, most, STEPS) if most > least else np.array([least])
    return colours, tuple((colour(x), f"{digits(x, 2)} px") for x in steps.tolist())


def first_look(poses: Array, centre: Array, *, is_flat: bool) -> tuple[tuple[float, float, float], ...]:
    """What is up, and from where one looks first: up as the cameras had it, if they agree, and from beside them."""
    up = -poses[:, 1, :3].mean(axis=0)
    if np.linalg.norm(up) < 0.5:
        up = np.array([0.0, 1.0, 0.0] if is_flat else [0.0, 0.0, 1.0])
    towards = centre / np.maximum(np.linalg.norm(centre, axis=1, keepdims=True), 1e-9)
    mean = towards.mean(axis=0)
    if np.linalg.norm(mean) < 0.2:
        mean = np.array([1.0, -0.4, 0.3])
    mean = mean / np.linalg.norm(mean)
    up = up / np.linalg.norm(up)
    aside = np.cross(up, mean)
    if np.linalg.norm(aside) < 0.3:  # the cameras look down along what is up
        up = np.array([1.0, 0.0, 0.0]) if abs(mean[0]) < 0.7 else np.array([0.0, 1.0, 0.0])
        aside = np.cross(up, mean)
    direction = mean + SIDE * aside / np.linalg.norm(aside) + 0.35 * up
    return unit(up), unit(direction)


def points_layers(points: KnownPoints) -> tuple[Layer, ...]:
    """A target as its points tell, with rings around them."""
    place = points.position_mm
    if not len(place):
        return ()
    if not len(points.plane):
        tips = np.stack([place - _pitch_mm(place) / 10, place + _pitch_mm(place) / 10], axis=1)
        return (Layer("target", (Segments(tips, (INK,)),), has_switch=False),)
    pitch = _pitch_mm(place)
    known = points.face >= 0
    radius = np.full(int(known.sum()), RING_SHARE * pitch)
    normal = points.plane[points.face[known], :3]
    rings = Rings(place[known] + 0.002 * pitch * normal, normal, radius, HOLE_SHARE * radius, (INK,))
    faces = [_face(place[points.face == row], plane, MARGIN_SHARE * pitch) for row, plane in enumerate(points.plane)]
    return (Layer("target", (*(face for face in faces if face is not None), rings), has_switch=False),)


def _pitch_mm(place: Array) -> float:
    """The usual distance of a point from its nearest neighbour."""
    some = place[: min(len(place), MOST_POINTS_FOR_PITCH)]
    if len(some) < 2:
        return 1.0
    nearest = [np.partition(np.linalg.norm(some - one, axis=1), 1)[1] for one in some[:200]]
    return max(float(np.median(nearest)), 1e-6)


def _face(place: Array, plane: Array, margin_mm: float) -> Surface | None:
    """The convex hull of a face's points with a margin, in its plane."""
    import cv2

    if len(place) < 3:
        return None
    normal = plane[:3]
    across = np.cross(normal, [1.0, 0.0, 0.0] if abs(normal[0]) < 0.7 else [0.0, 1.0, 0.0])
    axes = np.stack([across / np.linalg.norm(across), np.cross(normal, across / np.linalg.norm(across))])
    middle = place.mean(axis=0)
    flat = (place - middle) @ axes.T
    hull = cv2.convexHull(flat.astype(np.float32))[:, 0].astype(np.float64)
    if len(hull) < 3:
        return None
    hull *= 1 + margin_mm / np.maximum(np.linalg.norm(hull, axis=1, keepdims=True), 1e-9)
    fan = np.array([[0, k, k + 1] for k in range(1, len(hull) - 1)], dtype=np.int64)
    return Surface(hull @ axes + middle, fan, BODY)


AXIS_SHARE, LETTER_SHARE = 0.2, 0.03
"""Of the cameras' usual distance, for a target that is not known: length of its axes, height of their letters."""
MOST_VIEWS = 3000
"""More pyramids make a page slow: then every second, third, ... is drawn."""


def place_view(target: TargetGeometry | None, camera: Camera, cam_from_target: Array, names: tuple[str, ...]) -> View3d:
    """The scene and what it shows in words."""
    every = -(-len(names) // MOST_VIEWS)
    poses = cam_from_target[::every]
    size_mm = camera_size_mm(poses)
    drawn = _axes(poses) if target is None else target_layers(target, body_colour=BODY, ink_colour=INK)
    sight = view_of(camera)
    cameras = camera_layer(poses, sight, names[::every], (CAMERA,), size_mm)
    is_flat = target is not None and target.is_plate
    up, from_direction = first_look(poses, centers_mm(poses), is_flat=is_flat)
    caption = f"Each {body_words(sight)} is a photo; point at one for its name."
    said = caption if every == 1 else f"{caption} One of {every} is drawn."
    return View3d(
        "Camera positions", Scene((*drawn, cameras), up, from_direction, ((CAMERA, "camera"),)),
        place_words(target, cam_from_target), said,
    )  # fmt: skip


def place_words(target: TargetGeometry | None, cam_from_target: Array) -> str:
    """From where photos were taken, as a sentence."""
    centre = centers_mm(cam_from_target)
    photos = counted(len(centre), "photo")
    words = f"{photos} from {distance_words(cam_from_target)} away"
    if target is not None and target.is_plate:
        tilt = tilts_deg(target, cam_from_target)
        words += f", at {tilt.min():.0f} to {tilt.max():.0f}° from straight on"
    return f"{words}."


def distance_words(cam_from_target: Array) -> str:
    """How far cameras stand from the target's origin."""
    return f"{span(np.linalg.norm(cam_from_target[:, :3, 3], axis=1).tolist(), 3)} mm"


def tilts_deg(target: TargetGeometry, cam_from_target: Array) -> Array:
    """Between the normal of the side of a flat target that is seen and the line of sight to its origin.  # (V,)"""
    normal = cam_from_target[:, :3, :3] @ target.target_from_face[0, :3, 2]
    shift = cam_from_target[:, :3, 3]
    cosine = -np.einsum("vi,vi->v", normal, shift) / np.maximum(np.linalg.norm(shift, axis=1), 1e-9)
    tilt: Array = np.degrees(np.arccos(np.clip(cosine, -1.0, 1.0)))
    return tilt if target.is_planar else np.minimum(tilt, 180.0 - tilt)


def _axes(poses: Array) -> tuple[Layer, ...]:
    """The axes of the target's frame with their letters."""
    usual = float(np.median(np.linalg.norm(poses[:, :3, 3], axis=1)))
    length = max(AXIS_SHARE * usual, 1e-3)
    ends = np.zeros((3, 2, 3))
    ends[:, 1] = length * np.eye(3)
    letters = tuple(letter for letter, _ in AXES)
    labels = seen_from_both_sides(1.1 * length * np.eye(3), np.eye(3), letters, LETTER_SHARE * usual)
    return (Layer("axes of the target", (Segments(ends, tuple(colour for _, colour in AXES)), labels)),)
