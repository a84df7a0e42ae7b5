"""A target between drawing and part: what the error sources change, and the geometry that comes of it.

The order is that of making. Rings are first moved and curved within their face, then each face, or each piece of a
board, moves as a rigid body, then the axes of the printer distort the whole:

    X = A (t + R (p + d))    with face frame R, t, a ring's place p + d in it, and A about the target's origin.

What of a target moves as one where it is put together: the faces of a solid, the pieces of a board.
"""

from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from designer.base.arrays import Array, Rows
from designer.base.errors import InputError
from designer.kinds.board_cuts import ring_pieces
from designer.kinds.layout import face_down
from designer.target import TargetGeometry


def piece_of_ring(target: TargetGeometry) -> Rows:
    """The piece that each ring is on: its face; of a board with one face the piece of it.  # (R,)

    Of a board whose file names no pieces they are those that it would be cut in for the usual printer.
    """
    if target.ring_piece is not None:
        return target.ring_piece
    return _as_usual(target) if target.is_planar and target.is_plate else target.ring_face


@lru_cache(maxsize=8)
def _as_usual(target: TargetGeometry) -> Rows:
    """For the usual printer; one piece if it fits the bed, or cannot be cut."""
    from designer.kinds.sizing import size_printing
    from designer.spec.options import AskedPrinting

    try:
        piece = ring_pieces(target, size_printing(AskedPrinting(), target).printer)
    except InputError:
        piece = None
    return target.ring_face if piece is None else piece


def piece_count(target: TargetGeometry) -> int:
    """How many pieces."""
    return target.face_count if is_by_face(target) else int(piece_of_ring(target).max()) + 1


def is_by_face(target: TargetGeometry) -> bool:
    """Whether each face is a piece."""
    return piece_of_ring(target) is target.ring_face


def face_middle_mm(target: TargetGeometry) -> Array:
    """Middle of each face's outline, about which a face turns and bends.  # (F, 2)"""
    middle: Array = target.outline_mm.mean(axis=1)
    return middle


def piece_middle_mm(target: TargetGeometry) -> Array:
    """Middle of each piece, about which it turns: of a board that of the outer rings on it.  # (P, 2)"""
    if is_by_face(target):
        return face_middle_mm(target)
    piece, place = piece_of_ring(target), target.center_in_face_mm[:, :2]
    each = [place[piece == one] for one in range(piece_count(target))]
    return np.array([(one.min(axis=0) + one.max(axis=0)) / 2 for one in each])


LEAST_STRETCH, MOST_STRETCH = 0.5, 2.0
"""A print whose axes are off by more than this is none: the number was meant to be another."""


