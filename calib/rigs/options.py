"""What a person may choose about the solution of a rig."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calib.cameras.camera import Camera
from calib.core.types import freeze
from calib.solver.costs import IMAGE
from calib.solver.options import Loss

Array = NDArray[np.float64]


FREE_SIZE = 0.1
"""Standard deviation of the size of a target of which nobody knows how it was made: a page that was fitted to the paper
is 3 to 6 % off."""


@dataclass(frozen=True)
class CameraChoice:
    """How one camera of a rig is to be solved."""

    model: str  # of `solved_models()`; of a given camera its own
    given: Camera | None = None  # from an earlier run; None: solved from nothing
    is_refined: bool = True  # whether its parameters are unknowns
    fixed: tuple[tuple[str, float | None], ...] = ()  # as `SolveOptions.fixed`


@dataclass(frozen=True, eq=False)
class Carrier:
    """What carries the target, or the cameras past it, and says how it stood in each frame.

    Camera in hand: the rig's frame is the flange's, and `rig_from_carrier` is flange_from_base. Target in hand: the
    rig's frame is the base's, and it is base_from_flange. Turntable: the rig's frame is the table's at rest, its z
    along the axis, and it is the turn by each frame's angle.
    """

    kind: str  # see `CarrierFit`
    rig_from_carrier: Array  # (V, 4, 4)
    is_camera_in_hand: bool = False
    is_turntable: bool = False
    has_free_angles: bool = False  # of a turntable
    sigma_rad: float | None = None  # of its own errors; None: estimated
    sigma_mm: float | None = None
    size_sigma: float = 0.0
    """Standard deviation of the target's size, as a part of it, before a robot's ways tell it; 0: it is not solved."""

    def __post_init__(self) -> None:
        freeze(self, "rig_from_carrier")


@dataclass(frozen=True)
class RigOptions:
    """How to solve a rig; the default is least squares of all observations, one camera's noise told from another's."""

    reference: int = 0  # the camera whose frame the rig's is, if no carrier says otherwise
    weighted: bool = True
    loss: Loss = "squares"
    reject_sigma: float | None = None
    allows_slack: bool | None = None
    """Of single photos, where they do not fit together; None: also only if each camera tells its lens by itself, or
    something carries them; see `solve_rig`."""
    estimates_delays: bool = False  # of cameras, from time stamps
    carrier: Carrier | None = None
    max_iterations: int = 100
    minimise: str = IMAGE  # as `SolveOptions.minimise`
