"""What cameras will be known to by photos of a target that nobody has made yet: no photo is solved, nothing is drawn.

    found = forecast(stage_of(Wish(...)), [(target, error_model("fdm-dual")), (target, error_model("resin"))])
    found.optics(photos=30).image_px, found.made(30, 1).image_px

Frames are simulated where the cameras see the volume. The information A of their rings, with the noise that the
detector states, is that of the solver at its minimum: its inverse is the covariance that a solution will state. A frame
v moves the solution by `A^-1 c_v s` if the shape differs from the drawing by the numbers s, standard normal, of the way
of making. Frames are as a person happens to hold the target, so that over n of them the mean square of the error is

    x x' + A^-1 n S A^-1,    A = n E A_v,  x = A^-1 n E c_v,  S = Cov(c_v - A_v x)

with what more photos leave, x, and what they average out. Of a flat target the bend is among the unknowns, as the
solver has it.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from calib.cameras import ABILITIES, COMMON, WIDE, project, rays
from calib.cameras.camera import Camera
from calib.cameras.refit import plain_camera
from calib.cameras.rig import POSE, Rig
from calib.core.linear_algebra import symmetric_inverse
from calib.core.parallel import one_thread
from calib.core.se3 import invert, look_at
from calib.core.types import LEAST_RADIUS_PX
from calib.renderer.held_target import held_poses
from calib.renderer.rig_template import HeldTarget
from calib.rigs.result import RigCalibration
from calib.rigs.target_error import posed_frames
from calib.solver.accuracy import sigma_over_image_px
from calib.solver.calibration import plane_bend
from calib.solver.free_bend import made_bend_mm
from calib.solver.free_shape import free_directions
from calib.solver.target_error import unbent
from calib.studies.tolerance.rig_costs import SimulatedFrames, cost_of
from designer.base.arrays import Array, Rows
from designer.base.errors import InputError
from designer.base.marks import Gap
from designer.target import TargetGeometry, bounding_radius_mm
from designer.tolerance.made import Made
from designer.tolerance.model import ErrorModel
from designer.tolerance.prior import shape_prior

APART_RAD = math.radians(30)
"""Neighbouring cameras, on an arc around the volume; many of them are a ring."""
PINHOLE_TO_RAD = math.radians(120)
"""Wider lenses follow no pinhole's model."""
MOST_RINGS = 200
"""Of a face: of more so many at random stand for all."""
FRAMES, FEWEST_FRAMES = 50, 16
"""That are simulated, of one camera and at least; of a flat target twice as many: how it is turned counts more."""
CLEAR = 1.3
"""Of the target's radius: nobody holds it nearer to a camera."""
UNSURE = {"focal": 0.3, "centre": 0.05, "turn": 0.1, "shift_mm": 100.0}
"""Scales of the unknowns; they decide nothing."""


@dataclass(frozen=True)
class Wish:
    """Cameras, and what they are for."""

    cameras: int
    field_rad: float  # from the left to the right border of the image
    volume_mm: tuple[float, float, float]  # width, height and depth, as the first camera sees it
    image_size: tuple[int, int]
    model: str | None  # None: by the field
    seed: int


@dataclass(frozen=True, eq=False)
class Stage:
    """The cameras before their volume."""

    rig: Rig
    distance_mm: tuple[float, float]  # from a camera to the volume's front and back
    frames: int
    seed: int

    @property
    def camera(self) -> Camera:
        """All are alike."""
        return self.rig.cameras[0]

    @property
    def least_ring_mm(self) -> float:
        """The diameter of a ring that is still large enough in the image at the volume's far end."""
        return 2 * LEAST_RADIUS_PX * self.distance_mm[1] / float(self.camera.params[0])

    def radius_px(self, radius_mm: float) -> float:
        """The radius of a ring there that faces the camera."""
        return float(self.camera.params[0]) * radius_mm / self.distance_mm[1]


