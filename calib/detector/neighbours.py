"""What a guess for one grid on a solid makes of its neighbours, which share corners with it in the image."""

from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from calib.core.jit import jit

Integers: TypeAlias = NDArray[np.int64]

UNNAMED = -1


@jit
def _fitting_name(
    corner: Integers, score: Integers, options: int, corner_vertex: Integers, vertex: Integers, is_taken: Integers
) -> tuple[int, int]:
    """The face and the option whose corners fit the corners known so far, the best by its code; UNNAMED: none.

    Args:
        corner: of one grid: each option's corners, as numbers among the image's.  # (O, K)
        score: of its options as each face.  # (O, F)
        options: how many it has.
        corner_vertex: which points of the solid the faces' corners are.  # (F, K)
        vertex: which the image's corners are; UNNAMED: not known yet.  # (C,)
        is_taken: whether faces have grids.  # (F,)
    """
    best_face, best_option, best_score = UNNAMED, UNNAMED, 0
    for option in range(options):
        known = 0
        for place in range(corner.shape[1]):
            known += vertex[corner[option, place]] != UNNAMED
        if known < 2:
            continue
        for face in range(len(corner_vertex)):
            fits = is_taken[face] == 0
            for place in range(corner.shape[1]):
                point = vertex[corner[option, place]]
                fits = fits and (point == UNNAMED or point == corner_vertex[face, place])
            if fits and (best_face == UNNAMED or score[option, face] > best_score):
                best_face, best_option, best_score = face, option, score[option, face]
    return best_face, best_option


@jit
def follow(
    corner: Integers,
    score: Integers,
    options: Integers,
    touch: NDArray[np.bool_],
    corner_vertex: Integers,
    corners: int,
    anchor: int,
    missing: int,
) -> tuple[Integers, Integers]:
    """Every pose of the solid that one grid of a group allows, followed through its neighbours.

    Args:
        corner: each grid's and option's corners, as numbers among the image's.  # (G, O, K)
        score: of the grids' options as each face.  # (G, O, F)
        options: how many each grid has.  # (G,)
        touch: which grids share an edge in the image.  # (G, G)
        corner_vertex: which points of the solid the faces' corners are.  # (F, K)
        corners: how many the image has.
        anchor: the grid to start from.
        missing: what a neighbour costs that lies where a pose has no such face.

    Returns:
        The poses' scores (Q,), and the face and option of each grid (Q, G, 2); UNNAMED: none.
    """
    grids, faces = len(options), len(corner_vertex)
    poses = faces * options[anchor]
    total = np.zeros(poses, dtype=np.int64)
    name = np.full((poses, grids, 2), UNNAMED)
    queue, vertex = np.empty(grids, dtype=np.int64), np.empty(corners, dtype=np.int64)
    for pose in range(poses):
        vertex[:] = UNNAMED
        is_reached, is_taken = np.zeros(grids, dtype=np.int64), np.zeros(faces, dtype=np.int64)
        name[pose, anchor, 0], name[pose, anchor, 1] = pose // options[anchor], pose % options[anchor]
        queue[0], is_reached[anchor], waiting = anchor, 1, 1
        done = 0
        while done < waiting:
            at = queue[done]
            done += 1
            face, option = name[pose, at]
            total[pose] += score[at, option, face]
            is_taken[face] = 1
            for place in range(corner.shape[2]):
                vertex[corner[at, option, place]] = corner_vertex[face, place]
            for other in range(grids):
                if is_reached[other] or not touch[at, other]:
                    continue
                is_reached[other] = 1
                found = _fitting_name(corner[other], score[other], options[other], corner_vertex, vertex, is_taken)
                if found[0] == UNNAMED:
                    total[pose] -= missing
                else:
                    name[pose, other, 0], name[pose, other, 1] = found
                    queue[waiting] = other
                    waiting += 1
    return total, name
