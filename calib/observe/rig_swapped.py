"""Cameras whose photos were taken for each other's: each given lens fits what another camera saw."""

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from calib.cameras.camera import Camera
from calib.core.types import Observations, RigObservations, keep_views, sightings_per_view
from calib.solver.start import solve_poses
from designer.base.words import shown

MOST_VIEWS = 8
"""Of a camera that are looked at: those that show most."""
MUCH_LESS = 0.8
"""Both lenses leave less than this share of what they leave in the photos they were given for."""


@dataclass(frozen=True)
class _Left:
    """What lenses leave over (root mean square, px) in the photos of two cameras."""

    own: tuple[float, float]
    crossed: tuple[float, float]

    @property
    def is_swapped(self) -> bool:
        return all(crossed < MUCH_LESS * own for own, crossed in zip(self.own, self.crossed, strict=True))


def swapped_cameras(observations: RigObservations, given: Mapping[str, Camera]) -> tuple[str, ...]:
    """A line on each two cameras whose lenses fit each other's photos better than their own."""
    rows = {name: row for row, name in enumerate(observations.camera_names) if name in given}
    few = {name: _few_views(observations.sightings[row]) for name, row in rows.items()}
    said = []
    for a, b in combinations(rows, 2):
        if few[a].image_size != few[b].image_size:
            continue
        left = _Left(
            (_left_px(given[a], few[a]), _left_px(given[b], few[b])),
            (_left_px(given[b], few[a]), _left_px(given[a], few[b])),
        )
        if left.is_swapped:
            said.append(
                f"the photos of {shown(a)} and {shown(b)} fit each other's lens: {left.crossed[0]:.3g} and "
                f"{left.crossed[1]:.3g} px are left over, against {left.own[0]:.3g} and {left.own[1]:.3g} px; their "
                "folders, or their camera files, may be swapped"
            )
    return tuple(said)


def _few_views(seen: Observations) -> Observations:
    most = np.argsort(-sightings_per_view(seen), kind="stable")[:MOST_VIEWS]
    return keep_views(seen, np.isin(np.arange(seen.view_count), most))


def _left_px(camera: Camera, seen: Observations) -> float:
    """The median view's residual by a lens, its pose free; infinite if no pose is found."""
    residual_px = solve_poses(camera, seen, weighted=False).residual_px
    squares = np.bincount(seen.view, (residual_px**2).sum(axis=1), minlength=seen.view_count)
    rms_px = np.sqrt(squares / np.maximum(sightings_per_view(seen), 1))
    return float(np.median(np.where(np.isfinite(rms_px), rms_px, np.inf)))
