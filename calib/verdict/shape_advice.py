"""What to do where the camera is uncertain because its target may not be as its file says."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calib.solver.calibration import Calibration
from calib.verdict.checks import made_words, px
from calib.verdict.criteria import Criteria
from calib.verdict.evidence import CameraEvidence
from calib.verdict.next_view_target import shape_of

Array = NDArray[np.float64]

ONE_AXIS = 0.1
"""Ratio of the mean squares of tilts along two axes below which they are about one."""
NOT_ROLLED = 0.8
"""Length of the mean direction of the target in the image, its angles doubled, above which all photos have one."""


@dataclass(frozen=True)
class ShapeAdvice:
    """What to do about a target whose shape is not known well enough."""

    sentence: str = ""  # "": nothing
    measures: bool = False  # it is to be measured; else photos are wanted


def shape_advice(calibration: Calibration, evidence: CameraEvidence, criteria: Criteria, measure: str) -> ShapeAdvice:
    """The photos that would tell the target's shape, or that it is to be measured; nothing where it is no matter.

    Args:
        calibration: the one that is judged.
        evidence: of it.
        criteria: the limits it is judged by.
        measure: how to measure the target, in commands.
    """
    uncertain = evidence.uncertainty
    if uncertain.image_px is None or not uncertain.by_target or uncertain.image_px <= criteria.uncertainty_px.good:
        return ShapeAdvice()
    if uncertain.target_error is None:
        return ShapeAdvice()
    made = made_words(uncertain.target_error)
    reason = f"one {made} may be off so far that the camera is off by {px(uncertain.target_px)}"
    photos = " and ".join(_missing(calibration))
    if not photos:
        return ShapeAdvice(f"measure the target, and solve with the measured one: {measure}; {reason}", measures=True)
    return ShapeAdvice(f"{photos}: the photos so far do not tell the target's shape, and {reason}")


def _missing(calibration: Calibration) -> tuple[str, ...]:
    """What photos of a flat target lack to tell its shape from the lens."""
    shape = shape_of(calibration)
    if shape is None or not shape.is_flat:
        return ()
    in_plane = np.linalg.svd(shape.normal[:1])[2][1:]  # (2, 3)
    rotation = calibration.cam_from_target[:, :3, :3]
    tilt = rotation[:, 2] @ in_plane.T
    least, most = np.linalg.eigvalsh(tilt.T @ tilt).tolist()
    side = rotation[:, :2] @ in_plane[0]
    direction = (side[:, 0] + 1j * side[:, 1]) ** 2
    found = []
    if abs(direction.sum()) > NOT_ROLLED * float(np.abs(direction).sum()):
        found.append("roll the camera, or the target in its plane, by 90 deg in half of the photos")
    if least < ONE_AXIS * most:
        found.append("tilt the target about its other axis too, by 30 to 50 deg")
    return tuple(found)
