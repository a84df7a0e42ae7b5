"""What several cameras saw of one target, put together: each camera's views are frames of the rig."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import combinations

import numpy as np

from calib.cameras.camera import Camera
from calib.core.types import Observations, RigObservations, keep_frames, keep_views, sightings_per_view
from calib.observe.mirrored import CLEAR_SHARE, facing
from calib.solver.start import solve_poses
from designer.base.errors import InputError
from designer.base.words import first_few, shown

MOST_NAME = 100
SAME_PICTURE_PX = 1e-3
"""Two cameras whose centres differ by less in all that both see are one camera twice."""
MOST_VIEWS = 8
"""Of a camera whose lens is tried on another's photos: those that show most."""
MUCH_LESS = 0.8
"""Both lenses of two cameras leave less than this share of what they leave in the photos they were given for."""


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
        names = tuple(one.seen.view_names[view] for view in order.tolist())
        view = np.argsort(order)[one.seen.view]
        rows = np.argsort(view, kind="stable")
        cov_px2 = None if one.seen.cov_px2 is None else one.seen.cov_px2[rows]
        parts.append(
            replace(
                one.seen, view_names=names, view=view[rows], point=one.seen.point[rows],
                center_px=one.seen.center_px[rows], cov_px2=cov_px2, remarks=(),
            )
        )  # fmt: skip
        frames.append(frame[order])
        times.append(np.array([one.time_s.get(name, np.nan) for name in names]))
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
        one, other = every.sightings[a], every.sightings[b]
        if one.image_size != other.image_size:
            continue
        common, in_a, in_b = np.intersect1d(every.frame[a], every.frame[b], return_indices=True)
        if not len(common):
            continue
        for view_a, view_b in zip(in_a.tolist(), in_b.tolist(), strict=True):
            rows_a, rows_b = one.view == view_a, other.view == view_b
            if not np.array_equal(one.point[rows_a], other.point[rows_b]):
                break
            if np.abs(one.center_px[rows_a] - other.center_px[rows_b]).max(initial=0) >= SAME_PICTURE_PX:
                break
        else:
            raise InputError(
                f"cameras {shown(every.camera_names[a])} and {shown(every.camera_names[b])} show the same pictures; "
                "give each camera its own photos"
            )


def _mirrored_cameras(every: RigObservations) -> tuple[str, ...]:
    """A word on cameras that see a flat target from the other side than most: their photos may be flipped."""
    if len(every.points.plane) != 1 or (every.points.face != 0).any():
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
    return first_few([shown(name) for name in names])


def swapped_cameras(observations: RigObservations, given: Mapping[str, Camera]) -> tuple[str, ...]:
    """A line on each two cameras whose lenses fit each other's photos better than their own."""
    rows = {name: row for row, name in enumerate(observations.camera_names) if name in given}
    few: dict[str, Observations] = {}
    for name, row in rows.items():
        seen = observations.sightings[row]
        most = np.argsort(-sightings_per_view(seen), kind="stable")[:MOST_VIEWS]
        few[name] = keep_views(seen, np.isin(np.arange(seen.view_count), most))
    said = []
    for a, b in combinations(rows, 2):
        if few[a].image_size != few[b].image_size:
            continue
        own_px = _left_px(given[a], few[a]), _left_px(given[b], few[b])
        crossed_px = _left_px(given[b], few[a]), _left_px(given[a], few[b])
        if all(crossed < MUCH_LESS * own for own, crossed in zip(own_px, crossed_px, strict=True)):
            said.append(
                f"the photos of {shown(a)} and {shown(b)} fit each other's lens: {crossed_px[0]:.3g} and "
                f"{crossed_px[1]:.3g} px are left over, against {own_px[0]:.3g} and {own_px[1]:.3g} px; their "
                "folders, or their camera files, may be swapped"
            )
    return tuple(said)


def _left_px(camera: Camera, seen: Observations) -> float:
    """The median view's residual by a lens, its pose free; infinite if no pose is found."""
    residual_px = solve_poses(camera, seen, weighted=False).residual_px
    squares = np.bincount(seen.view, (residual_px**2).sum(axis=1), minlength=seen.view_count)
    rms_px = np.sqrt(squares / np.maximum(sightings_per_view(seen), 1))
    return float(np.median(np.where(np.isfinite(rms_px), rms_px, np.inf)))


def alone_as_rig(name: str, seen: Observations) -> RigObservations:
    """What one camera saw as a rig's: a frame a view."""
    return RigObservations(
        (name,), seen.view_names, (replace(seen, remarks=()),), (np.arange(seen.view_count),), None, seen.remarks
    )


def with_remarks(observations: RigObservations, remarks: Iterable[str]) -> RigObservations:
    """The observations with a few more lines on them."""
    return replace(observations, remarks=tuple(dict.fromkeys((*observations.remarks, *remarks))))
