"""What a camera is solved from: the observations that can be used, and one line on each kind that was left out."""

from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np

from calib.core.linear_algebra import rms_length, solve_square
from calib.core.types import (
    LEAST_POINTS,
    SUREST,
    Detections,
    KnownPoints,
    Observations,
    keep_views,
    with_sound_covariances,
)
from calib.observe.mirrored import mirrored_views
from designer.base.arrays import Array, Flags, Rows
from designer.base.errors import InputError
from designer.base.words import first_few
from designer.target import TargetGeometry

ON_A_LINE = 1e-3
"""Points this much thinner than long lie on a line."""
SAME_PX = 1e-3
"""Two views whose centres differ by less than this are one photo twice."""
ALIKE = (0.05, 0.06)
"""Copies of one photo, saved again: root mean square difference in px, and mean square over what noise would give."""
LEAST_PHOTOS = 2
"""That must show a piece in another's place; one may be misread."""
_CELL_PX = 0.5
_NEIGHBOURS = 8
"""Views that see a point at the same place and are compared with each other; from a tripod there may be many."""
MANY = 0.25
"""What the detector says of so large a share of the photos stands with what is solved from them."""


def known_points(target: TargetGeometry) -> KnownPoints:
    """A target's features and the planes of its faces, normals outwards."""
    normal, origin = target.target_from_face[:, :3, 2], target.target_from_face[:, :3, 3]
    plane = np.column_stack([normal, (normal * origin).sum(axis=1)])
    return KnownPoints(target.center_mm, target.ring_face, plane, target.geometry_id, turned=_turned(target))


def _turned(target: TargetGeometry) -> Rows | None:
    """See `KnownPoints.turned`."""
    if target.marks is None or not target.is_planar or target.marks[0].alike == 1:
        return None
    at, parts = target.marks[0].position_mm, target.marks[0].alike
    angle = 2 * np.pi / parts * np.arange(parts)
    c, s = np.cos(angle)[:, None], np.sin(angle)[:, None]
    moved = np.stack([c * at[:, 0] - s * at[:, 1], s * at[:, 0] + c * at[:, 1]], axis=2)
    return np.asarray(np.linalg.norm(moved[:, :, None] - at, axis=3).argmin(axis=2))


def knows_fronts(target: TargetGeometry | None) -> bool:
    """Whether the planes of a target's faces look to the side that is seen: of one of ours they do.

    Of points that others made the planes are fitted, and may look either way.
    """
    return target is not None and target.spec is not None


def observations_from_detections(
    seen: Sequence[Detections], target: TargetGeometry, *, origin: str = "detections"
) -> Observations:
    """The observations of a target's rings that can be used. X, Y, Z are those of the target in use.

    Args:
        seen: in photos of one target.
        target: of the same layout, nominal or measured.
        origin: what messages name: the file.

    Raises:
        InputError: no view can be used, or it is not clear which; the message says why.
        ValueError: the target has another layout.
    """
    if not seen:
        raise InputError(f"{origin}: no photo was searched; give photos that show the target")
    every = _all_of(seen, target)
    remarks = _said_of_many(seen)
    if seen[0].geometry_id != target.geometry_id:
        remarks = (
            *remarks,
            f"detected with geometry {seen[0].geometry_id}, solved with the {target.source} geometry "
            f"{target.geometry_id} of the target file",
        )
    sizes = [one.image_size for one in seen]
    return prepare(replace(every, remarks=remarks), has_fronts=True, origin=origin, image_sizes=sizes)


def _said_of_many(seen: Sequence[Detections]) -> tuple[str, ...]:
    """What is to be known of a good part of the photos that show the target, as that it may be another one."""
    shown = [one for one in seen if len(one.ring)]
    count = Counter(remark for one in shown for remark in dict.fromkeys(one.remarks))
    most = max(2, MANY * len(shown))
    said = [f"{times} of {len(shown)} photos: {remark}" for remark, times in count.items() if times >= most]
    if moved := [one for one in shown if one.motion_px > 0]:
        worst = max(moved, key=lambda one: one.motion_px).image
        which = f"{worst} is" if len(moved) == 1 else f"{len(moved)} of {len(shown)} photos, most {worst}, are"
        said.append(f"{which} blurred by a motion: hold still, or expose for a shorter time")
    return (*misplaced_pieces(shown), *said)


