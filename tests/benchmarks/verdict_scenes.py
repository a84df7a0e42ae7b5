"""Random calibrations with known cameras and known faults, for judging verdicts: computed sightings, not rendered."""

from dataclasses import dataclass, replace
from functools import cache

import numpy as np

from calib.cameras import project, rays
from calib.cameras.camera import Camera, camera_or_preset
from calib.core.se3 import exp_rotation, look_at, transform
from calib.core.types import KnownPoints, Observations
from calib.observe.observations import known_points
from calib.renderer.poses import fibonacci_cap
from designer.base.arrays import Array, Rows
from designer.kinds.board import BoardSpec
from designer.kinds.ico import IcoSpec
from designer.kinds.layout import lay_out
from designer.target import TargetGeometry
from designer.tolerance.error_file import error_model
from designer.tolerance.model import perturb

LEAST_RINGS = 6
"""Of a view, fewer are not kept."""
TRIES = 6
"""Poses drawn for each photo until one shows the target."""
MARGIN_PX = 8
INCIDENCE_DEG = 70.0
PRINTS = {"board": ("fdm-board", "sheet-print"), "ico": ("fdm-dual", "fdm-dual-calibrated", "hand-stickers")}
SIZE, SPLINE_SIZE = (2448, 2048), (2448, 1836)


@dataclass(frozen=True)
class Habit:
    """How somebody takes photos."""

    reach: float  # how far from the middle the target is shown, of the field of view
    size: float  # the target's half width in the nearest photo, of the image's
    tilt_deg: float  # the largest
    depth: float  # the farthest photo is so much farther than the nearest, as a share
    is_one_axis: bool = False  # all tilts about one axis of the target, never rolled


HABITS = {
    "careful": Habit(0.9, 0.55, 45.0, 0.5),
    "casual": Habit(0.6, 0.45, 35.0, 0.4),
    "middle": Habit(0.15, 0.75, 40.0, 0.3),
    "frontal": Habit(0.8, 0.55, 12.0, 0.3),
    "small": Habit(0.9, 0.2, 45.0, 0.8),
    "one axis": Habit(0.9, 0.55, 45.0, 0.5, is_one_axis=True),
}
HABIT_SHARES = (0.45, 0.15, 0.1, 0.1, 0.05, 0.15)
FAULTS = ("none", "print", "bow", "stretch", "glare", "focus", "moving", "breathing", "drift", "tilt")
FAULT_SHARES = (0.3, 0.15, 0.05, 0.05, 0.1, 0.05, 0.1, 0.1, 0.05, 0.05)
ALIKE = ("moving", "breathing", "drift", "tilt")
"""Faults that all photos share, which halves of them cannot show: a target that moves while the shutter rolls, a focal
length that is linear in the distance or in time, centres that are off along the tilt."""
LENSES = ("mild", "strong", "luhmann", "spline")
LENS_SHARES = (0.45, 0.2, 0.2, 0.15)


@dataclass(frozen=True)
class Case:
    """One calibration that somebody makes."""

    seed: int
    target: str  # "board", "ico"
    fine: bool
    lens: str
    habit: str
    views: int
    noise_px: float
    fault: str
    amount: float
    """Of the fault: a factor of the error model, mm of bow, share of x, of sightings, of focal length; px that the
    target moves from the first row to the last, or that centres are off where the target is seen from its side."""
    print_model: str
    rejects: bool  # solved with --reject 4

    @property
    def is_exact(self) -> bool:
        """Whether the target is as its file says."""
        return self.fault not in ("print", "bow", "stretch")


def case_of(seed: int, faults: tuple[str, ...] = (), *, careful: bool = False) -> Case:
    """A draw; of some faults, all alike often, and of many photos taken with care."""
    rng = np.random.default_rng([7, seed])
    target = str(rng.choice(["board", "ico"]))
    fault = str(rng.choice(faults) if faults else rng.choice(FAULTS, p=FAULT_SHARES))
    amounts = {
        "none": 0.0,
        "print": _between(0.03, 1.0, rng),
        "bow": _between(0.01, 1.0, rng),
        "stretch": _between(1e-3, 1e-2, rng),
        "glare": _between(0.002, 0.08, rng),
        "focus": _between(1e-5, 2e-3, rng),
        "moving": _between(0.02, 3.0, rng),
        "breathing": _between(1e-5, 2e-3, rng),
        "drift": _between(1e-5, 2e-3, rng),
        "tilt": _between(0.02, 2.0, rng),
    }
    case = Case(
        seed, target, bool(rng.random() < 0.5), str(rng.choice(LENSES, p=LENS_SHARES)),
        str(rng.choice(list(HABITS), p=HABIT_SHARES)), _views(rng),
        float(np.exp(rng.triangular(*np.log([0.01, 0.04, 0.5])))), fault, amounts[fault],
        str(rng.choice(PRINTS[target])), bool(rng.random() < 0.3),
    )  # fmt: skip
    if not careful:
        return case
    return replace(case, habit="careful", views=round(_between(25, 60, rng)), noise_px=_between(0.01, 0.04, rng))


