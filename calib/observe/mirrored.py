"""Points seen in a mirror: photos that were flipped, or points that are numbered or measured as their mirror image.

They may fit as well as true ones, and give a camera that is wrong. Both tests hold through strong lens distortion,
because no lens turns an image inside out.
"""

from itertools import pairwise

import numpy as np

from calib.core.types import KnownPoints, Observations
from designer.base.arrays import Array, Flags, Rows
from designer.base.errors import InputError

CLEAR_SHARE = 0.5
"""Of a view's triangles, those that run one way less those that run the other, from which on a view is clear."""
SURE = 6.0
"""Standard deviations from zero that make the handedness of a view clear; they are stated a third too small."""
_FAT = 0.1
"""A triangle's area over the square of its longest side; of thin ones noise and distortion may turn the sign."""
_FLAT = 0.02
"""Points this much thinner than wide do not tell their handedness."""
_LEAST_POINTS = 12
"""A view of fewer points does not tell its handedness: seven numbers and four more are fitted to it."""


def mirrored_views(seen: Observations, *, has_fronts: bool, origin: str) -> Flags:
    """Which views show the points in a mirror.  # (V,)

    Args:
        seen: the correspondences.
        has_fronts: the planes' normals point to the side that is seen. Without, a plane alone may be seen from
            either side, which gives the same camera, so that only views that differ from most are mirrored.
        origin: what messages name.

    Raises:
        InputError: all views are mirrored, or as many as are not where only the majority tells.
    """
    if has_fronts:
        side = _clear(facing(seen), CLEAR_SHARE)
    elif len(seen.points.plane) == 1 and (seen.points.face == 0).all():
        side = _clear(facing(seen), CLEAR_SHARE)
        balance = int(side.sum())
        if balance == 0 and side.any():
            raise InputError(
                f"{origin}: half of the views show the points mirrored to the other half; number the points alike in "
                "all views, and flip photos that were flipped back"
            )
        side = side * np.sign(balance)
    else:
        side = _clear(handedness(seen), SURE)
    mirrored: Flags = side < 0
    if mirrored.any() and not (side > 0).any():
        raise InputError(
            f"{origin}: the points are mirrored: the photos were flipped, u and v are exchanged, v is counted from "
            "below, or the points are numbered or measured as in a mirror; flip the photos back, correct u v (v counts "
            "downwards), or X Y Z to a right-handed frame"
        )
    return mirrored


def _clear(evidence: Array, limit: float) -> Rows:
    """1 or -1 where the evidence is clear, else 0."""
    return np.where(np.abs(np.nan_to_num(evidence)) > limit, np.sign(np.nan_to_num(evidence)), 0).astype(np.int64)


def facing(seen: Observations) -> Array:
    """From 1, planes seen from where their normals point to, to -1, from behind or mirrored; nan: no plane.  # (V,)

    The points of a face in a view are joined to triangles across their middle. From the normal's side a triangle runs
    the same way round in the image as in its plane; the sign of its area tells. Image rows count downwards.
    """
    on_plane = np.flatnonzero(seen.points.face[seen.point] >= 0)
    place, pixel = _in_plane(seen.points)[seen.point[on_plane]], seen.center_px[on_plane]
    face, view = seen.points.face[seen.point[on_plane]], seen.view[on_plane]
    second, third = _across(view * max(1, len(seen.points.plane)) + face, place)
    in_plane, longest = _areas(place, second, third)
    in_image, _ = _areas(pixel, second, third)
    fat = np.abs(in_plane) > _FAT * longest
    agree = np.where(fat, -np.sign(in_plane) * np.sign(in_image), 0.0)
    count = np.bincount(view, weights=fat, minlength=seen.view_count)
    with np.errstate(invalid="ignore"):
        share: Array = np.bincount(view, weights=agree, minlength=seen.view_count) / count
    return share


def _in_plane(points: KnownPoints) -> Array:
    """Coordinates in each point's plane, counter-clockwise as seen from the normal's side.  # (K, 2)"""
    if not len(points.plane):
        return np.zeros((len(points.face), 2))
    normal = points.plane[:, :3]
    least = np.eye(3)[np.argmin(np.abs(normal), axis=1)]
    first = np.cross(least, normal)
    first /= np.linalg.norm(first, axis=1, keepdims=True)
    axes = np.stack([first, np.cross(normal, first)], axis=1)  # (F, 2, 3)
    place: Array = np.einsum("kij,kj->ki", axes[points.face], points.position_mm)
    return place


