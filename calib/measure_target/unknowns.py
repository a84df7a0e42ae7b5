"""The unknowns of a printed target, and where they put its rings.

A ring that was designed at c, in its face's frame, is at

    x = (I + e) T [exp(w) (c + o + z sum_k b_k q_k(c)) + t]

in the target's frame: its own offset o and the face's bow b move it in the face, the rigid motion (w, t) moves the
face in its own frame, T = target_from_face brings it to the target's frame, and the symmetric strain e of the print
acts about the target's origin. Of a target put together from pieces e is a size: no printer's axes strain all alike.

What a person may choose about measuring a print.
"""

from dataclasses import dataclass, field

import numpy as np

from calib.core.linear_algebra import least_squares
from calib.core.se3 import exp_rotation, skew
from calib.solver.problem import SolveOptions
from designer.base.arrays import Array, Flags, Rows
from designer.target import TargetGeometry, bounding_radius_mm
from designer.tolerance.made import Made, how_made


@dataclass(frozen=True)
class AsBuiltOptions:
    """Which deviations from the nominal target are allowed, and how large they are expected to be.

    The expectations are standard deviations of normal priors with mean zero. None: what the way of making gives, and
    more where the photos show more; of a target that is no design, so wide that only what the photos do not tell is
    held.
    """

    made: Made | None = None  # the way of making; None: the usual one of how the target was built
    ring_sigma_mm: tuple[float, float] | None = (0.05, 0.02)  # of a ring's centre in its plane, normal to it; None: 0
    ring_sigma_from_photos: bool = True  # start from these, then take what the rings' offsets turn out to be
    face_sigma_rad: float | None = None
    face_sigma_mm: float | None = None
    bow: bool | None = None  # each face may be bent; None: only if there is one face
    bow_sigma_mm: float | None = None  # at the face's rim
    affine: bool = True  # the whole print may be scaled and skewed
    strain_sigma: float | None = None
    solve: SolveOptions = field(default_factory=SolveOptions)  # weights, fixed and shared parameters of the cameras


STRAIN_INDEX = ((0, 0), (1, 1), (2, 2), (1, 2), (0, 2), (0, 1))
"""Of a strain's six numbers: xx, yy, zz, yz, xz, xy."""
KINDS = ("stretch", "shear", "tilt", "turn", "shift", "lift", "bow")
"""Of the unknowns that rings share; the last three are mm."""
SHARED = 15
"""Unknowns that a ring shares with others: six of the strain, six of its face's motion, three of its face's bow."""
UPRIGHT = 1 - 1e-9
"""Cosine of a face's tilt that is none."""
LEAST_RING_SIGMA_MM = 1e-7
"""A sigma of zero is this."""


@dataclass(frozen=True, eq=False)
class TargetUnknowns:
    """Values of the unknowns of R rings on F faces; all zero: as designed."""

    strain: Array  # (6,) xx, yy, zz, yz, xz, xy in the target's axes
    motion: Array  # (F, 6) rotation vector (rad), shift (mm), in the face's frame
    bow: Array  # (F, 3) mm: dome and two saddles, see `bow_basis`
    offset_mm: Array  # (R, 3) in the face's frame


@dataclass(frozen=True, eq=False)
class Unknowns:
    """Which unknowns are free, where they stand in the vector of shared unknowns, and their priors.

    The vector has the strain first, then the faces' motions, then the bows.
    """

    target: TargetGeometry
    basis: Array  # (R, 3) the bow's functions at each ring
    strain: Rows  # (first_motion,) which of the strain's six numbers are free
    first_motion: int
    first_bow: int
    count: int  # of shared unknowns
    column: Rows  # (F, 15) of each face's unknowns; -1: not free
    kind: Rows  # (count,) of `KINDS`
    is_given: Flags  # (count,) the standard deviation was chosen by a person
    sigma: Array  # (count,)
    ring_sigma_mm: Array | None  # (3,) None: rings stay where they are on their face
    is_assembled: bool = False  # from pieces: of what strains a print as a whole, only the size

    @property
    def is_length(self) -> Flags:
        """Which unknowns are mm; the others are rad, or parts.  # (count,)"""
        length: Flags = self.kind >= KINDS.index("shift")
        return length

    @property
    def has_strain(self) -> bool:
        """Whether the print may be strained."""
        return self.first_motion > 0

    @property
    def has_motion(self) -> bool:
        """Whether faces may move; a single one need not: poses take its motion up."""
        return self.first_bow > self.first_motion

    @property
    def has_bow(self) -> bool:
        """Whether faces may be bent."""
        return self.count > self.first_bow


