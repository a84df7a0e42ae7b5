"""Which of several lenses comes closest to a camera, those first that suit its field of view."""

from collections.abc import Callable, Sequence
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from calib.cameras.refit import Refit
from designer.base.errors import InputError

FAR_COSINE = np.cos(np.radians(75.0))
"""Beyond, the numbers of lenses with a focal plane run away: wide ones suit such a camera."""
LARGE_PX = 0.05
"""A larger difference is worth a warning, and a try of other lenses: calibrations are good to hundredths of a pixel."""
ACCEPTED_PX = 0.1
"""A fit of a program's own choosing that is off by more is refused, unless that is allowed."""
BETTER = 0.9
"""A later lens is taken if it leaves less than this part of what the one before it leaves."""

Choice = TypeVar("Choice")


def by_field(wide: Sequence[Choice], narrow: Sequence[Choice], ray: NDArray[np.float64]) -> list[Sequence[Choice]]:
    """Lenses in groups, those first that suit a camera with such rays (N, 3), of length one; nan where there is none.

    Where it sees far off its axis the others are tried only if there are no wide ones.
    """
    return [group for group in ([wide or narrow] if sees_far(ray) else [narrow, wide]) if group]


def sees_far(ray: NDArray[np.float64]) -> bool:
    """Whether some of the rays (N, 3), of length one, come from so far off the axis that a wide lens suits."""
    return bool((ray[:, 2] < FAR_COSINE).any())


def try_fits(groups: Sequence[Sequence[Choice]], fit: Callable[[Choice], Refit]) -> list[tuple[Choice, Refit]]:
    """Fits until one leaves no large difference anywhere: the first is the one that most programs read.

    Raises:
        InputError: none can be fitted; why the first cannot.
    """
    tried: list[tuple[Choice, Refit]] = []
    refused: InputError | None = None
    for group in groups:
        for choice in group:
            try:
                tried.append((choice, fit(choice)))
            except InputError as error:
                refused = refused or error
                continue
            if tried[-1][1].max_px <= LARGE_PX:
                return tried
    if not tried and refused is not None:
        raise refused
    return tried


def closest(tried: Sequence[tuple[Choice, Refit]]) -> tuple[Choice, Refit]:
    """The first that no later one is clearly better than."""
    best, *others = tried
    for one in others:
        if one[1].rms_px < BETTER * best[1].rms_px:
            best = one
    return best
