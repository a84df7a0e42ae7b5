"""Whether the camera depends on the target being as its file says.

Two halves of the photos share their target, so they agree on what a bent one does to the camera. But if the faces may
bend, stretch and move a little (`calib.judge.target_shape`), a bent one shows: another shape explains the sightings
better, and with it goes another camera. The least-squares solution is extended by those unknowns
(`calib.solver.target_error.extended`); one linear step from the solution gives the change of the camera. The extended
camera is right with either target, the plain one is the more accurate if the target is as its file says, and then the
difference of the two has the covariance of the first less that of the second, which tells chance from fault (Hausman
1978, Specification tests in econometrics, Econometrica 46).
"""

from dataclasses import dataclass

import numpy as np

from calib.core.linear_algebra import worse_sigma
from calib.core.parallel import one_thread
from calib.core.types import KnownPoints
from calib.judge.coverage import Coverage
from calib.judge.difference import in_sigmas, moved_over
from calib.judge.views import in_plane
from calib.solver.accuracy import SHARE_PERCENT
from calib.solver.calibration import Calibration
from calib.solver.free_shape import camera_directions, shape_equations
from calib.solver.target_error import extended
from designer.base.arrays import Array, Rows


@dataclass(frozen=True)
class ShapeEffect:
    """What a target that may have another shape does to the camera, over the covered area."""

    percentile_95_px: float  # change of the camera's pixels, less their best turn
    ratio: float  # the same in its standard deviations, 1 on average if the target is as its file says
    sigma_px: float  # of the change, along its worse axis, 95 % of the area
    bow_mm: float  # of the most bent face, from its middle to its farthest ring
    explained: float = 1.0  # of the residuals' variance, 0 to 1: how much less another shape leaves over


@one_thread
def shape_effect(calibration: Calibration, coverage: Coverage) -> ShapeEffect | None:
    """The effect; None if it cannot be told: a learned map, points on no known face, or too few sightings."""
    seen = calibration.observations
    used = np.unique(seen.point[~calibration.is_outlier])
    basis = camera_directions(calibration)
    if calibration.camera.learned is not None or not basis.size or not len(used) or (seen.points.face[used] < 0).any():
        return None
    deformation = deformation_of(seen.points, used)
    none = np.zeros((len(seen.points.face), 3, 0))
    found = shape_equations(calibration, basis, deformation.modes_mm, none)
    freedom = found.equations - len(found.normal)
    if freedom <= 0:
        return None
    # A prior of one unit keeps at zero what the photos leave open: the target's pose and size, faces seen once.
    noise = found.square / (found.equations - basis.shape[1])
    free = extended(found, noise)
    variance = max(free.left, 0.0) / freedom
    field, covariance = moved_over(
        calibration.camera, basis @ free.mean[found.camera], variance * basis @ free.more @ basis.T, coverage
    )
    if not len(field):
        return None
    return ShapeEffect(
        float(np.percentile(np.linalg.norm(field, axis=1), SHARE_PERCENT)),
        in_sigmas(field, covariance),
        float(np.percentile(worse_sigma(covariance), SHARE_PERCENT)),
        deformation.bow_mm(free.mean[found.camera.stop :]),
        min(max(1 - variance / noise, 0.0), 1.0) if noise > 0 else 0.0,
    )


AMPLITUDE = 0.01
"""Shift of the farthest ring by one unit of an unknown, of the face's extent."""
BOWS = 3
"""The first unknowns of a face."""


@dataclass(frozen=True, eq=False)
class Deformation:
    """Shifts of K points by the B unknowns of their faces, and where these stand among all S unknowns."""

    shift_mm: Array  # (K, B, 3)
    first: Rows  # (K,) the first unknown of the point's face
    extent_mm: Array  # (F,) of each face that was seen: from its middle to its farthest ring

    @property
    def per_face(self) -> int:
        """Unknowns of a face."""
        return int(self.shift_mm.shape[1])

    @property
    def count(self) -> int:
        """All unknowns."""
        return self.per_face * len(self.extent_mm)

    @property
    def modes_mm(self) -> Array:
        """Displacement of every point by a unit of each unknown.  # (S, K, 3)"""
        modes = np.zeros((self.count, len(self.first), 3))
        column = self.first[:, None] + np.arange(self.per_face)
        modes[column, np.arange(len(self.first))[:, None]] = self.shift_mm
        return modes

    def bow_mm(self, unknowns: Array) -> float:
        """How far the most bent face bends out of its plane, from its middle to its farthest ring."""
        bow = unknowns.reshape(-1, self.per_face)[:, :BOWS]
        # The larger eigenvalue of the quadratic form is the bow along the direction that bends most.
        form = np.stack([bow[:, 0], bow[:, 1] / 2, bow[:, 1] / 2, bow[:, 2]], axis=1).reshape(-1, 2, 2)
        largest = np.abs(np.linalg.eigvalsh(form)).max(axis=1)
        return float((AMPLITUDE * self.extent_mm * largest).max())


def deformation_of(points: KnownPoints, used: Rows) -> Deformation:
    """The deformations of the faces of some points: bows `x^2, xy, y^2`, a stretch and a shear in the plane.

    Faces of a target with several also change in size, shift and turn against each other; for a single one that is
    its pose, and its size cannot be told from its distance.

    Args:
        points: K points.
        used: rows of those that were seen, each on a known face.
    """
    faces = np.unique(points.face[used])
    shifts, extents = [], []
    rows_of = [used[points.face[used] == face] for face in faces]
    for face, rows in zip(faces.tolist(), rows_of, strict=True):
        place = points.position_mm[rows]
        shift, extent = _of_face(place - place.mean(axis=0), points.plane[face, :3], is_single=len(faces) == 1)
        shifts.append(shift)
        extents.append(extent)
    size = shifts[0].shape[1]
    every, first = np.zeros((len(points.face), size, 3)), np.zeros(len(points.face), dtype=np.int64)
    for number, (rows, shift) in enumerate(zip(rows_of, shifts, strict=True)):
        every[rows], first[rows] = shift, number * size
    return Deformation(every, first, np.array(extents))


def _of_face(off_mm: Array, normal: Array, *, is_single: bool) -> tuple[Array, float]:
    """Shifts (N, B, 3) of points (N, 3) about their middle, and their extent."""
    frame = np.vstack([in_plane(normal), normal])
    extent = float(np.linalg.norm(off_mm, axis=1).max()) or 1.0
    x, y = frame[:2] @ (off_mm / extent).T
    one, none = np.ones_like(x), np.zeros_like(x)
    fields = [(none, none, x * x), (none, none, x * y), (none, none, y * y), (x, -y, none), (y, x, none)]
    if not is_single:
        fields += [(x, y, none), (-y, x, none), (one, none, none), (none, one, none)]
        fields += [(none, none, one), (none, none, x), (none, none, y)]
    local = np.stack([np.stack(field, axis=1) for field in fields], axis=1)
    return AMPLITUDE * extent * local @ frame, extent