def misplaced_pieces(seen: Iterable[Detections]) -> tuple[str, ...]:
    """A line on the faces that show another's code, or their own turned, in most photos in which it was read.

    Their rings have the names of their places, as their neighbours tell them, so that a calibration holds.
    """
    read: dict[int, Counter[int | None]] = {}
    for record in (record for one in seen for record in one.faces):
        if record.face is not None and (record.code_read or record.carries is not None):
            read.setdefault(record.face, Counter())[record.carries] += 1
    said = []
    for face, codes in sorted(read.items()):
        ((code, times),) = codes.most_common(1)
        total = codes.total()
        if code is not None and times >= LEAST_PHOTOS and 2 * times > total:
            what = "lies turned on its place" if code == face else f"carries the code of face {code}"
            said.append(f"face {face} {what} in {times} of {total} photos")
    if not said:
        return ()
    return (
        f"{'; '.join(said)}: put each piece on the face of its number, or leave it: its rings were named by the faces "
        "around it, and only dots of its code are lost",
    )


def observations_for_poses(seen: Sequence[Detections], target: TargetGeometry) -> Observations | None:
    """The observations in views with points enough for a pose, all of one size; None if there are none.

    A photo may come twice, and needs no other to be judged by.
    """
    every = _all_of(seen, target)
    kept = ~_on_a_line(every)
    if not kept.any():
        return None
    size = seen[int(np.argmax(kept))].image_size
    return with_sound_covariances(keep_views(replace(every, image_size=size), kept))[0]


def _all_of(seen: Sequence[Detections], target: TargetGeometry) -> Observations:
    """All that was seen in several photos, whatever their sizes: the image size is the first one's."""
    if odd := {one.layout_id for one in seen} - {target.layout_id}:
        raise ValueError(f"detections of layout {min(odd)}, but the target has {target.layout_id}")
    return Observations(
        seen[0].image_size,
        tuple(one.image for one in seen),
        np.repeat(np.arange(len(seen)), [len(one.ring) for one in seen]),
        np.concatenate([one.ring for one in seen]),
        np.concatenate([one.center_px for one in seen]),
        np.concatenate([one.cov_px2 for one in seen]),
        known_points(target),
        smeared=tuple(one.image for one in seen if one.motion_px > 0),
    )


def prepare(
    every: Observations, *, has_fronts: bool, origin: str, image_sizes: Sequence[tuple[int, int]] | None = None
) -> Observations:
    """Leave out what cannot be used, and say so in the remarks.

    Args:
        every: all there is, with remarks on what is known already.
        has_fronts: the planes' normals point to the side that is seen.
        origin: what messages name: the file.
        image_sizes: (V,) width, height in px of each view; None: all are of the observations' own.

    Raises:
        InputError: no view is left, the image sizes are tied, or all is mirrored; the message says why.
    """
    said, names = list(every.remarks), every.view_names
    sizes = [every.image_size] * len(names) if image_sizes is None else image_sizes
    count = np.bincount(every.view, minlength=len(names))
    kept = count >= LEAST_POINTS
    _say(said, names, count == 0, "that show none of the points")
    _say(said, names, ~kept & (count > 0), f"that show fewer than {LEAST_POINTS} points")
    lined = kept & _on_a_line(every)
    _say(said, names, lined, "whose points lie on a line, all or all but one")
    kept &= ~lined
    size = _common_size(sizes, kept, origin, said)
    other = np.array([one != size for one in sizes], dtype=bool) & kept
    _say(said, names, other, f"that are not of {size[0]} x {size[1]} px as the others")
    kept &= ~other
    seen, too_sure = with_sound_covariances(keep_views(replace(every, image_size=size), kept))
    if too_sure:
        said.append(
            f"{too_sure} of {len(seen.view)} observations state less than {SUREST:.0%} of the median standard "
            "deviation; they count as if they stated that"
        )
    copies = _copies(seen)
    _say(said, seen.view_names, copies >= 0, "that are another one once more", of=copies)
    seen = keep_views(seen, copies < 0)
    mirrored = mirrored_views(seen, has_fronts=has_fronts, origin=origin)
    _say(said, seen.view_names, mirrored, "that show the points mirrored")
    return replace(keep_views(seen, ~mirrored), remarks=tuple(said))


