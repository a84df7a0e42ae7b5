"""Views whose pose is not quite the rig's: errors that all sightings of a photo share.

What a lens leaves over, how centres are biased, and by how much a photo of a moving target is early or late, is alike
all over a photo: that moves its pose by more than independent errors of the same size would (a design effect; Kish
1965, section 8.2), and a robot, or other cameras, would seem to be wrong. So each view may have a pose that differs
from the rig's by a slack z (6,), expected to be as large as k times its own covariance: with the view's block H and the
pose's part W of it the precision is `W / k`, where k is estimated from all views. The slack is eliminated within the
view: with h the pose's columns of H, `H - h (W + W / k)^-1 h'` is left; what no pose explains tells the noise.
"""

from dataclasses import dataclass

import numpy as np

from calib.core.linear_algebra import symmetric_inverse
from designer.base.arrays import Array


@dataclass(frozen=True, eq=False)
class SlackPrior:
    """What is expected of the slacks of one camera's views."""

    weight: Array  # (V_c, 6, 6) W
    size: float  # k

    @property
    def precision(self) -> Array:
        """(V_c, 6, 6)"""
        return self.weight / self.size


@dataclass(frozen=True, eq=False)
class WithoutSlack:
    """One camera's views without their slacks."""

    products: Array  # (V_c, P + 7, P + 7) of the views' blocks, reduced
    solved: Array  # (V_c, 6, P + 7) by how much the slacks follow parameters and pose, and the gradient; sign turned
    spread: Array  # (V_c, 6, 6) their covariance, all else known
    prior: float  # their squares, in standard deviations
    promised: float  # by how much the cost falls by them alone


def eliminated(products: Array, prior: SlackPrior, value: Array, damping: float = 0.0) -> WithoutSlack:
    """Blocks (V_c, P + 7, P + 7) without the slacks, which have values (V_c, 6); of a damped step with damping."""
    row = products[:, -7:-1].copy()
    pull = np.einsum("vde,ve->vd", prior.precision, value)
    row[:, :, -1] += pull
    curve = (row[:, :, -7:-1] + prior.precision) * (1 + damping * np.eye(6))
    spread = symmetric_inverse(curve).inverse  # zero along what a few points do not tell
    solved = spread @ row
    left = products - row.transpose(0, 2, 1) @ solved
    return WithoutSlack(
        left, solved, spread, float((value * pull).sum()), float((row[:, :, -1] * solved[:, :, -1]).sum())
    )


def slack_step(view: WithoutSlack, params_step: Array, pose_step: Array) -> Array:
    """The step of the slacks that belongs to steps of parameters (P,) and poses (V_c, 6).  # (V_c, 6)"""
    count = view.solved.shape[2] - 7
    step = view.solved[:, :, -1] + view.solved[:, :, :count] @ params_step
    return np.asarray(-(step + np.einsum("vdp,vp->vd", view.solved[:, :, count:-1], pose_step)))


def slack_evidence(prior: SlackPrior, value: Array, covariance: Array) -> tuple[float, float]:
    """Squares of the values, and how many of them the photos tell: the size is their ratio (Foerstner 1979).

    Args:
        prior: of one camera.
        value: of its views (V_c, 6).
        covariance: of these (V_c, 6, 6) by the whole adjustment.
    """
    squares = float(np.einsum("vd,vde,ve->", value, prior.weight, value))
    return squares, float(value.size - np.einsum("vde,ved->", prior.precision, covariance))
