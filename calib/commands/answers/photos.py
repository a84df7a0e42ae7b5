"""Answers of commands that look at photos: what was found in each, and where the camera stood."""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from calib.api.searching import Search
    from calib.observe.photos import PhotoResult
    from calib.pipeline.target_poses import TargetPose
    from designer.base.answer import Value
    from designer.target import TargetGeometry


def detections_answer(search: "Search") -> "dict[str, Value]":
    """Sums, and the counts of each photo with the reasons of what is missing."""
    from calib.commands.photo_table import expected_features

    seen = search.detections
    return {
        "target_id": search.target.geometry_id,
        "layout_id": search.target.layout_id,
        "photos": len(search.results),
        "searched": len(seen),
        "with_target": len(search.with_target),
        "found": sum(len(one.ring) for one in seen),
        "expected": sum(expected_features(one) for one in seen),
        "failures": list(search.failures),
        "overlays_left_out": search.overlays_left_out,
        "seconds": search.seconds,
        "per_photo": [_photo(result) for result in search.results],
    }


def _photo(result: "PhotoResult") -> "dict[str, Value]":
    from calib.commands.photo_table import expected_features, median_sigma_px, missing_of

    seen = result.seen
    if seen is None:
        return {"image": result.photo.name, "path": str(result.photo.path), "failure": result.failure}
    return {
        "image": result.photo.name,
        "path": str(result.photo.path),
        "failure": None,
        "image_size_px": seen.image_size,
        "found": len(seen.ring),
        "expected": expected_features(seen),
        "faces": sorted(record.face for record in seen.faces if record.face is not None),
        "missing": missing_of(seen),
        "median_sigma_px": median_sigma_px(seen),
        "remarks": [*seen.remarks, *filter(None, [result.overlay_failure])],
    }


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
