"""How the target was shown in each photo: tilt, distance, place and size in the image, and what is left over."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calib.solver.calibration import Calibration
from calib.verdict.next_view_target import TargetShape, shape_of

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class ViewFacts:
    """Facts of V views; nan where a view tells none."""

    name: tuple[str, ...]  # (V,)
    rings: NDArray[np.int64]  # (V,) sightings that count
    left_out: NDArray[np.int64]  # (V,) sightings left out as outliers
    tilt_deg: Array  # (V, 3) of the seen faces against the image plane: least, median by rings, largest
    distance_mm: Array  # (V,) from the camera to the target's middle
    place_px: Array  # (V, 2) mean of the sightings
    size: Array  # (V,) of the sightings' box: of the image's width or height, whichever it fills more of
    rms_px: Array  # (V,) root mean square length of the residuals that count
    is_flat: bool  # all rings in one plane, so that the three tilts are one

    @property
    def distance_ratio(self) -> float:
        """The largest distance over the least."""
        return float(self.distance_mm.max() / self.distance_mm.min())

    @property
    def largest_tilt_deg(self) -> float:
        """The largest tilt of all faces in all views; nan without planes."""
        known = self.tilt_deg[np.isfinite(self.tilt_deg[:, 2]), 2]
        return float(known.max()) if len(known) else float("nan")

    def tilted_by(self, least_deg: float) -> int:
        """How many views show a face tilted by so much or more."""
        return int((self.tilt_deg[:, 2] >= least_deg).sum())


def view_facts(calibration: Calibration) -> ViewFacts:
    """The facts of all views of a calibration."""
    seen, counted = calibration.observations, ~calibration.is_outlier
    views = seen.view_count
    shape = shape_of(calibration)
    pose = calibration.cam_from_target
    points = seen.points.position_mm
    middle = 0.5 * (points.min(axis=0) + points.max(axis=0)) if shape is None else shape.center_mm
    view, pixel = seen.view[counted], seen.center_px[counted]
    rings = np.bincount(view, minlength=views)
    low, high = np.full((views, 2), np.inf), np.full((views, 2), -np.inf)
    np.minimum.at(low, view, pixel)
    np.maximum.at(high, view, pixel)
    square = (calibration.residual_px[counted] ** 2).sum(axis=1)
    some = np.where(rings > 0, rings, np.nan)
    return ViewFacts(
        seen.view_names,
        rings,
        np.bincount(seen.view[~counted], minlength=views),
        _tilts_deg(calibration, shape),
        np.linalg.norm(pose[:, :3, :3] @ middle + pose[:, :3, 3], axis=1),
        np.stack([np.bincount(view, pixel[:, k], views) for k in range(2)], axis=1) / some[:, None],
        np.where(rings > 0, ((high - low) / seen.image_size).max(axis=1), np.nan),
        np.sqrt(np.bincount(view, square, views) / some),
        shape is not None and shape.is_flat,
    )


def _tilts_deg(calibration: Calibration, shape: TargetShape | None) -> Array:
    """Angles (V, 3) between the normals of the faces that were seen and the optical axis: least, median, largest."""
    seen, counted = calibration.observations, ~calibration.is_outlier
    result = np.full((seen.view_count, 3), np.nan)
    if shape is None:
        return result
    face = seen.points.face[seen.point]
    counted = counted & (face >= 0)
    cosine = -(calibration.cam_from_target[:, None, 2, :3] * shape.normal).sum(axis=-1)  # (V, F)
    tilt = np.degrees(np.arccos(np.clip(cosine, -1.0, 1.0)))[seen.view[counted], face[counted]]
    view = seen.view[counted]
    for one in np.unique(view).tolist():
        mine = tilt[view == one]
        result[one] = mine.min(), np.median(mine), mine.max()
    return result