def _between(low: float, high: float, rng: np.random.Generator) -> float:
    """A number of any size between two."""
    return float(np.exp(rng.uniform(np.log(low), np.log(high))))


def _views(rng: np.random.Generator) -> int:
    """So few that nothing can be checked, or more."""
    return int(rng.integers(1, 4)) if rng.random() < 0.1 else round(_between(4, 40, rng))


@cache
def _target(target: str, *, fine: bool) -> TargetGeometry:
    if target == "board":
        columns, rows, pitch = (20, 16, 11.0) if fine else (11, 9, 20.0)
        size = ((columns + 1) * pitch, (rows + 1) * pitch)
        return lay_out(BoardSpec(size, 3.0, columns, rows, "square", 0.7 * pitch, 0.45, pitch, 0.0, 1.0, dots=False))
    side = 7 if fine else 5
    pitch = 80.0 / side
    return lay_out(IcoSpec(100.0, side, 0.7 * pitch, 0.45, pitch, 2.0, 1.0))


def lens_of(case: Case, rng: np.random.Generator) -> Camera:
    """The true camera, a little different in each run."""
    if case.lens == "spline":
        return _part_of_spline(_between(0.01, 1.0, rng))
    off = rng.normal(0, 20, 2)
    focal = 1500.0 if case.lens == "strong" else 2500 * float(rng.uniform(0.7, 1.4))
    head = [focal, focal * (1 + 2e-3 * float(rng.normal())), 1223.5 + off[0], 1023.5 + off[1]]
    bend = float(rng.uniform(0, 1.5))
    tangential = 4e-4 * rng.normal(size=2)
    if case.lens == "strong":
        return Camera("opencv", np.array([*head, -0.30, 0.10, *tangential, -0.012]), SIZE)
    if case.lens == "luhmann":
        return Camera("luhmann", np.array([*head, -0.12 * bend, 0.05 * bend, 0.01, *tangential]), SIZE)
    return Camera("opencv", np.array([*head, -0.12 * bend, 0.05 * bend, *tangential, 0.01 * bend]), SIZE)


def _part_of_spline(share: float) -> Camera:
    """The lens of the template with a part of its surface, on a smaller sensor."""
    full = camera_or_preset("phase-one-spline")
    params = full.params * (SPLINE_SIZE[0] / full.image_size[0])
    params[4:] *= share
    return Camera("spline", params, SPLINE_SIZE)


def poses_of(case: Case, camera: Camera, radius_mm: float, count: int, rng: np.random.Generator) -> Array:
    """How the photos are taken.  # (V, 4, 4)"""
    habit = HABITS[case.habit]
    width, height = camera.image_size
    focal = camera.params[0]
    # So far that the target's radius takes a share of the image's half width.
    far = focal * radius_mm / (habit.size * width / 2)
    cap = fibonacci_cap(max(count, 2), np.radians(habit.tilt_deg))[rng.permutation(max(count, 2))[:count]]
    roll = rng.uniform(-np.pi, np.pi, count)
    if habit.is_one_axis:
        # Over the target, tilted about its x axis alone, x level in the image.
        tilt = np.radians(habit.tilt_deg) * rng.uniform(-1, 1, count)
        cap, roll = np.stack([np.zeros(count), np.sin(tilt), np.cos(tilt)], axis=1), np.zeros(count)
    elif case.target == "ico":
        # Any side of it may be shown.
        cap = rng.normal(size=(count, 3))
        cap /= np.linalg.norm(cap, axis=1, keepdims=True)
    eye = far * rng.uniform(1.0, 1.0 + habit.depth, (count, 1)) * cap
    pose = look_at(eye, np.zeros((count, 3)), roll)
    turn = np.tile(np.eye(4), (count, 1, 1))
    reach = habit.reach * np.arctan([0.5 * height / focal, 0.5 * width / focal])
    for one, (down, right) in zip(turn, rng.uniform(-1, 1, (count, 2)) * reach, strict=True):
        one[:3, :3] = exp_rotation(np.array([down, right, 0.0]))
    seen: Array = turn @ pose
    return seen


def _see(camera: Camera, points: KnownPoints, pose: Array) -> tuple[Rows, Array]:
    """Rows of the points that are seen in one photo, and where."""
    place = transform(pose, points.position_mm)
    normal = points.plane[points.face, :3]
    cosine = -(place * (normal @ pose[:3, :3].T)).sum(axis=1) / np.linalg.norm(place, axis=1)
    pixel = project(camera, place)
    with np.errstate(invalid="ignore"):
        lower, upper = pixel.min(axis=1), (np.array(camera.image_size) - pixel).min(axis=1)
        inside = np.minimum(lower, upper) > MARGIN_PX
        # Beyond where a polynomial turns back there are no images.
        again = rays(camera, np.where(inside[:, None], pixel, 0.0))
        inside &= np.linalg.norm(np.cross(again, place), axis=1) < 1e-6 * np.linalg.norm(place, axis=1)
    rows = np.flatnonzero(inside & (cosine > np.cos(np.radians(INCIDENCE_DEG))))
    return rows, pixel[rows]


