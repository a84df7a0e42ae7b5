"""A plan of photos, tried: photos are simulated as somebody takes them after it, and the camera is solved from them.

That says what a plan is worth where nobody holds a target quite as it says, and what the target's making adds.
"""

import math
from dataclasses import dataclass, replace
from typing import Annotated

import numpy as np
from numpy.typing import NDArray

from calib.cameras.camera import Camera
from calib.core.se3 import exp_rotation, make_pose, transform
from calib.core.types import KnownPoints, Observations, keep_views
from calib.solver.calibration import Calibration
from calib.solver.options import SolveOptions
from calib.solver.solve import solve
from calib.solver.target_error import with_target_error
from calib.verdict.candidate_views import shown_in
from calib.verdict.lit_part import lit_part, sigma_over_lit_px
from calib.verdict.next_views import MAX_PX
from calib.verdict.views import Habits, TargetShape
from designer.base.errors import InputError
from designer.base.marks import AtLeast, AtMost, NullIs
from designer.tolerance.made import Made

Array = NDArray[np.float64]

TURNED_RAD, SHIFTED_MM, OF_DISTANCE = math.radians(5), 20.0, 0.05
"""Standard deviations of how a person holds a target who was told where, whichever shift is less; twice at most."""
STILL_READ = 0.25
"""Of a face: rings are named by their neighbours, so that a part of it is read which nobody would plan for."""


_Sigma = Annotated[float, AtLeast(0), AtMost(MAX_PX), NullIs(math.inf)]


@dataclass(frozen=True)
class TriedPlan:
    """What a camera states that was solved from photos taken after a plan: what 95 % of the image stays within."""

    stated_px: _Sigma  # 1 sigma, with what the target's making may have done; infinite: not determined
    by_noise_px: _Sigma  # by the noise alone

    @property
    def by_target_px(self) -> float:
        """What the target's making adds, by the sum of squares."""
        return math.sqrt(max(self.stated_px**2 - self.by_noise_px**2, 0.0)) if math.isfinite(self.stated_px) else 0.0


def tried_plan(
    camera: Camera, points: KnownPoints, shape: TargetShape, held: Habits, cam_from_target: Array, noise_px: float,
    made: Made | None, rng: np.random.Generator, *, is_held_exactly: bool,
) -> TriedPlan:  # fmt: skip
    """Take the photos of a plan (V, 4, 4) once, and solve.

    Args:
        camera: that takes them; its model is solved.
        points: of the target.
        shape: of the same.
        held: which points are read.
        cam_from_target: where the plan has the target.
        noise_px: of a coordinate of an observation.
        made: how the target was; None: nobody knows.
        rng: of noise and of how the target is held.
        is_held_exactly: a robot or a turntable holds it.
    """
    poses = cam_from_target if is_held_exactly else _held(cam_from_target, shape, rng)
    seen = _photographed(camera, points, shape, held, poses, noise_px, rng)
    if not seen.view_count:
        return TriedPlan(math.inf, math.inf)
    try:
        found = solve(seen, camera.model, SolveOptions())
    except InputError:
        return TriedPlan(math.inf, math.inf)
    if found.status != "converged":
        return TriedPlan(math.inf, math.inf)
    return TriedPlan(_within_px(with_target_error(found, made)), _within_px(found))


def _within_px(found: Calibration) -> float:
    return sigma_over_lit_px(lit_part(found), found.stated_covariance)


def _held(cam_from_target: Array, shape: TargetShape, rng: np.random.Generator) -> Array:
    """The poses as a person holds them."""
    turn = TURNED_RAD * rng.standard_normal((len(cam_from_target), 3)).clip(-2, 2)
    middle = transform(cam_from_target, shape.center_mm)
    most_mm = np.minimum(SHIFTED_MM, OF_DISTANCE * np.linalg.norm(middle, axis=1))
    there = middle + most_mm[:, None] * rng.standard_normal(middle.shape).clip(-2, 2)
    rotation = exp_rotation(turn) @ cam_from_target[:, :3, :3]
    return make_pose(rotation, there - rotation @ shape.center_mm)


def _photographed(
    camera: Camera, points: KnownPoints, shape: TargetShape, held: Habits, poses: Array, noise_px: float,
    rng: np.random.Generator,
) -> Observations:  # fmt: skip
    """What is found in the photos."""
    still = replace(held, face_share=min(held.face_share, STILL_READ))
    shown = shown_in(camera, shape, still, poses, np.arange(len(shape.face)))
    is_read = shown.is_read & (shown.is_read.sum(axis=1, keepdims=True) >= held.rings)
    view, row = np.nonzero(is_read)
    point = np.flatnonzero(points.face >= 0)[row]
    pixel = shown.pixel[view, row] + noise_px * rng.standard_normal((len(view), 2))
    names = tuple(map(str, range(1, len(poses) + 1)))
    seen = Observations(camera.image_size, names, view, point, pixel, None, points)
    return keep_views(seen, is_read.any(axis=1))
