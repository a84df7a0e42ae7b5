"""The back of a board with two faces: no photo shows it beside the front, so photos do not tell how the two lie.

Poses take its motion up, as they do that of a single face. It stays where the design has it, as surely as the way of
making says, and lies as deep as a caliper over the plate says.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from calib.measure_target.datum import rigid_fit
from calib.measure_target.lengths import CaliperLength, length_in, scale_from
from calib.measure_target.result import AsBuilt, face_shift_mm
from designer.base.arrays import Array
from designer.target import TargetGeometry
from designer.tolerance.model import ErrorModel
from designer.tolerance.prior import displacements
from designer.tolerance.sources import SOURCES

LEAST_SIGMA_MM = 1e-4


def tells_thickness(target: TargetGeometry, name: str) -> bool:
    """Whether a length is that over front and back of a plate, which says nothing of its size."""
    return target.has_back and name.strip().lower().startswith("face")


def with_thickness(target: TargetGeometry, thickness_mm: float) -> TargetGeometry:
    """The target with its back as deep below the front as a caliper says."""
    frame, center = np.array(target.target_from_face), np.array(target.center_mm)
    step = (thickness_mm - length_in(target, "face-to-face")) * frame[1, :3, 2]
    frame[1, :3, 3] += step
    center[target.ring_face == 1] += step
    return replace(target, source="measured", target_from_face=frame, center_mm=center)


def back_covariance(target: TargetGeometry, errors: ErrorModel) -> Array:
    """Of the back's motion against the front, in its frame: rotation vector (rad), shift (mm).  # (6, 6)

    Both faces have the errors of a face, so that twice their variances stand between them.
    """
    back = target.ring_face == 1
    fit = rigid_fit(target.center_in_face_mm[back])
    covariance = np.zeros((6, 6))
    for name, amount in errors.amounts:
        if SOURCES[name].scope in ("face", "piece"):
            change, _ = displacements(target, errors, name)
            inside = np.einsum("ji,rjc->ric", target.target_from_face[1, :3, :3], change[back])
            motion = fit @ inside.reshape(3 * int(back.sum()), -1)
            covariance += 2 * amount.sigma**2 * motion @ motion.T
    return covariance


def with_back(found: AsBuilt, errors: ErrorModel | None, lengths: Sequence[CaliperLength]) -> AsBuilt:
    """What was measured of a board with two faces, with what is known of its back; other targets as they are.

    Args:
        found: its print, measured.
        errors: of the way of making; None: the faces lie as the file has them.
        lengths: over both faces.
    """
    if not found.nominal.has_back:
        return found
    covariance = np.zeros((6, 6)) if errors is None else back_covariance(found.nominal, errors)
    target, motion, said = found.target, np.array(found.motion), "is as designed"
    if lengths:
        told = scale_from(found.nominal, lengths)
        thickness_mm, designed_mm = (factor * length_in(found.nominal, "face-to-face") for factor in (told.value, 1.0))
        target = with_thickness(target, thickness_mm)
        motion[1, 5] = thickness_mm - designed_mm
        covariance[5, :] = covariance[:, 5] = 0.0
        covariance[5, 5] = max(told.sigma * designed_mm, LEAST_SIGMA_MM) ** 2
        said = f"is {thickness_mm:.3f} mm as the caliper says, else the back lies as designed"
    faces = np.array(target.face_covariance if target.face_covariance is not None else np.zeros((2, 6, 6)))
    faces[1] += covariance
    moved = np.array(found.motion_covariance)
    moved[6:, 6:] += covariance
    off_mm = float(face_shift_mm(found.nominal, np.stack([0 * covariance, covariance]))[1])
    remark = (
        "no photo shows both sides of a board, so none tells how thick it is and how its sides lie: the thickness "
        f"{said} (rings of the back within {off_mm:.2g} mm of the front's frame, 1 sigma)"
    )
    if not lengths:
        remark += "; --length 'face 0 to face 1:READING' tells the thickness"
    return replace(
        found,
        target=replace(target, face_covariance=faces),
        motion=motion,
        motion_covariance=moved,
        remarks=(*found.remarks, remark),
    )