def stage_of(wish: Wish) -> Stage:
    """Cameras that see all of the front of the volume, no farther away than that takes.

    Raises:
        InputError: a field that the model does not see.
    """
    model = wish.model or (COMMON if wish.field_rad <= PINHOLE_TO_RAD else WIDE)
    half, (width, height) = wish.field_rad / 2, wish.image_size
    edge = np.array([[math.sin(half), 0.0, math.cos(half)]])
    per_focal = float(project(plain_camera(model, (1, 1), 1.0), edge)[0, 0])
    if not (math.isfinite(per_focal) and per_focal > 0 and (ABILITIES[model].is_wide or half < math.pi / 2)):
        raise InputError(f"--field {math.degrees(wish.field_rad):g}deg: is more than the model {model} sees; "
                         f"use --model {WIDE}, or leave the model out")  # fmt: skip
    camera = plain_camera(model, wish.image_size, 0.5 * width / per_focal)
    border = rays(camera, np.array([[width - 0.5, 0.5 * (height - 1)], [0.5 * (width - 1), height - 0.5]]))
    off_axis = np.arctan2(np.hypot(border[:, 0], border[:, 1]), border[:, 2]).clip(max=math.radians(89))
    near = float((0.5 * np.array(wish.volume_mm[:2]) / np.tan(off_axis)).max())
    away, step = near + wish.volume_mm[2] / 2, min(APART_RAD, math.tau / wish.cameras)
    angle = step * np.arange(wish.cameras)
    eye = away * np.stack([np.cos(angle), np.sin(angle), np.zeros_like(angle)], axis=1)
    cam_from_room = look_at(eye, np.zeros(3))
    names = tuple(f"camera{number}" for number in range(1, wish.cameras + 1))
    rig = Rig(names, (camera,) * wish.cameras, cam_from_room @ invert(cam_from_room[0]))
    frames = max(FRAMES // wish.cameras, FEWEST_FRAMES)
    return Stage(rig, (near, near + wish.volume_mm[2]), frames, wish.seed)


@dataclass(frozen=True)
class Foretold:
    """Standard deviations to be expected; of several cameras of the worst, of pairs of cameras root mean squares."""

    image_px: Gap  # what 95 % of the image stays within
    focal_px: Gap
    centre_px: Gap  # of the principal point, a coordinate
    baseline_mm: Gap  # of the distance of two cameras; nan of one camera
    turn_rad: Gap  # of one against another
    point_mm: Gap  # of a point in the middle of the volume, by the rig alone


@dataclass(frozen=True, eq=False)
class MadeWay:
    """What a way of making does, frame by frame."""

    moved: Array  # (V, S, U) c_v by each number of the shape
    bend_sigma_mm: tuple[float, ...]  # of the heights that are unknowns; (): none are


@dataclass(frozen=True, eq=False)
class Forecast:
    """Of a target, by V frames and U unknowns, of which the first Q are the cameras'."""

    found: RigCalibration  # at the truth
    basis: Array  # (N, Q)
    normal: Array  # (V, U, U)
    ways: tuple[MadeWay, ...]

    @property
    def rings(self) -> float:
        """In a photo, the median."""
        seen, each = self.found.observations.sightings, float(self.found.scale[0]) ** -2
        return each * float(np.median(np.concatenate([np.bincount(one.view) for one in seen])))

    def optics(self, photos: int) -> Foretold:
        """Of the target as drawn, by so many photos of each camera."""
        count = self.basis.shape[1]
        told = photos * self.normal[:, :count, :count].mean(axis=0)
        return _known(self.found, self.basis @ symmetric_inverse(told).inverse @ self.basis.T)

    def made(self, photos: int, row: int) -> Foretold:
        """The same of the target as a way of making lets it come out."""
        way, count, frames = self.ways[row], self.basis.shape[1], len(self.normal)
        free = slice(count + len(way.bend_sigma_mm))
        believed = np.concatenate([np.zeros(count), np.array(way.bend_sigma_mm) ** -2.0])
        told = photos * self.normal[:, free, free].mean(axis=0) + np.diag(believed)
        inverse = symmetric_inverse(told).inverse
        step = photos * way.moved[:, :, free].mean(axis=0) @ inverse  # (S, U) of all unknowns
        # What a frame pulls besides: of two that pull alike, one that tells more does not pull more.
        besides = way.moved[:, :, free] - step @ self.normal[:, free, free]
        besides = besides.reshape(-1, inverse.shape[1]) @ inverse[:, :count]
        by_chance = photos / (frames - 1) * besides.T @ besides
        value, axis = np.linalg.eigh(step[:, :count].T @ step[:, :count] - photos / frames * by_chance)
        lasting = (axis * value.clip(min=0.0)) @ axis.T
        return _known(self.found, self.basis @ (inverse[:count, :count] + lasting + by_chance) @ self.basis.T)


@one_thread
def forecast(stage: Stage, ways: Sequence[tuple[TargetGeometry, ErrorModel]]) -> Forecast | None:
    """What photos of a target would tell; None: it is not read there, or they leave something open.

    Args:
        stage: the cameras.
        ways: in which it may be made; all of one drawing, which is cut otherwise.
    """
    rng = np.random.default_rng(stage.seed)
    count, faces = ways[0][0].ring_count, ways[0][0].face_count
    most = count if ways[0][0].marks else MOST_RINGS * faces  # a board of others' marks is all of it
    rows = np.sort(rng.permutation(count)[:most])
    each = count / len(rows)
    ways = [(with_rings(target, rows), errors) for target, errors in ways]
    target = ways[0][0]
    found = at_truth(frames, stage, each) if (frames := simulated(stage, target)) is not None else None
    if found is None:
        return None
    points, basis = found.observations.points, free_directions(found.covariance)
    bend = plane_bend(points) if target.is_planar else None
    heights_mm = np.zeros((0, *points.position_mm.shape)) if bend is None else bend.modes_mm(points.position_mm)
    priors = [shape_prior(*one) for one in ways]
    sigmas = [
        made_bend_mm(Made(errors.name, "", prior, errors), points) if bend else None
        for (_, errors), prior in zip(ways, priors, strict=True)
    ]
    shapes = [unbent(one, bend if s else None, points) for one, s in zip(priors, sigmas, strict=True)]
    own_mm = [each**-0.5 * one.ring_modes_mm.transpose(0, 2, 1) for one in shapes]
    normal, moved = [], [list[Array]() for _ in ways]
    for view in posed_frames(found, basis, np.arange(len(found.rig_from_target))):
        by_height = view.by_place @ heights_mm[:, view.point].transpose(1, 2, 0)
        flat = np.concatenate([view.by_camera, by_height], axis=2).reshape(2 * len(view.point), -1)
        across = view.poses_taken().reshape(len(flat), -1)
        left = flat - across @ (across.T @ flat)
        normal.append(left.T @ left)
        by_place = np.zeros((*points.position_mm.shape, flat.shape[1]))
        np.add.at(by_place, view.point, view.by_place.transpose(0, 2, 1) @ left.reshape(len(view.point), 2, -1))
        for one, shape, own in zip(moved, shapes, own_mm, strict=True):
            alone = (own @ by_place).reshape(-1, flat.shape[1])
            one.append(np.concatenate([np.tensordot(shape.modes_mm, by_place, 2), alone]))
    told = np.stack(normal)
    if int(symmetric_inverse(told.sum(axis=0)[: basis.shape[1], : basis.shape[1]]).rank) < basis.shape[1]:
        return None
    each_way = zip(moved, sigmas, strict=True)
    return Forecast(found, basis, told, tuple(MadeWay(np.stack(one), sigma or ()) for one, sigma in each_way))


def with_rings(target: TargetGeometry, rows: Rows) -> TargetGeometry:
    """A target with some of its rings."""
    parts = {name: getattr(target, name)[rows] for name in ("ring_face", "ring_index", "center_mm", "is_dot")}
    radii = {name: getattr(target, name)[rows] for name in ("radius_outer_mm", "radius_inner_mm")}
    return replace(target, **parts, **radii, ring_piece=None if target.ring_piece is None else target.ring_piece[rows])


def simulated(stage: Stage, target: TargetGeometry) -> SimulatedFrames | None:
    """Frames of a target in the volume; None: it is too large for it."""
    near, far = stage.distance_mm
    near = max(near, CLEAR * bounding_radius_mm(target))
    if near > far:
        return None
    rng, frames = np.random.default_rng(stage.seed), stage.frames * (1 + target.is_plate)
    return SimulatedFrames(stage.rig, target, held_poses(stage.rig, target, HeldTarget((near, far)), frames, rng))


def at_truth(frames: SimulatedFrames, stage: Stage, times: float = 1.0) -> RigCalibration | None:
    """The rig as it will be solved, with the scale of its unknowns; None: a camera never sees the target.

    Each ring stands for so many.
    """
    rig = frames.rig
    try:
        seen = frames.seen(frames.target, np.random.default_rng(stage.seed))
    except InputError:  # a camera never sees it
        return None
    kept = [int(name.removeprefix("frame")) for name in seen.frame_names]
    guess = np.concatenate([_scales(camera, is_first=row == 0) for row, camera in enumerate(rig.cameras)])
    empty = tuple(np.zeros((0, 6, 6)) for _ in rig.names)
    return RigCalibration(
        observations=seen, cameras=rig.cameras, cam_from_rig=rig.cam_from_rig,
        rig_from_target=frames.rig_from_target[kept],
        residual_px=tuple(np.zeros_like(one.center_px) for one in seen.sightings),
        is_outlier=tuple(np.zeros(len(one.point), dtype=np.bool_) for one in seen.sightings),
        scale=np.full(len(rig.names), times**-0.5), covariance=np.diag(guess**2),
        frame_covariance=np.zeros((len(kept), 6, 6)),
        pose_covariance=empty, reference=0, rig_frame=rig.names[0], fixed=((),) * len(rig.names), weighted=True,
        status="converged", remarks=(), iterations=0, seconds=0.0, priors=((),) * len(rig.names),
    )  # fmt: skip


def _scales(camera: Camera, *, is_first: bool) -> Array:
    """Of a camera's parameters and pose; 0 of that of the camera whose frame the rig's is."""
    lens = np.ones(len(camera.params))
    lens[:2] = UNSURE["focal"] * camera.params[:2]
    lens[2:4] = UNSURE["centre"] * max(camera.image_size)
    pose = np.repeat([UNSURE["turn"], UNSURE["shift_mm"]], POSE // 2)
    return np.concatenate([lens, np.zeros(POSE) if is_first else pose])


def _known(found: RigCalibration, covariance: Array) -> Foretold:
    """What a joint covariance says."""
    found = replace(found, covariance=covariance)
    rows = [found.rig.params_rows(row) for row in range(len(found.cameras))]
    lenses = [covariance[own, own] for own in rows]
    sigma = np.sqrt(np.array([np.diagonal(one)[:4] for one in lenses]).clip(min=0.0))
    image = max(sigma_over_image_px(camera, one) for camera, one in zip(found.cameras, lenses, strict=True))
    pairs = (math.nan,) * 3
    if len(found.cameras) > 1:
        cost = cost_of(found, "")
        pairs = cost.baseline_mm, cost.turn_rad, cost.point_mm
    return Foretold(image, float(sigma[:, :2].max()), float(sigma[:, 2:].max()), *pairs)
