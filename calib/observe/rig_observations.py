"""What several cameras saw of one target, put together: each camera's views are frames of the rig."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from calib.core.types import KnownPoints, Observations, RigObservations, keep_frames
from calib.observe.mirrored import CLEAR_SHARE, facing
from designer.base.errors import InputError
from designer.base.words import shown

MOST_NAME = 100
SAME_PICTURE_PX = 1e-3
"""Two cameras whose centres differ by less in all that both see are one camera twice."""
_NAMED = 4


@dataclass(frozen=True, eq=False)
class RigSightings:
    """What one camera of a rig saw."""

    name: str
    seen: Observations  # its views, each named
    frame: Mapping[str, str]  # of each view's name
    time_s: Mapping[str, float] = field(default_factory=dict)  # likewise; {}: no time stamps


def rig_observations(
    cameras: Sequence[RigSightings], frame_names: Sequence[str], remarks: Sequence[str] = (), *, fewest: int = 2
) -> RigObservations:
    """The sightings of all cameras as one; frames that no camera has a view of are left out.

    Args:
        cameras: of the rig, which saw the same points.
        frame_names: of all frames, in their order.
        remarks: on the whole.
        fewest: so many cameras there must be.

    Raises:
        InputError: names that cannot be, or the same pictures from two cameras.
    """
    require_names([one.name for one in cameras], fewest)
    number = {name: row for row, name in enumerate(frame_names)}
    parts, frames, times = [], [], []
    for one in cameras:
        frame = np.array([number[one.frame[view]] for view in one.seen.view_names], dtype=np.int64)
        order = np.argsort(frame, kind="stable")
        parts.append(replace(_in_order_of(one.seen, order), remarks=()))
        frames.append(frame[order])
        times.append(np.array([one.time_s.get(one.seen.view_names[view], np.nan) for view in order.tolist()]))
    said = (*remarks, *(f"{one.name}: {remark}" for one in cameras for remark in one.seen.remarks))
    is_timed = all(np.isfinite(stamps).all() for stamps in times)
    every = RigObservations(
        tuple(one.name for one in cameras), tuple(frame_names), tuple(parts), tuple(frames),
        tuple(times) if is_timed else None, tuple(dict.fromkeys(said)),
    )  # fmt: skip
    _require_different_pictures(every)
    every = replace(every, remarks=(*every.remarks, *_mirrored_cameras(every)))
    is_seen = np.zeros(len(frame_names), dtype=bool)
    for rows in every.frame:
        is_seen[rows] = True
    return keep_frames(every, is_seen)


def _in_order_of(seen: Observations, order: NDArray[np.int64]) -> Observations:
    """The same with the views in another order."""
    place = np.argsort(order)
    view = place[seen.view]
    rows = np.argsort(view, kind="stable")
    return replace(
        seen,
        view_names=tuple(seen.view_names[row] for row in order.tolist()),
        view=view[rows],
        point=seen.point[rows],
        center_px=seen.center_px[rows],
        cov_px2=None if seen.cov_px2 is None else seen.cov_px2[rows],
    )


def require_names(names: Sequence[str], fewest: int = 2) -> None:
    """Refuse names that two cameras have, those that no folder can have, and a single one if that is too few.

    Raises:
        InputError: the message shows the name.
    """
    known: dict[str, str] = {}
    for name in names:
        is_fit = name.isprintable() and not set(name) & set('/\\:*?"<>|') and name.strip(" .") == name
        if not is_fit or not 1 <= len(name) <= MOST_NAME:
            raise InputError(
                f"camera {shown(name)}: no name for a camera; take one to {MOST_NAME} letters, digits, - or _"
            )
        other = known.setdefault(name.casefold(), name)
        if other != name or names.count(name) > 1:
            raise InputError(f"two cameras are named {shown(other)} and {shown(name)}; give each its own name")
    if len(names) == 1 < fewest:
        raise InputError(f"one camera, {shown(names[0])}; a rig has two or more (calib run calibrates one)")


def _require_different_pictures(every: RigObservations) -> None:
    """Refuse a camera that is another one once more.

    Raises:
        InputError: two cameras show the same pictures.
    """
    for a, b in combinations(range(every.camera_count), 2):
        common, in_a, in_b = np.intersect1d(every.frame[a], every.frame[b], return_indices=True)
        if len(common) and all(
            _is_same_picture(every.sightings[a], view_a, every.sightings[b], view_b)
            for view_a, view_b in zip(in_a.tolist(), in_b.tolist(), strict=True)
        ):
            raise InputError(
                f"cameras {shown(every.camera_names[a])} and {shown(every.camera_names[b])} show the same pictures; "
                "give each camera its own photos"
            )


def _is_same_picture(a: Observations, view_a: int, b: Observations, view_b: int) -> bool:
    in_a, in_b = a.view == view_a, b.view == view_b
    return (
        a.image_size == b.image_size
        and np.array_equal(a.point[in_a], b.point[in_b])
        and bool(np.abs(a.center_px[in_a] - b.center_px[in_b]).max(initial=0) < SAME_PICTURE_PX)
    )


def _mirrored_cameras(every: RigObservations) -> tuple[str, ...]:
    """A word on cameras that see a flat target from the other side than most: their photos may be flipped."""
    points: KnownPoints = every.points
    if len(points.plane) != 1 or (points.face != 0).any():
        return ()
    share = [np.nanmedian(side) if np.isfinite(side := facing(seen)).any() else 0.0 for seen in every.sightings]
    side = np.where(np.abs(share) > CLEAR_SHARE, np.sign(share), 0)
    if side.sum() == 0 or not (side * np.sign(side.sum()) < 0).any():
        return ()
    odd = [name for name, one in zip(every.camera_names, side * np.sign(side.sum()), strict=True) if one < 0]
    return (
        f"{', '.join(odd)} {'see' if len(odd) > 1 else 'sees'} the target mirrored, or from behind, against the other "
        "cameras: flip the photos back if they were flipped",
    )


def some(names: Sequence[str]) -> str:
    """The first names, and how many more there are."""
    more = f" and {len(names) - _NAMED} more" if len(names) > _NAMED else ""
    return ", ".join(map(shown, names[:_NAMED])) + more