@dataclass(frozen=True, eq=False)
class MadeShape:
    """A target's shape while sources are applied to it.

    Raises:
        ValueError: a number that is not finite, rings that close or turn inside out, or axes that no print has.
    """

    nominal: TargetGeometry  # where it started
    in_face_mm: Array  # (R, 3) centres in their face's moved frame; z: above its plane
    radius_outer_mm: Array  # (R,)
    radius_inner_mm: Array  # (R,)
    nominal_from_moved: Array  # (F, 4, 4) rigid motion of each face, in its nominal frame
    bed_axes: Array  # (3, 3) rotation from the target's axes to those of the printer's bed
    bed_affine: Array  # (3, 3) distortion of the whole print along the bed's axes, about the target's origin
    expansion_per_kelvin: float = 0.0
    layer_height_mm: float = 0.0

    def __post_init__(self) -> None:
        arrays = (self.in_face_mm, self.radius_outer_mm, self.radius_inner_mm, self.nominal_from_moved, self.bed_affine)
        if not all(np.isfinite(array).all() for array in arrays):
            raise ValueError("the geometry is no longer finite")
        self._check_radii()
        self._check_stretch()

    def _check_radii(self) -> None:
        is_ring = self.nominal.radius_inner_mm > 0
        hole = self.radius_inner_mm[is_ring]
        if (hole <= 0).any():
            raise ValueError(f"the hole of a ring closes: its radius comes to {hole.min():.3g}mm")
        width = (self.radius_outer_mm - self.radius_inner_mm)[self.nominal.radius_outer_mm > 0]
        if (width <= 0).any():
            raise ValueError(f"the ink of a ring vanishes: its width comes to {width.min():.3g}mm")

    def _check_stretch(self) -> None:
        stretch = np.linalg.svd(self.bed_affine, compute_uv=False)
        if np.linalg.det(self.bed_affine) <= 0 or stretch[2] < LEAST_STRETCH or stretch[0] > MOST_STRETCH:
            raise ValueError(
                f"lengths of the print must keep between {LEAST_STRETCH:g} and {MOST_STRETCH:g} times the drawing's"
            )

    def in_bed_axes(self, factor: Array) -> "MadeShape":
        """The print distorted by a further (3, 3) matrix along the bed's axes."""
        return replace(self, bed_affine=factor @ self.bed_affine)

    def with_faces_moved(self, motion: Array) -> "MadeShape":
        """Each face moved further by a rigid motion (F, 4, 4) in its nominal frame."""
        return replace(self, nominal_from_moved=motion @ self.nominal_from_moved)

    def with_pieces_moved(self, motion: Array) -> "MadeShape":
        """Each piece (`designer.tolerance.shape`) moved further by a rigid motion (P, 4, 4) in its nominal frame."""
        if is_by_face(self.nominal):
            return self.with_faces_moved(motion)
        own = motion[piece_of_ring(self.nominal)]
        return replace(self, in_face_mm=np.einsum("rij,rj->ri", own[:, :3, :3], self.in_face_mm) + own[:, :3, 3])

    def with_rings_moved(self, step_mm: Array) -> "MadeShape":
        """Each ring moved by a step (R, 3) in its face's frame."""
        return replace(self, in_face_mm=self.in_face_mm + step_mm)


def shape_of(
    target: TargetGeometry,
    bed_from_target: Array | None = None,
    *,
    expansion_per_kelvin: float = 0.0,
    layer_height_mm: float = 0.0,
) -> MadeShape:
    """A target as drawn.

    Args:
        target: the nominal geometry.
        bed_from_target: how it lay on the bed (`designer.make.bed`; only its rotation counts); without it it lay
            on its last face.  # (4, 4)
        expansion_per_kelvin: of the material, for `thermal`.
        layer_height_mm: of the print, for `stair_steps`.
    """
    return MadeShape(
        nominal=target,
        in_face_mm=target.center_in_face_mm,
        radius_outer_mm=target.radius_outer_mm,
        radius_inner_mm=target.radius_inner_mm,
        nominal_from_moved=np.tile(np.eye(4), (target.face_count, 1, 1)),
        bed_axes=face_down(target) if bed_from_target is None else bed_from_target[:3, :3],
        bed_affine=np.eye(3),
        expansion_per_kelvin=expansion_per_kelvin,
        layer_height_mm=layer_height_mm,
    )


def centers_mm(shape: MadeShape) -> Array:
    """Centres of the rings in the target frame; of an undisturbed shape the nominal ones, bit for bit.  # (R, 3)"""
    moved = _in_target(shape, shape.nominal.target_from_face @ shape.nominal_from_moved, shape.in_face_mm)
    drawn = _in_target(shape, shape.nominal.target_from_face, shape.nominal.center_in_face_mm)
    centers: Array = shape.nominal.center_mm + (moved - drawn) + moved @ _strain(shape).T
    return centers