def unknowns_of(target: TargetGeometry, options: AsBuiltOptions) -> Unknowns:
    """The free unknowns of a target."""
    faces, size = target.face_count, bounding_radius_mm(target)
    bent = target.is_plate if options.bow is None else options.bow
    moves = not target.is_plate  # no photo shows front and back of a plate, so that poses take their motions up
    strain = _free_strain(target) if options.affine else np.zeros(0, dtype=np.int64)
    first_motion = len(strain)
    first_bow = first_motion + (6 * faces if moves else 0)
    count = first_bow + (3 * faces if bent else 0)
    column = np.full((faces, SHARED), -1)
    column[:, strain] = np.arange(first_motion)
    if moves:
        column[:, 6:12] = first_motion + np.arange(6 * faces).reshape(faces, 6)
    if bent:
        column[:, 12:] = first_bow + np.arange(3 * faces).reshape(faces, 3)
    kind = np.concatenate(
        [np.where(strain < 3, 0, 1), np.tile([2, 2, 3, 4, 4, 5], faces if moves else 0), np.full(3 * faces, 6)]
    )[:count]
    strained, turned, shifted, bowed = (
        options.strain_sigma, options.face_sigma_rad, options.face_sigma_mm, options.bow_sigma_mm
    )  # fmt: skip
    given = np.array([strained, strained, turned, turned, shifted, shifted, bowed], dtype=np.float64)[kind]
    wide = np.array([0.05, 0.05, 0.1, 0.1, 0.1 * size, 0.1 * size, 0.02 * size])[kind]
    is_given = ~np.isnan(given)
    sigma = np.where(is_given, given, wide)
    ring_sigma = None
    if options.ring_sigma_mm is not None and max(options.ring_sigma_mm) > 0:
        plane, normal = options.ring_sigma_mm
        ring_sigma = np.maximum([plane, plane, normal], LEAST_RING_SIGMA_MM)
    made = options.made or how_made(target)
    is_assembled = made is not None and made.errors is not None and made.errors.piece is not None and faces > 1
    return Unknowns(
        target, bow_basis(target), strain, first_motion, first_bow, count, column, kind, is_given, sigma, ring_sigma,
        is_assembled,
    )  # fmt: skip


def _free_strain(target: TargetGeometry) -> Rows:
    """The strain's numbers that photos can tell: of a plate in the plane z = const only xx, yy and xy.

    The others would tilt it, as poses do.
    """
    if target.is_plate and abs(target.target_from_face[0, 2, 2]) > UPRIGHT:
        return np.array([0, 1, 5])
    return np.arange(6)


def bow_basis(target: TargetGeometry) -> Array:
    """A dome and two saddles over each face, 1 mm at its rim, without their best plane over the rings.  # (R, 3)

    What is left shifts and tilts no face. A function that the rings do not tell from a plane is zero.
    """
    basis = np.zeros((target.ring_count, 3))
    for face in range(target.face_count):
        rows = np.flatnonzero(target.ring_face == face)
        if not len(rows):
            continue
        rim = float(np.linalg.norm(target.outline_mm[face], axis=1).max())
        x, y = (target.center_in_face_mm[rows, :2] / rim).T
        plane = np.column_stack([np.ones(len(rows)), x, y])
        bent = np.column_stack([x * x + y * y, x * x - y * y, 2 * x * y])
        bent -= plane @ least_squares(plane, bent)
        basis[rows] = np.where(np.linalg.norm(bent, axis=0) > 1e-9, bent, 0.0)
    return basis


def nominal_shape(target: TargetGeometry) -> TargetUnknowns:
    """No deviation."""
    faces = target.face_count
    return TargetUnknowns(np.zeros(6), np.zeros((faces, 6)), np.zeros((faces, 3)), np.zeros((target.ring_count, 3)))


def strain_matrix(strain: Array) -> Array:
    """The symmetric matrix (3, 3) of a strain's six numbers."""
    xx, yy, zz, yz, xz, xy = strain
    return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])


