"""What photos do not tell of a print, in words."""

import numpy as np

from calib.core.types import Observations
from calib.measure_target.datum import FEW_VIEWS, SeenParts, few_views
from calib.solver.outliers import deviations
from designer.base.arrays import Array, Flags
from designer.target import TargetGeometry

FAR_OFF = 6.0


def remarks_of(seen: SeenParts, is_determined: Flags, target: TargetGeometry) -> tuple[str, ...]:
    """One line on each thing that the photos do not tell."""
    said = []
    unseen = ~seen.face
    if unseen.any():
        said.append(f"no view shows {faces_words(unseen)}: kept as designed")
    apart = seen.face & ~seen.main
    if apart.any():
        said.append(
            f"no view joins {faces_words(apart)} with the others: where they are is not known; take photos that show "
            "faces of both"
        )
    unsure = ~is_determined & seen.main
    if unsure.any():
        said.append(f"too few views of {faces_words(unsure)} to tell where they are; take more")
    few = is_determined & few_views(seen.views)
    if few.any():
        said.append(
            f"fewer than {FEW_VIEWS} views show {faces_words(few)}: a mistake in one of them would not be seen, so "
            "whether they moved is not judged"
        )
    rings = ~seen.ring & is_determined[target.ring_face]
    if rings.any():
        said.append(
            f"{int(rings.sum())} rings of measured faces were never seen: kept where they were designed on them"
        )
    return tuple(said)


def far_off(seen: Observations, residual_px: Array) -> list[str]:
    """A word on observations that noise does not explain.  # (2, M)"""
    deviation = deviations(residual_px, seen.cov_px2)
    far = np.flatnonzero(deviation > FAR_OFF)
    if not len(far):
        return []
    worst = int(far[np.argmax(deviation[far])])
    off = float(np.hypot(*residual_px[:, worst]))
    return [
        f"{len(far)} of {len(deviation)} observations are off by more than {FAR_OFF:g} robust standard deviations, the "
        f"worst by {off:.3g} px in {seen.view_names[seen.view[worst]]}; look at them, or reject them"
    ]


def faces_words(which: Flags) -> str:
    """The numbers of faces, in words."""
    numbers = np.flatnonzero(which).tolist()
    return f"face{'s' if len(numbers) > 1 else ''} {', '.join(map(str, numbers))}"
