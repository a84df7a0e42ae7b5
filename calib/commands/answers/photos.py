"""Answers of commands that look at photos: what was found in each, and where the camera stood."""

from typing import TYPE_CHECKING, cast

if TYPE_CHECKING:
    from calib.observe.photos import PhotoResult, Search
    from calib.observe.target_poses import PoseResult, TargetPose
    from designer.base.answer import Value


def detections_answer(search: "Search") -> "dict[str, Value]":
    """Sums, and the counts of each photo with the reasons of what is missing."""
    found, expected = search.counts
    return {
        "target_id": search.target.geometry_id,
        "layout_id": search.target.layout_id,
        "photos": len(search.results),
        "searched": len(search.detections),
        "with_target": len(search.with_target),
        "found": found,
        "expected": expected,
        "failures": list(search.failures),
        "overlays_left_out": search.overlays_left_out,
        "seconds": search.seconds,
        "per_photo": [_photo(result) for result in search.results],
    }


def _photo(result: "PhotoResult") -> "dict[str, Value]":
    from calib.observe.records import median_sigma_px

    seen, record = result.seen, result.record
    head: dict[str, Value] = {"image": result.photo.name, "path": str(result.photo.path)}
    if seen is None:
        return {**head, "failure": result.failure}
    return {
        **head,
        "failure": None,
        "image_size_px": seen.image_size,
        "found": record.features,
        "expected": record.expected,
        "faces": sorted(face.face for face in record.named if face.face is not None),
        "missing": dict(record.missing),
        "median_sigma_px": median_sigma_px(seen),
        "remarks": [*seen.remarks, *filter(None, [result.overlay_failure])],
    }


def poses_answer(found: "PoseResult") -> "dict[str, Value]":
    """The pose of each photo with its standard deviations, or why there is none."""
    return {
        "target_id": found.target.geometry_id,
        "photos": len(found.search.results),
        "with_pose": len(found.poses),
        "failures": list(found.search.failures),
        "poses": [_pose(one) for one in found.poses],
        "without_pose": [{"image": one.image, "reason": one.reason} for one in found.without_pose],
    }


def _pose(one: "TargetPose") -> "dict[str, Value]":
    """As `poses.json` has it, under the photo's name."""
    from calib.observe.target_poses import TargetPose
    from designer.base.codec import encode

    keys = cast("dict[str, Value]", encode(TargetPose, one))
    return {"image": one.image, **{key: value for key, value in keys.items() if key != "file"}}