def target_of(shape: MadeShape) -> TargetGeometry:
    """The perturbed target: true centres, and for each face the rigid frame of the plane it was moved to.

    A frame cannot shear. Where the print does, the face's axes are the orthogonal ones nearest to the sheared ones
    (polar decomposition T = Q S of the images T of its x and y), outline, window and lattice are stretched by S, and
    a ring, then an ellipse, keeps its area.
    """
    nominal = shape.nominal
    frame = nominal.target_from_face @ shape.nominal_from_moved
    strain = _strain(shape)
    rotation = frame[:, :3, :3]
    in_plane = (np.eye(3) + rotation.transpose(0, 2, 1) @ strain @ rotation)[:, :, :2]  # T (F, 3, 2)
    stretch = _square_root(in_plane.transpose(0, 2, 1) @ in_plane)  # S (F, 2, 2)
    axes = in_plane @ np.linalg.inv(stretch)  # Q (F, 3, 2)
    turn = np.concatenate([axes, np.cross(axes[:, :, 0], axes[:, :, 1])[:, :, None]], axis=2)
    made = frame.copy()
    made[:, :3, :3] = rotation @ turn
    made[:, :3, 3] += frame[:, :3, 3] @ strain.T
    widening = np.sqrt(np.linalg.det(stretch))[nominal.ring_face]
    return replace(
        nominal,
        source="perturbed",
        center_mm=centers_mm(shape),
        radius_outer_mm=shape.radius_outer_mm * widening,
        radius_inner_mm=shape.radius_inner_mm * widening,
        target_from_face=made,
        outline_mm=nominal.outline_mm @ stretch,  # S is symmetric
        window_mm=nominal.window_mm @ stretch,
        lattice_mm=nominal.lattice_mm @ stretch,
    )


def _in_target(shape: MadeShape, frame: Array, in_face_mm: Array) -> Array:
    """Places in faces, in the target frame.  # (R, 3)"""
    of_ring = frame[shape.nominal.ring_face]
    placed: Array = (of_ring[:, :3, :3] @ in_face_mm[:, :, None])[:, :, 0] + of_ring[:, :3, 3]
    return placed


def _strain(shape: MadeShape) -> Array:
    """The print's distortion in the target's axes, less the identity.  # (3, 3)"""
    strain: Array = shape.bed_axes.T @ (shape.bed_affine - np.eye(3)) @ shape.bed_axes
    return strain


def _square_root(matrix: Array) -> Array:
    """Square roots of symmetric positive definite 2 x 2 matrices, exact for the identity.

    (M + sqrt(det M) I) / sqrt(tr M + 2 sqrt(det M)), from the theorem of Cayley and Hamilton.
    """
    root = np.sqrt(np.linalg.det(matrix))
    trace = np.sqrt(matrix.trace(axis1=1, axis2=2) + 2 * root)
    return np.asarray((matrix + root[:, None, None] * np.eye(2)) / trace[:, None, None])


def turn_of_pieces(target: TargetGeometry, rotation_rad: Array) -> Array:
    """Motions (P, 4, 4) that turn each piece about its middle by a rotation vector (P, 3) in its face's frame.

    R = I + sin a / a [v] + (1 - cos a) / a^2 [v]^2 with a = |v| (Rodrigues).
    """
    angle = np.linalg.norm(rotation_rad, axis=1)[:, None, None]
    x, y, z = rotation_rad.T
    zero = np.zeros_like(x)
    cross = np.stack([zero, -z, y, z, zero, -x, -y, x, zero], axis=1).reshape(-1, 3, 3)
    rotation = np.eye(3) + np.sinc(angle / np.pi) * cross + 0.5 * np.sinc(angle / (2 * np.pi)) ** 2 * (cross @ cross)
    middle = np.pad(piece_middle_mm(target), ((0, 0), (0, 1)))[:, :, None]
    motion = np.tile(np.eye(4), (len(middle), 1, 1))
    motion[:, :3, :3] = rotation
    motion[:, :3, 3:] = (np.eye(3) - rotation) @ middle
    return motion


def shift_of_pieces(step_mm: Array) -> Array:
    """Motions (P, 4, 4) that shift each piece by a step (P, 3) in its face's frame."""
    motion = np.tile(np.eye(4), (len(step_mm), 1, 1))
    motion[:, :3, 3] = step_mm
    return motion