def target_of(case: Case) -> TargetGeometry:
    """As its file has it."""
    return _target(case.target, fine=case.fine)


def sightings_of(case: Case, camera: Camera, rng: np.random.Generator) -> Observations | None:
    """What is detected, believed to be of the nominal target; None if it is seen in no photo."""
    nominal = target_of(case)
    points, made = known_points(nominal), known_points(_made(case, nominal, rng))
    if case.fault == "stretch":
        made = replace(made, position_mm=made.position_mm * [1 + case.amount, 1, 1])
    if case.fault == "bow":
        made = _bowed(made, case.amount, case.target)
    radius = float(np.abs(points.position_mm[:, :2]).max())
    rows: list[Rows] = []
    pixels: list[Array] = []
    poses: list[Array] = []
    for pose in poses_of(case, camera, radius, TRIES * case.views, rng):
        lens = _zoomed(camera, case.amount * float(rng.normal())) if case.fault == "focus" else camera
        row, pixel = _see(lens, made, pose)
        if len(row) >= LEAST_RINGS and len(rows) < case.views:
            rows.append(row)
            pixels.append(pixel)
            poses.append(pose)
    if not rows:
        return None
    view = np.repeat(np.arange(len(rows)), [len(row) for row in rows])
    pixel = np.concatenate(pixels)
    if case.fault in ALIKE:
        pixel = _alike(case, camera, made, (view, np.concatenate(rows), np.stack(poses)), pixel, rng)
    pixel = pixel + case.noise_px * rng.standard_normal(pixel.shape)
    if case.fault == "glare":
        off = rng.random(len(pixel)) < case.amount
        length = np.exp(rng.uniform(np.log(0.5), np.log(10.0), off.sum()))
        angle = rng.uniform(-np.pi, np.pi, off.sum())
        pixel[off] += length[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    covariance = np.tile(case.noise_px**2 * np.eye(2), (len(pixel), 1, 1))
    names = tuple(f"photo{n:03}.png" for n in range(len(rows)))
    return Observations(camera.image_size, names, view, np.concatenate(rows), pixel, covariance, points)


def _zoomed(camera: Camera, share: float) -> Camera:
    """A camera of a focal length that is more by a share."""
    params = camera.params.copy()
    params[:2] *= 1 + share
    return replace(camera, params=params)


def _alike(
    case: Case, camera: Camera, points: KnownPoints, seen: tuple[Rows, Rows, Array],
    pixel: Array, rng: np.random.Generator,
) -> Array:  # fmt: skip
    """Where points are measured with a fault that all photos share, of views, rows and poses, without: `pixel`."""
    view, row, poses = seen
    rotation = poses[view, :3, :3]
    place = np.einsum("mij,mj->mi", rotation, points.position_mm[row]) + poses[view, :3, 3]
    sign = float(rng.choice([-1.0, 1.0]))
    depth = np.bincount(view, place[:, 2]) / np.bincount(view)
    if case.fault == "moving":
        along = rng.normal(size=3)
        moved = case.amount * depth.mean() / camera.params[0] * along / np.linalg.norm(along)
        by_point = rotation @ moved if rng.random() < 0.5 else moved  # with the target, or before the camera
        for _ in range(3):  # a point is taken when the row that shows it is
            pixel = project(camera, place + ((pixel[:, 1:] + 0.5) / camera.image_size[1] - 0.5) * by_point)
        return pixel
    if case.fault == "tilt":
        normal = np.einsum("mij,mj->mi", rotation, points.plane[points.face[row], :3])
        ray = place / np.linalg.norm(place, axis=1, keepdims=True)
        along = ray - (ray * normal).sum(axis=1, keepdims=True) * normal
        ahead = project(camera, place + 1e-3 * along) - pixel
        sine = np.linalg.norm(along, axis=1, keepdims=True)
        return pixel + sign * case.amount * sine * ahead / np.maximum(
            np.linalg.norm(ahead, axis=1, keepdims=True), 1e-300
        )
    course = depth - depth.mean() if case.fault == "breathing" else np.arange(len(depth)) - (len(depth) - 1) / 2
    share = sign * case.amount * course / max(float(np.abs(course).max()), 1e-300)
    lens = [_zoomed(camera, one) for one in share.tolist()]
    return np.concatenate([project(one, place[view == number]) for number, one in enumerate(lens)])


def _made(case: Case, nominal: TargetGeometry, rng: np.random.Generator) -> TargetGeometry:
    """The target as it came out."""
    if case.fault != "print":
        return nominal
    return perturb(nominal, error_model(case.print_model).scaled(case.amount), rng)


def _bowed(points: KnownPoints, bow_mm: float, target: str) -> KnownPoints:
    """A board whose ends stand out of its plane; of an icosahedron, one corner that is off."""
    place = points.position_mm.copy()
    if target == "board":
        place[:, 2] += bow_mm * (place[:, 0] / np.abs(place[:, 0]).max()) ** 2
    else:
        height = place[:, 2] / np.abs(place[:, 2]).max()
        place[:, 0] += bow_mm * height
    return replace(points, position_mm=place)
