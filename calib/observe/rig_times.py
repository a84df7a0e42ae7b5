"""Photos of several cameras joined to frames by their time stamps, each photo once."""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from calib.core.time_stamps import stamps_s
from calib.observe.rig_photos import RigPhoto, RigPhotos, framed
from designer.base.arrays import Array
from designer.base.errors import InputError


def stamped_by_name(photos: Sequence[RigPhoto]) -> tuple[RigPhoto, ...]:
    """Photos that are named by the time of their taking, with time stamps; as they are if others are among them.

    Names of 16 to 19 digits are seconds since 1970 of ten digits and a fraction. Those that all cameras have alike need
    no clock.
    """
    stamps = stamps_s([photo.path.name for photo in photos])
    of_camera = [{one.path.stem for one in photos if one.camera == name} for name in {one.camera for one in photos}]
    if stamps is None or set.intersection(*of_camera):
        return tuple(photos)
    return tuple(replace(photo, time_s=time_s) for photo, time_s in zip(photos, stamps[0].tolist(), strict=True))


def joined_by_time(photos: Sequence[RigPhoto], tolerance_s: float) -> RigPhotos:
    """Photos of different cameras that were taken within a tolerance are a frame, the nearest ones first.

    Frames are named by the time of their first photo. What is joined does not depend on the order of the photos.

    Args:
        photos: each with its time stamp.
        tolerance_s: that all photos of a frame lie within.

    Raises:
        InputError: no two photos lie so near.
    """
    cameras = list(dict.fromkeys(photo.camera for photo in photos))
    photos = sorted(photos, key=lambda one: (one.time_s or 0.0, one.camera, str(one.path)))
    time_s = np.array([photo.time_s for photo in photos], dtype=np.float64)
    frame = _joined(time_s, [photo.camera for photo in photos], tolerance_s)
    first: dict[int, int] = {}
    for row, one in enumerate(frame):
        first.setdefault(one, row)
    count = np.bincount(frame, minlength=len(photos))
    if count.max() < 2:
        raise InputError(_why_none(photos, time_s, tolerance_s))
    start_s = float(time_s[0])
    names = {one: f"{time_s[row] - start_s:.6f}s" for one, row in first.items()}
    if len(set(names.values())) < len(names):
        names = {one: f"{place + 1:06d}" for place, one in enumerate(first)}
    named = [replace(photo, frame=names[one]) for photo, one in zip(photos, frame, strict=True)]
    found = framed(sorted(named, key=lambda photo: cameras.index(photo.camera)))
    order = tuple(names[one] for one in first)
    return replace(found, frame_names=order, remarks=tuple(_said(time_s, np.array(frame), photos, tolerance_s)))


def _joined(time_s: Array, cameras: Sequence[str], tolerance_s: float) -> list[int]:
    """The frame of each photo: the row of one of its photos.  # (N,)"""
    parent = list(range(len(time_s)))
    members: dict[int, list[int]] = {row: [row] for row in parent}
    for first, second in _links(time_s, cameras, tolerance_s):
        a, b = parent[first], parent[second]
        both = members[a] + members[b] if a != b else []
        names = [cameras[row] for row in both]
        if not both or len(set(names)) < len(names) or np.ptp(time_s[both]) > tolerance_s:
            continue
        for row in members.pop(b):
            parent[row] = a
        members[a] = both
    return parent


def _links(time_s: Array, cameras: Sequence[str], tolerance_s: float) -> list[tuple[int, int]]:
    """Pairs of photos of two cameras, each nearest to the other before or after it, the nearest pairs first."""
    rows_of: dict[str, NDArray[np.int64]] = {
        name: np.array([row for row, one in enumerate(cameras) if one == name]) for name in sorted(set(cameras))
    }
    pairs: set[tuple[int, int]] = set()
    for a, b in combinations(rows_of.values(), 2):
        after = np.searchsorted(time_s[b], time_s[a])
        for step in (-1, 0):
            near = b[np.clip(after + step, 0, len(b) - 1)]
            ok = np.abs(time_s[a] - time_s[near]) <= tolerance_s
            pairs.update(zip(a[ok].tolist(), near[ok].tolist(), strict=True))
    return sorted(pairs, key=lambda pair: (abs(time_s[pair[0]] - time_s[pair[1]]), min(pair), max(pair)))


def _said(time_s: Array, frame: NDArray[np.int64], photos: Sequence[RigPhoto], tolerance_s: float) -> Iterator[str]:
    """How far apart the photos of a frame lie, and how many have no partner."""
    _, place, count = np.unique(frame, return_inverse=True, return_counts=True)
    low, high = np.full(len(count), np.inf), np.full(len(count), -np.inf)
    np.minimum.at(low, place, time_s)
    np.maximum.at(high, place, time_s)
    apart_ms = 1e3 * (high - low)[count > 1]
    yield (
        f"joined by time stamps: {len(apart_ms)} frames of two cameras or more, their photos "
        f"{np.median(apart_ms):.3g} ms apart (median), {apart_ms.max():.3g} ms at most"
    )
    if alone := int((count == 1).sum()):
        yield f"{alone} of {len(photos)} photos have none of another camera within {1e3 * tolerance_s:g} ms"
    steps = [np.diff([one.time_s for one in photos if one.camera == name]) for name in {one.camera for one in photos}]
    least_s = min((float(step.min()) for step in steps if len(step)), default=np.inf)
    if tolerance_s > 0.5 * least_s:
        yield (
            f"the tolerance, {1e3 * tolerance_s:g} ms, is more than half of the {1e3 * least_s:.3g} ms between two "
            "photos of a camera: which of them a frame takes may be chance"
        )


def _why_none(photos: Sequence[RigPhoto], time_s: Array, tolerance_s: float) -> str:
    """No frame: how far the clocks are apart."""
    spans = []
    for name in dict.fromkeys(photo.camera for photo in photos):
        own = [one for one, photo in zip(time_s.tolist(), photos, strict=True) if photo.camera == name]
        spans.append(f"{name} from {min(own):.6g} to {max(own):.6g} s")
    return (
        f"no photos of two cameras lie within {1e3 * tolerance_s:g} ms of each other: {'; '.join(spans)}; give a "
        "larger --tolerance, or set the clocks right"
    )
