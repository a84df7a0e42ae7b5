"""What a rig's unknowns are off by because frames tell the target's motion between them only so well."""

import numpy as np
from numpy.typing import NDArray

from calib.rigs.descend import RigEquations, params_of
from calib.rigs.problem import RigProblem, RigState, seen_poses
from calib.solver.chain import through_camera
from calib.solver.descent import Descent

Array = NDArray[np.float64]


def motion_covariance(
    problem: RigProblem, found: Descent[RigState, RigEquations], shared: Array, coupling: Array
) -> Array:
    """Of the shared unknowns, by the errors of the target's speed.  # (G, G)

    A photo that was taken g from the frame's time, of a target e faster than thought, shows it g e away; the normal
    equations tell what follows. Errors e are those of the process, and as far as frames leave speeds open, all speeds
    together by as large a part of themselves: what the process itself is, is a guess there.

    Args:
        problem: what was seen.
        found: the minimum.
        shared: the inverse normal matrix of the shared unknowns (G, G).
        coupling: what frames take from them (V, 6, G), see `calib.rigs.accuracy`.
    """
    count, state, motion = problem.shared_count, found.state, problem.motion
    total = np.zeros((count, count))
    if motion is None:
        return total
    slope = np.zeros((problem.frame_count, count, 6))  # of the gradient by the speeds
    for number, (one, chain) in enumerate(zip(problem.seen, found.equations.chains, strict=True)):
        blocks = (found.equations.slack if problem.slack else found.equations.blocks)[number].products
        turned, _ = through_camera(state.cam_from_rig[number], seen_poses(problem, state, number)[0])
        gap_s = one.gap_s - state.delay_s[number]
        by_speed = blocks[:, :-1, -7:-1] @ turned * gap_s[:, None, None]  # (V_c, P + 6, 6)
        columns = np.concatenate([params_of(problem, number), chain.column])
        own = np.concatenate(
            [by_speed[:, :-6], chain.by_shared.transpose(0, 2, 1) @ by_speed[:, -6:]], axis=1
        )  # fmt: skip
        part = np.zeros((len(own), count + 1, 6))  # what is fixed takes the last
        for place, column in enumerate(columns.tolist()):  # parameters that share a value add up
            part[:, column] += own[:, place]
        by_frame = chain.by_frame.transpose(0, 2, 1) @ by_speed[:, -6:]
        slope[one.frame] += part[:, :-1] - coupling[one.frame].transpose(0, 2, 1) @ by_frame
    follows = shared @ slope
    unknown, speed = np.zeros(6), motion.derivative[0]
    for rows, covariance in motion.speed_covariance():
        total += np.einsum("vga,avw,wha->gh", follows[rows], covariance, follows[rows], optimize=True)
        unknown += np.trace(covariance, axis1=1, axis2=2)
    known = (speed**2).sum(axis=0)
    share = np.divide(unknown, known, out=np.zeros(6), where=known > 0)
    alike = np.einsum("vga,a,va->g", follows, share, speed)
    total += alike[:, None] * alike
    return total
