"""A measured target, and what is known of it."""

from dataclasses import dataclass, replace

import numpy as np

from calib.cameras.camera import Camera
from calib.core.se3 import exp_rotation
from calib.core.types import Observations
from calib.measure_target.datum import LEAST_RINGS, SeenParts, best_motion, fit_rings, rigid_design
from calib.measure_target.lengths import FittedLength
from calib.measure_target.unknowns import TargetUnknowns, Unknowns, place_rings, strain_matrix
from calib.solver.calibration import Status
from designer.base.arrays import Array, Flags, Rows
from designer.target import TargetGeometry

DIGITS = 9
"""Of a millimetre: less moves nothing."""


@dataclass(frozen=True, eq=False)
class AsBuilt:
    """A target as photos show it, with the cameras that took them; V views and M observations of each camera.

    Where the target is, is a convention: it is laid over the nominal one, see `calib.measure_target.datum`. The
    covariances are in that datum, with the posterior scale factor in them.
    """

    target: TargetGeometry  # source "measured", with `face_covariance`: where the faces are, in their frames
    nominal: TargetGeometry
    observations: tuple[Observations, ...]  # of each camera, of the views that were solved
    cameras: tuple[Camera, ...]
    param_covariance: tuple[Array, ...]  # (P, P) of each camera, zero for fixed parameters
    poses: tuple[Array, ...]  # (V, 4, 4) cam_from_target of the measured target, of each camera
    residual_px: tuple[Array, ...]  # (M, 2) of each camera, predicted - measured
    is_outlier: tuple[Flags, ...]  # (M,) of each camera, left out of the solution
    scale: float  # posterior standard deviation of an observation, in px or in units of its stated covariance
    strain: Array  # (3, 3) of the whole print, in the target's axes, about its origin; 0.01: 1 % too large
    strain_covariance: Array  # (6, 6) of its xx, yy, zz, yz, xz, xy
    motion: Array  # (F, 6) of each face, the strain taken off: rotation vector (rad), shift (mm), in the face's frame
    motion_covariance: Array  # (6 F, 6 F)
    bow_mm: Array  # (F, 3) dome and two saddles at the face's rim, see `calib.measure_target.unknowns.bow_basis`
    bow_covariance: Array  # (F, 3, 3)
    offset_mm: Array  # (R, 3) of each ring, in its face's frame, beyond all that
    offset_sigma_mm: Array  # (R, 3)
    ring_sigma_mm: tuple[float, float] | None  # how far rings are off, in their plane and normal to it; None: rigid
    scale_known: bool  # from lengths; else the measured target is as large as the nominal one
    scale_sigma: float  # relative, of the whole target; nan if not known
    lengths: tuple[FittedLength, ...]  # that told the scale
    is_determined: Flags  # (F,) the photos tell where the face is
    is_outlying: Flags  # (F,) lies unlike all others, and took no part in laying the target over
    face_views: Rows  # (F,) how many views show the face
    centre_noise_mm: Array  # (F,) what the noise of one centre along an axis is on the face, at the photos' scale
    is_ring_seen: Flags  # (R,)
    remarks: tuple[str, ...]  # what the photos do not tell, one line each
    status: Status
    iterations: int
    seconds: float


def face_shift_mm(target: TargetGeometry, square: Array) -> Array:
    """How far the motions of faces shift their rings, root mean square along an axis.  # (F,)

    By the motions' products with themselves, or their covariances (F, 6, 6).
    """
    design = rigid_design(target.center_in_face_mm)
    each = np.einsum("rij,rjk,rik->r", design, square[target.ring_face], design) / 3
    rings = np.maximum(np.bincount(target.ring_face, minlength=target.face_count), 1)
    shift: Array = np.sqrt(np.bincount(target.ring_face, each, target.face_count) / rings)
    return shift


def left_open_mm(unknowns: Unknowns, shape: TargetUnknowns, strain: Array, bow: Array) -> Array:
    """Displacements of the rings (S, R, 3) by independent standard normal numbers: what is not known of strain and bow.

    Where photos do not tell how far a print is stretched, it may be stretched still, measured or not.

    Args:
        unknowns: of the nominal target.
        shape: the deviations.
        strain: covariance of the strain (6, 6).
        bow: covariances of the faces' bows (F, 3, 3).
    """
    by_shared, face = place_rings(unknowns, shape).by_shared, unknowns.target.ring_face
    by_strain = by_shared[:, :, :6] @ _root(strain)
    each = by_shared[:, :, 12:] @ _root(bow)[face]
    by_bow = np.where(face[:, None, None, None] == np.arange(len(bow))[:, None], each[:, :, None], 0.0)
    flat = np.concatenate([by_strain, by_bow.reshape(len(face), 3, -1)], axis=2).transpose(2, 0, 1)
    rounded = np.round(flat, DIGITS)
    left_open: Array = rounded[(rounded != 0).any(axis=(1, 2))]
    return left_open


def _root(covariance: Array) -> Array:
    """L with L L' = C of covariances (..., N, N), singular ones too."""
    value, vector = np.linalg.eigh(covariance)
    root: Array = vector * np.sqrt(np.maximum(value, 0.0))[..., None, :]
    return root


def target_of(
    unknowns: Unknowns, seen: SeenParts, shape: TargetUnknowns, covariance: Array, open_mm: Array | None = None
) -> TargetGeometry:
    """The geometry of a shape.

    A face's frame is its nominal one moved so that it fits its rings best; a strain then also stretches the outline,
    the window, the lattice and (on average) the rings in it.

    Args:
        unknowns: of the nominal target.
        seen: which rings tell where a face is.
        shape: the deviations.
        covariance: of the faces (F, 6, 6).
        open_mm: what else is not known (S, R, 3).
    """
    target, rings = unknowns.target, place_rings(unknowns, shape)
    frame, stretch = np.array(target.target_from_face), np.tile(np.eye(2), (target.face_count, 1, 1))
    affine = np.eye(3) + strain_matrix(shape.strain)
    turn = affine @ target.target_from_face[:, :3, :3] @ exp_rotation(shape.motion[:, :3])
    for face, rows in enumerate(fit_rings(unknowns, seen)):
        if len(rows) >= LEAST_RINGS:
            _, rotation, shift = best_motion(target.center_in_face_mm[rows], rings.position_mm[rows])
            frame[face, :3, :3], frame[face, :3, 3] = rotation, shift
        stretch[face] = (frame[face, :3, :3].T @ turn[face])[:2, :2]
    mean = np.sqrt(np.linalg.det(stretch))[target.ring_face]
    return replace(
        target,
        source="measured",
        center_mm=rings.position_mm,
        target_from_face=frame,
        radius_outer_mm=mean * target.radius_outer_mm,
        radius_inner_mm=mean * target.radius_inner_mm,
        outline_mm=np.einsum("fij,fkj->fki", stretch, target.outline_mm),
        window_mm=np.einsum("fij,fkj->fki", stretch, target.window_mm),
        lattice_mm=np.einsum("fij,fkj->fki", stretch, target.lattice_mm),
        face_covariance=covariance,
        mode_mm=open_mm,
    )