def _across(group: Rows, place: Array) -> tuple[Rows, Rows]:
    """The two rows that form a triangle around the middle of its group with each row.  # (N,), (N, 2) -> (N,) twice"""
    _, group, count = np.unique(group, return_inverse=True, return_counts=True)
    middle = np.stack([np.bincount(group, weights=axis) / count for axis in place.T], axis=1)
    offset = place - middle[group]
    order = np.lexsort((np.arctan2(offset[:, 1], offset[:, 0]), group))
    size = count[group[order]]
    start = (np.cumsum(count) - count)[group[order]]
    within = np.arange(len(order)) - start
    partners = []
    for part in (1, 2):
        partner = np.empty_like(order)
        partner[order] = order[start + (within + part * size // 3) % size]
        partners.append(partner)
    return partners[0], partners[1]


def _areas(place: Array, second: Rows, third: Rows) -> tuple[Array, Array]:
    """Twice the signed area of each triangle, and the square of its longest side.  # (N,) twice"""
    a, b, c = place[second] - place, place[third] - place, place[third] - place[second]
    longest = np.stack([(side**2).sum(axis=1) for side in (a, b, c)]).max(axis=0)
    return a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0], longest


def handedness(seen: Observations) -> Array:
    """How surely each view's points are right-handed, in standard deviations; negative: mirrored.  # (V,)

    Needs points that are not in one plane. nan: it cannot be told.
    """
    start = np.searchsorted(seen.view, np.arange(seen.view_count + 1))
    width, height = seen.image_size
    image = (seen.center_px - 0.5 * np.array([width - 1, height - 1])) / (0.5 * np.hypot(width, height))
    position = seen.points.position_mm[seen.point]
    views = (slice(first, last) for first, last in pairwise(start))
    return np.array([_handedness_of(position[rows], image[rows]) for rows in views])


def _handedness_of(position: Array, image: Array) -> float:
    """The focal length over its standard deviation, from a linear solution that takes the points as they are.

    A radial lens does not change the directions in which points are seen from the image's middle; they give two rows
    of the rotation (Tsai 1987, stage 1), and a right-handed frame the third. How the radii depend on the depths along
    it then gives distance, focal length and radial distortion by linear equations (stage 2). Of a mirrored target
    the depths are reversed, and so are the signs of distance and focal length.  # (N, 3), (N, 2)
    """
    if len(position) < _LEAST_POINTS:
        return np.nan
    centred = position - position.mean(axis=0)
    extent = np.linalg.svd(centred, compute_uv=False)
    if not extent[2] > _FLAT * extent[0]:
        return np.nan
    point = np.column_stack([centred * np.sqrt(len(centred)) / extent[0], np.ones(len(centred))])
    u, v = image[:, :1], image[:, 1:]
    across = np.linalg.svd(np.hstack([-v * point, u * point]), full_matrices=False)[2][-1].reshape(2, 4)
    lateral = point @ across.T
    across *= np.sign((lateral * image).sum()) or 1.0
    scale = np.sqrt(np.linalg.norm(across[0, :3]) * np.linalg.norm(across[1, :3]))
    if not scale > 0:
        return np.nan
    depth = point[:, :3] @ np.cross(across[0, :3], across[1, :3]) / scale
    radius, side = np.hypot(u, v)[:, 0], np.hypot(*lateral.T)
    # radius (depth + distance) = side (focal + a radius^2 + b radius^4)
    design = np.column_stack([side, -radius, side * radius**2, side * radius**4])
    return _significance(design, radius * depth)


def _significance(design: Array, right: Array) -> float:
    """The first unknown of a least-squares problem over its standard deviation."""
    size = np.linalg.norm(design, axis=0)
    if not (size > 0).all():
        return np.nan
    left, singular, rows = np.linalg.svd(design / size, full_matrices=False)
    if not singular[-1] > 1e-12 * singular[0]:
        return np.nan
    unknown = rows.T @ (left.T @ right / singular)
    residual = right - (design / size) @ unknown
    variance = (residual @ residual) / (len(right) - len(unknown)) * ((rows[:, 0] / singular) ** 2).sum()
    return float(unknown[0] / np.sqrt(max(variance, 1e-24 * unknown[0] ** 2)))