def strain_numbers(matrix: Array) -> Array:
    """The six numbers of a symmetric matrix (3, 3)."""
    return np.array([matrix[i, j] for i, j in STRAIN_INDEX])


def moved_shape(unknowns: Unknowns, shape: TargetUnknowns, shared: Array, offset: Array) -> TargetUnknowns:
    """The shape after a step of the shared unknowns (count,) and of the rings' offsets (R, 3)."""
    first, second = unknowns.first_motion, unknowns.first_bow
    strain = np.array(shape.strain)
    strain[unknowns.strain] += shared[:first]
    motion = shape.motion + shared[first:second].reshape(-1, 6) if unknowns.has_motion else shape.motion
    bow = shape.bow + shared[second:].reshape(-1, 3) if unknowns.has_bow else shape.bow
    return TargetUnknowns(strain, motion, bow, shape.offset_mm + offset)


def shared_values(unknowns: Unknowns, shape: TargetUnknowns) -> Array:
    """The values of the shared unknowns.  # (count,)"""
    parts = [
        shape.strain[unknowns.strain],
        shape.motion.ravel() if unknowns.has_motion else np.zeros(0),
        shape.bow.ravel() if unknowns.has_bow else np.zeros(0),
    ]
    return np.concatenate(parts)


@dataclass(frozen=True, eq=False)
class RingPlaces:
    """Where rings are, and how they move with the unknowns."""

    position_mm: Array  # (R, 3) in the target's frame
    unstrained_mm: Array  # (R, 3) the same without the strain of the whole print
    by_shared: Array  # (R, 3, 15) by the unknowns of `Unknowns.column` of the ring's face
    by_offset: Array  # (R, 3, 3)


def in_face_mm(unknowns: Unknowns, shape: TargetUnknowns) -> Array:
    """The rings in their faces' frames, before the faces move.  # (R, 3)"""
    target = unknowns.target
    inside = target.center_in_face_mm + shape.offset_mm
    inside[:, 2] += (unknowns.basis * shape.bow[target.ring_face]).sum(axis=1)
    return inside


def place_rings(unknowns: Unknowns, shape: TargetUnknowns) -> RingPlaces:
    """The rings of a shape, with derivatives."""
    target, face = unknowns.target, unknowns.target.ring_face
    affine = np.eye(3) + strain_matrix(shape.strain)
    frame = target.target_from_face
    turn = exp_rotation(shape.motion[:, :3])
    turned = (turn[face] @ in_face_mm(unknowns, shape)[:, :, None])[:, :, 0]
    unstrained = (frame[face, :3, :3] @ (turned + shape.motion[face, 3:])[:, :, None])[:, :, 0] + frame[face, :3, 3]
    by_shift = affine @ frame[:, :3, :3]
    by_offset = (by_shift @ turn)[face]
    by_shared = np.empty((len(face), 3, SHARED))
    for k, (i, j) in enumerate(STRAIN_INDEX):
        by_shared[:, :, k] = 0.0
        by_shared[:, i, k] = unstrained[:, j]
        by_shared[:, j, k] = unstrained[:, i]
    by_shared[:, :, 6:9] = -by_shift[face] @ skew(turned) @ left_jacobian(shape.motion[:, :3])[face]
    by_shared[:, :, 9:12] = by_shift[face]
    by_shared[:, :, 12:] = by_offset[:, :, 2:] * unknowns.basis[:, None, :]
    return RingPlaces(unstrained @ affine, unstrained, by_shared, by_offset)


def left_jacobian(vector_rad: Array) -> Array:
    """J with `exp(w + d) = exp(J d) exp(w)` to first order in d (..., 3, 3), by rotation vectors w (..., 3)."""
    angle = np.linalg.norm(vector_rad, axis=-1)[..., None, None]
    is_small = angle < 1e-4
    safe = np.where(is_small, 1.0, angle)
    first = np.where(is_small, 0.5 - angle**2 / 24, (1 - np.cos(safe)) / safe**2)
    second = np.where(is_small, 1 / 6 - angle**2 / 120, (safe - np.sin(safe)) / safe**3)
    cross = skew(vector_rad)
    jacobian: Array = np.eye(3) + first * cross + second * (cross @ cross)
    return jacobian
