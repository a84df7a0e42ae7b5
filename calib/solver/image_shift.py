"""A photo whose picture is shifted against the others': damaged on its way, cropped, or moved by a stabiliser.

Its pose takes up most of a shift: what is left is spread over all photos, and looks like noise. So the principal point
of each photo is freed in turn, by the normal equations at the minimum: with the views' reduced blocks H_v, h_v (poses
eliminated), their sum N, and A the columns of the principal point, the shift is `-S^-1 h_v[A]` with
`S = H_v[A, A] - H_v[A, :] N^-1 H_v[:, A]`, and `T = h_v[A]' S^-1 h_v[A]` is by how much the squares would fall (a score
test; Cook and Weisberg 1982, section 2.2). The largest T is held against those of the others once it is accounted for:
against their median, and against the largest of them, which a model that does not fit makes as large.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from calib.core.linear_algebra import symmetric_inverse
from calib.solver.options import Tie
from calib.solver.schur import reduced_blocks

Array = NDArray[np.float64]

PRINCIPAL_POINT = slice(2, 4)
"""Of the parameters of every model."""
LEAST_VIEWS = 5
"""Of four, sound ones reach 20 times what the three others scatter, and 16 times the most of these."""
MEDIAN_SQUARE = 1.3862943611198906
"""Of a normal vector in the plane, 2 ln 2, in squares of a coordinate's standard deviation."""
SURE, CLEAR = 15.0, 5.0
"""Times what the others scatter, and times the most of them. Measured, of 5 to 20 photos: by a block's 16 px at .03 px
of noise 23 to 109 and 11 to 45, by 8 px 11 to 54 and 5.5 to 23; of sound photos at most 5 and 3.3, and where a model
leaves pixels over of a real wide lens 12 and 3.2. A few tenths of a pixel of noise, or a model that does not fit, hide
a shift: then nothing is said. In 800 random calibrations by models that lack the lens or a part
of it, one photo shifted by 4 to 100 px, no other was named."""
LEAST_PX = 0.2


def shifted_photo(products: Array, tie: Tie, names: Sequence[str]) -> list[str]:
    """A word on the photo whose picture is shifted most, if not by chance, from the views' blocks at the minimum."""
    if len(products) < LEAST_VIEWS or (tie.row[PRINCIPAL_POINT] < 0).any():
        return []
    reduced = reduced_blocks(products)
    block, gradient = reduced[:, :-1, :-1], reduced[:, :-1, -1]  # (V, P, P), (V, P)
    free = np.zeros((len(tie.row), int(tie.row.max()) + 1))
    free[tie.row >= 0, tie.row[tie.row >= 0]] = 1
    inverse = free @ symmetric_inverse(free.T @ block.sum(axis=0) @ free).inverse @ free.T

    own = block[:, :, PRINCIPAL_POINT]  # (V, P, 2)
    spread = symmetric_inverse(own[:, PRINCIPAL_POINT] - own.transpose(0, 2, 1) @ inverse @ own).inverse
    gain = _gain(gradient, spread)
    worst = int(gain.argmax())
    shift_px = -spread[worst] @ gradient[worst, PRINCIPAL_POINT]
    # What the other photos' gradients are once the camera no longer makes up for this one.
    others = gradient - block @ inverse @ own[worst] @ shift_px
    of_others = np.delete(_gain(others, spread), worst)
    usual = float(np.median(of_others)) / MEDIAN_SQUARE
    is_alone = gain[worst] > SURE**2 * usual and gain[worst] > CLEAR**2 * of_others.max()
    if not (is_alone and np.hypot(*shift_px) > LEAST_PX):
        return []
    return [
        f"{names[worst]}: its picture is shifted by about {shift_px[0]:.2g}, {shift_px[1]:.2g} px against the others' "
        f"({np.sqrt(gain[worst] / usual):.0f} times what they scatter): damaged, cropped, or taken with another zoom, "
        "focus or a stabiliser; leave it out"
    ]


def _gain(gradient: Array, spread: Array) -> Array:
    """By how much the sum of squares would fall (V,)."""
    of_point = gradient[:, PRINCIPAL_POINT]
    return np.asarray(np.einsum("vi,vij,vj->v", of_point, spread, of_point))
