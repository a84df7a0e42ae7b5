"""How large a single error would have to be to give the paper's intersection error all alone, and what else it gives.

The square of an error metric grows as `m0^2 + f^2 c^2` with the multiple f of a source's numbers, so the multiple is
found by a few solutions, each correcting the last; large errors included.
"""

import math
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from calib.cameras import COMMON
from calib.studies.compare.photographed import MetricRow, calibrate_with, metrics_of
from calib.studies.compare.scene import ScenePool, stream, take_photos
from calib.studies.sample import SampleResult, failed_sample
from designer.base.errors import InputError
from designer.tolerance.model import ErrorModel, displaced_shape, draw_values
from designer.tolerance.shape import centers_mm

Array = NDArray[np.float64]

KIND = "compare alone"
VALUES = ("multiple",)
"""How large the source's numbers are, root mean square, over its amount; the errors are those at it."""
NOISE = "noise"
"""The detector's, as a source of errors; what is made is as drawn."""
TOGETHER = "all together"
"""All sources of a model, scaled alike."""
STEPS = 6
CLOSE = 0.005
LEAST_PART, LEAST_EFFECT = 0.05, 1e-6
"""Of the square of what noise gives, and of the wanted error: a source that adds less has no effect."""
NO_EFFECT = "has no effect: poses or contours take it up"
MOST_MULTIPLE = 1e6


@dataclass(frozen=True, eq=False)
class OneSource(ScenePool):
    """Prints with one source of errors, scaled until a set of photos has the intersection error that is wanted."""

    kind: ClassVar[str] = KIND
    values: ClassVar[tuple[str, ...]] = VALUES
    errors: ErrorModel
    source: str  # of the model, `NOISE` or `TOGETHER`
    wanted_mm: float

    def sample(self, seed: int, number: int) -> SampleResult:
        """The print of a number."""
        try:
            multiple, row = self._search(seed, number)
        except InputError as error:
            return failed_sample(number, 0, self.value_count, str(error))
        size = multiple * self._drawn_size(seed, number)
        is_met = abs(row.intersection_mm / self.wanted_mm - 1) < 4 * CLOSE
        return SampleResult(
            number, "converged" if is_met else "stopped", self.scene.views, *row, math.nan, (size,), 0,
            "" if is_met else "no multiple gives the error that is wanted",
        )  # fmt: skip

    def _search(self, seed: int, number: int) -> tuple[float, MetricRow]:
        """The multiple and the errors at it.

        Raises:
            InputError: no effect, or no target or camera is left at the size it takes.
        """
        rest = self._errors(seed, number, 0.0).intersection_mm ** 2
        multiple = 1.0
        for _ in range(STEPS):
            row = self._errors(seed, number, multiple)
            extra = row.intersection_mm**2 - rest
            if not extra > max(LEAST_PART * rest, (LEAST_EFFECT * self.wanted_mm) ** 2):
                raise InputError(f"{self.source} {NO_EFFECT}")
            step = math.sqrt((self.wanted_mm**2 - rest) / extra)
            if abs(step - 1) < CLOSE:
                break
            multiple = min(multiple * step, MOST_MULTIPLE)
        return multiple, row

    def _errors(self, seed: int, number: int, multiple: float) -> MetricRow:
        scene, noise = self.scene, multiple if self.source == NOISE else 1.0
        photos = stream(seed, scene.name, number, 0)
        return metrics_of(
            calibrate_with(take_photos(scene, self._made(seed, number, multiple), photos, scene.views, noise), COMMON)
        )

    def _drawn_size(self, seed: int, number: int) -> float:
        """Root mean square of the numbers that were drawn, over their standard deviation: few of them scatter."""
        if self.source in (NOISE, TOGETHER):
            return 1.0
        sigma = self.errors.amount(self.source).sigma
        return float(np.sqrt((self._values(seed, number)[self.source] ** 2).mean()) / sigma)

    def _values(self, seed: int, number: int) -> dict[str, Array]:
        chosen = self.errors if self.source == TOGETHER else self.errors.only(self.source)
        return draw_values(self.scene.target, chosen, stream(seed, self.scene.name, number, "print"))

    def _made(self, seed: int, number: int, multiple: float) -> Array:
        nominal = self.scene.target
        if self.source == NOISE or multiple == 0:
            return np.asarray(nominal.center_mm)
        values = {name: multiple * drawn for name, drawn in self._values(seed, number).items()}
        return centers_mm(displaced_shape(nominal, values, model=self.errors))
