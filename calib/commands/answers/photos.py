"""Answers of commands that look at photos: what was found in each, and where the camera stood."""

import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from calib.detect.batch import FoundPhotos, PhotoResult
    from calib.pose import TargetPose
    from calib.types import Detections
    from designer.answer import Value
    from designer.target import TargetGeometry


def detections_answer(
    geometry: "TargetGeometry", found: "FoundPhotos", results: "Sequence[PhotoResult]", seconds: float
) -> "dict[str, Value]":
    """Sums, and the counts of each photo with the reasons of what is missing."""
    seen = [result.seen for result in results if result.seen is not None]
    return {
        "target_id": geometry.geometry_id,
        "layout_id": geometry.layout_id,
        "photos": len(results),
        "searched": len(seen),
        "with_target": sum(bool(len(one.ring)) for one in seen),
        "found": sum(len(one.ring) for one in seen),
        "expected": sum(expected_features(one) for one in seen),
        "failures": [*found.failures, *(result.failure for result in results if result.failure)],
        "overlays_left_out": found.overlays,
        "seconds": seconds,
        "per_photo": [_photo(result) for result in results],
    }


def _photo(result: "PhotoResult") -> "dict[str, Value]":
    seen = result.seen
    if seen is None:
        return {"image": result.photo.name, "path": str(result.photo.path), "failure": result.failure}
    missing: dict[str, int] = {}
    for record in seen.faces:
        for reason, count in record.missing if record.face is not None else ():
            missing[reason] = missing.get(reason, 0) + count
    return {
        "image": result.photo.name,
        "path": str(result.photo.path),
        "failure": None,
        "image_size_px": seen.image_size,
        "found": len(seen.ring),
        "expected": expected_features(seen),
        "faces": sorted(record.face for record in seen.faces if record.face is not None),
        "missing": missing,
        "median_sigma_px": median_sigma_px(seen),
        "remarks": [*seen.remarks, *filter(None, [result.overlay_failure])],
    }


def expected_features(one: "Detections") -> int:
    """How many features of the named faces could have been measured."""
    from calib.inputs.records import measurable

    return sum(measurable(record) for record in one.faces if record.face is not None)


def median_sigma_px(one: "Detections") -> float:
    """Median of the centres' standard deviations, along their worse axis; nan without centres."""
    import numpy as np

    if not len(one.ring):
        return math.nan
    return float(np.median(np.sqrt(np.linalg.eigvalsh(one.cov_px2)[:, 1])))


def poses_answer(
    geometry: "TargetGeometry",
    results: "Sequence[PhotoResult]",
    poses: "Mapping[str, TargetPose]",
    reasons: Mapping[str, str],
    failures: Sequence[str],
) -> "dict[str, Value]":
    """The pose of each photo with its standard deviations, or why there is none."""
    return {
        "target_id": geometry.geometry_id,
        "photos": len(results),
        "with_pose": len(poses),
        "failures": list(failures),
        "poses": [_pose(one) for one in poses.values()],
        "without_pose": [{"image": image, "reason": reason} for image, reason in reasons.items()],
    }


def _pose(one: "TargetPose") -> "dict[str, Value]":
    return {
        "image": one.image,
        "rings": one.rings,
        "rms_px": one.rms_px,
        "camera_mm": one.camera_mm.tolist(),
        "camera_sigma_mm": one.camera_sigma_mm.tolist(),
        "distance_mm": one.distance_mm,
        "distance_sigma_mm": one.distance_sigma_mm,
        "rotation_sigma_rad": one.rotation_sigma_rad,
        "cam_from_target": one.cam_from_target.tolist(),
        "covariance": one.covariance.tolist(),
    }
