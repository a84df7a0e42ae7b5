"""Whether a robot's poses can be what they are taken for: the other way round, or in another unit, they may fit."""

import numpy as np
from numpy.typing import NDArray

from calib.core.se3 import invert
from calib.rigs.hand_eye import HandEyeStart, start_hand_eye

Array = NDArray[np.float64]

FAR_BETTER = 4.0
"""Times that another reading leaves less, from which on it is what was meant."""
UNITS = ((1000.0, "metres that are taken for millimetres"), (1e-3, "millimetres that are taken for metres"))
FEWEST = 4
"""Poses, of fewer of which anything may fit."""


def why_wrong(
    cam_from_target: Array, base_from_flange: Array, *, is_camera_in_hand: bool, is_inverted: bool = False
) -> str:
    """What a robot's poses look like if it is not what was said; "" if they may be right.

    Args:
        cam_from_target: (V, 4, 4) by the camera alone.
        base_from_flange: (V, 4, 4) as they were read.
        is_camera_in_hand: else the target is.
        is_inverted: a person said that their file holds flange_from_base.
    """
    if len(cam_from_target) < FEWEST:
        return ""
    given = _left(cam_from_target, base_from_flange, is_camera_in_hand=is_camera_in_hand)
    other = _left(cam_from_target, invert(base_from_flange), is_camera_in_hand=is_camera_in_hand)
    if other[0] * FAR_BETTER < given[0]:
        what, remedy = ("base_from_flange", "leave out") if is_inverted else ("flange_from_base", "give")
        return (
            f"these look like {what}: read so the turns fit to {np.rad2deg(other[0]):.2g} deg, as given to "
            f"{np.rad2deg(given[0]):.2g} deg; {remedy} --inverted"
        )
    for factor, what in UNITS:
        scaled = base_from_flange.copy()
        scaled[:, :3, 3] *= factor
        left = _left(cam_from_target, scaled, is_camera_in_hand=is_camera_in_hand)
        if left[1] * FAR_BETTER < given[1]:
            return (
                f"these look like {what}: read so the camera's ways fit to {left[1]:.2g} mm, as given to "
                f"{given[1]:.2g} mm; name the unit with --unit"
            )
    return ""


def _left(cam_from_target: Array, base_from_flange: Array, *, is_camera_in_hand: bool) -> tuple[float, float]:
    """What a closed form leaves over: rad, mm."""
    carried = invert(base_from_flange) if is_camera_in_hand else base_from_flange
    start: HandEyeStart = start_hand_eye(cam_from_target, carried)
    turn, shift = np.linalg.norm(start.error[:, :3], axis=1), np.linalg.norm(start.error[:, 3:], axis=1)
    return float(np.median(turn)), float(np.median(shift))