def _say(said: list[str], names: Sequence[str], which: Flags, reason: str, *, of: Rows | None = None) -> None:
    """Add a line on the views that are left out for one reason."""
    views = np.flatnonzero(which).tolist()
    if not views:
        return
    shown = [names[view] if of is None else f"{names[view]} (as {names[of[view]]})" for view in views]
    said.append(f"left out views {reason}: {first_few(shown)}")


def _common_size(every: Sequence[tuple[int, int]], kept: Flags, origin: str, said: Sequence[str]) -> tuple[int, int]:
    """The image size of most views; InputError: there are no views, or two sizes have the most."""
    sizes = [size for size, ok in zip(every, kept, strict=True) if ok]
    if not sizes:
        why = f" ({said[-1]})" if said else ""
        raise InputError(
            f"{origin}: no view is left to solve from{why}; give photos that show at least {LEAST_POINTS} points "
            "which are not on a line"
        )
    most = sorted(set(sizes), key=lambda size: (-sizes.count(size), size))
    if len(most) > 1 and sizes.count(most[0]) == sizes.count(most[1]):
        listed = " and ".join(f"{size[0]} x {size[1]} px" for size in most[:2])
        raise InputError(
            f"{origin}: as many images of {listed}; a camera has one image size: give the photos of one only"
        )
    return most[0]


def _on_a_line(every: Observations) -> Flags:
    """Views whose points lie on a line, all or all but one: they have no unique homography.  # (V,)"""
    start = np.searchsorted(every.view, np.arange(every.view_count + 1))
    rows = (every.point[first:last] for first, last in pairwise(start))
    return np.array([_is_lined(every.points.position_mm[row]) for row in rows], dtype=bool)


def _is_lined(position: Array) -> bool:
    """Whether points lie on a line, all or all but one.  # (N, 3)

    Then their scatter has one eigenvalue that is not zero, so that its principal minors add up to zero.
    """
    count = len(position)
    if count < LEAST_POINTS:
        return True
    offset = position - position.mean(axis=0)
    part = offset[:, :, None] * offset[:, None]
    scatter = part.sum(axis=0)
    each = np.concatenate([scatter[None], scatter - count / (count - 1) * part])  # with all; without each one
    trace = np.trace(each, axis1=1, axis2=2)
    minors = 0.5 * (trace**2 - (each**2).sum(axis=(1, 2)))
    return not bool((minors > ON_A_LINE**2 * trace**2).all())


def _copies(seen: Observations) -> Rows:
    """For each view the earlier view that it is a copy of, or -1.  # (V,)

    Candidates are views that see any one point at the same place; they are then compared in full.
    """
    cell = np.rint(seen.center_px / _CELL_PX)
    order = np.lexsort((seen.view, cell[:, 1], cell[:, 0], seen.point))
    key = np.column_stack([seen.point, cell])[order]
    found = [np.zeros((0, 2), dtype=np.int64)]
    for step in range(1, _NEIGHBOURS + 1):
        again = np.flatnonzero((key[step:] == key[:-step]).all(axis=1))
        found.append(np.unique(np.column_stack([seen.view[order[again]], seen.view[order[again + step]]]), axis=0))
    pairs = np.unique(np.concatenate(found), axis=0)
    start = np.searchsorted(seen.view, np.arange(seen.view_count + 1))
    copy_of = np.full(seen.view_count, -1, dtype=np.int64)
    for first, second in pairs.tolist():
        rows = (np.arange(start[view], start[view + 1]) for view in (first, second))
        if copy_of[second] < 0 and _is_copy(seen, *rows):
            copy_of[second] = copy_of[first] if copy_of[first] >= 0 else first
    return copy_of


def _is_copy(seen: Observations, first: Rows, second: Rows) -> bool:
    """Whether two views agree better than two photos would, even from a tripod: their noise would differ."""
    _, in_first, in_second = np.intersect1d(seen.point[first], seen.point[second], return_indices=True)
    if len(in_first) < 0.9 * max(len(first), len(second)):
        return False
    first, second = first[in_first], second[in_second]
    difference = seen.center_px[first] - seen.center_px[second]
    if np.abs(difference).max() < SAME_PX:
        return True
    if seen.cov_px2 is None:
        return False
    noise = seen.cov_px2[first] + seen.cov_px2[second]
    square = np.einsum("ni,ni->n", difference, solve_square(noise, difference[:, :, None])[:, :, 0])
    return rms_length(difference) < ALIKE[0] and float(square.mean()) / 2 < ALIKE[1]
