"""The normal equations of one adjustment: frames' poses, rings' offsets if these are unknowns, and what is shared."""

from dataclasses import dataclass

from designer.base.arrays import Array


@dataclass(frozen=True, eq=False)
class Normal:
    """The normal equations `H x = -g` of V poses, R offsets (or none) and G others: cameras, then what else is shared.

    A row of the rings' couplings has the poses first, then the others, then the gradient.
    """

    pose: Array  # (V, 6, 6)
    pose_row: Array  # (V, 6, G + 1)
    ring: Array  # (R, 3, 3)
    ring_row: Array  # (R, 3, 6 V + G + 1)
    other: Array  # (G, G + 1)
    cost: float  # squares of the whitened residuals, and of the priors; nan if an observation has no image
    squares: float  # without the priors
    residual_px: tuple[Array, ...]  # (2, M) of each camera, predicted - measured
