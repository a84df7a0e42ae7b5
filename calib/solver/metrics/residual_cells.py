"""What a camera leaves over, sorted into the cells of a grid over the image: their means show what is systematic."""

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from calib.core.linear_algebra import rms_length, sums_by
from calib.solver.metrics.evaluation import Evaluation
from designer.base.arrays import Array, Rows

MOST_COLUMNS, FEWEST_COLUMNS = 20, 4
WANTED_PER_CELL = 12
LONG_PERCENT = 95
LEAST_PER_CELL = 5
"""Fewer residuals than this have no mean worth an arrow."""


@dataclass(frozen=True, eq=False)
class ResidualCells:
    """Residuals in R x C cells of an image."""

    edge_u: Array  # (C + 1,)
    edge_v: Array  # (R + 1,)
    count: Rows  # (R, C)
    mean_px: Array  # (R, C, 2) nan where there are too few
    noise_px: float  # standard deviation of a residual's coordinate about the mean of its cell

    @cached_property
    def center_px(self) -> Array:
        """The middles of the cells.  # (R, C, 2)"""
        u, v = (self.edge_u[:-1] + self.edge_u[1:]) / 2, (self.edge_v[:-1] + self.edge_v[1:]) / 2
        return np.stack(np.meshgrid(u, v), axis=-1)

    @cached_property
    def length_px(self) -> Array:
        """The lengths of the means.  # (R, C)"""
        length: Array = np.hypot(self.mean_px[..., 0], self.mean_px[..., 1])
        return length

    @property
    def long_px(self) -> float:
        """A length that few means exceed, for scales that single cells do not set; 0 if no cell has a mean."""
        known = self.length_px[np.isfinite(self.length_px)]
        return float(np.percentile(known, LONG_PERCENT)) if len(known) else 0.0

    @property
    def rms_of_means_px(self) -> float:
        """Root mean square length of the cells' means; nan if no cell has one."""
        return rms_length(self.mean_px[self.count >= LEAST_PER_CELL])

    @property
    def rms_by_noise_px(self) -> float:
        """What the same would be if residuals were noise alone: each mean has the variance of noise over its count."""
        count = self.count[self.count >= LEAST_PER_CELL]
        return self.noise_px * math.sqrt(float((2 / count).mean())) if len(count) else math.nan


def columns_rows(image_size: tuple[int, int], sightings: int) -> tuple[int, int]:
    """How many cells, about square, for so many sightings in a cell on average."""
    width, height = image_size
    columns = math.sqrt(sightings / WANTED_PER_CELL * width / height)
    columns = int(min(max(columns, FEWEST_COLUMNS), MOST_COLUMNS))
    return columns, max(2, round(columns * height / width))


def cells_of(image_size: tuple[int, int], pixel: Array, residual_px: Array, shape: tuple[int, int]) -> ResidualCells:
    """Sort residuals (N, 2) at pixels (N, 2) into cells; what lies outside the image goes into the nearest."""
    columns, rows = shape
    edge_u, edge_v = (
        np.linspace(-0.5, image_size[0] - 0.5, columns + 1),
        np.linspace(-0.5, image_size[1] - 0.5, rows + 1),
    )
    column = np.clip(np.searchsorted(edge_u, pixel[:, 0], side="right") - 1, 0, columns - 1)
    row = np.clip(np.searchsorted(edge_v, pixel[:, 1], side="right") - 1, 0, rows - 1)
    cell = row * columns + column
    count = np.bincount(cell, minlength=rows * columns)
    total = sums_by(cell, residual_px, rows * columns)
    mean = total / np.where(count >= LEAST_PER_CELL, count, np.nan)[:, None]
    degrees = len(cell) - int((count > 0).sum())
    scatter = residual_px - (total / np.maximum(count, 1)[:, None])[cell]
    noise = math.sqrt(float((scatter**2).sum()) / (2 * degrees)) if degrees else math.nan
    return ResidualCells(edge_u, edge_v, count.reshape(rows, columns), mean.reshape(rows, columns, 2), noise)


@dataclass(frozen=True, eq=False)
class Residuals:
    """The residuals that count, and the places of those left out."""

    image_size: tuple[int, int]
    pixel: Array  # (N, 2)
    residual_px: Array  # (N, 2) predicted - measured
    outlier_px: Array  # (K, 2) where outliers are


def residuals_of(evaluation: Evaluation) -> Residuals:
    """The reprojection errors of an evaluation of all views."""
    errors, seen = evaluation.of("reprojection"), evaluation.calibration.observations
    if errors is None or errors.sighting is None:
        raise ValueError("an evaluation without reprojection errors has no residuals")
    pixel = seen.center_px[errors.sighting]
    counted = errors.is_counted
    return Residuals(
        seen.image_size, pixel[counted], errors.vector[counted], seen.center_px[evaluation.calibration.is_outlier]
    )


def cells_of_residuals(residuals: Residuals) -> ResidualCells:
    """Residuals in cells as fine as their number allows."""
    shape = columns_rows(residuals.image_size, len(residuals.pixel))
    return cells_of(residuals.image_size, residuals.pixel, residuals.residual_px, shape)
