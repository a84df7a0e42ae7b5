"""Points in space from what several cameras of a rig saw: the most likely place, how surely, and what contradicts.

The start is the point nearest to all rays; Gauss-Newton then makes the whitened residuals in the images smallest. A
sighting that contradicts the others is found by leaving each camera out in turn, which takes three cameras; two that
contradict each other are both in doubt.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from calib.cameras.rig import Rig
from calib.core.parallel import in_chunks, one_thread
from calib.core.types import freeze
from calib.space.propagate import (
    PointSightings,
    Rays,
    calibration_factor,
    inverse_3x3,
    linear_sight,
    normal_matrices,
    propagate,
    rays_in_rig,
    sums_at,
    whitening,
    with_noise,
)
from designer.base.arrays import Array, Flags, Rows
from designer.base.errors import InputError

REASONS = (
    "",
    "seen by one camera only",
    "the camera models have no rays to it from two cameras",
    "its rays are all but parallel: how far away it is, is not determined",
    "its rays do not meet in front of the cameras",
    "its two cameras contradict each other",
    "its cameras contradict each other, and which is wrong is not to be told",
)
"""Why a point has no position; the first: it has one."""
ONE_CAMERA, NO_RAYS, PARALLEL, BEHIND, TWO_CONTRADICT, CONTRADICT = range(1, 7)
GROSS = 1e-4
"""Of sound points so many contradict themselves as much by chance."""
LEAST_FOR_SCALE = 20
"""Points from which is told whether the noise is larger than stated."""
UNSURE = 0.3
"""Of the distance to the nearest camera, a standard deviation beyond which the law of propagation tells nothing."""
MOST_STEPS, MOST_HALVINGS = 30, 12
SETTLED = 1e-10
"""Square of a step in units of the point's standard deviation that is none any more."""
AT_ONCE = 4_000_000
"""Numbers of derivatives that are held at a time."""


@dataclass(frozen=True, eq=False)
class TriangulatedPoints:
    """N points in the rig's frame and how surely they lie there: `found.position_mm`, `found.covariance_mm2`."""

    rig: Rig
    sightings: PointSightings
    position_mm: Array  # (N, 3) nan of points without a position
    noise_mm2: Array  # (N, 3, 3) covariance by the noise of the pixels
    calibration_mm2: Array | None  # (N, 3, 3) by the rig's own errors, which all points share; None: not known
    reason: Rows  # (N,) rows of `REASONS`
    residual_px: Array  # (M, 2) predicted - measured, of gross errors too; nan without a position
    ray_error_mm: Array  # (M,) from the point to the ray
    is_gross: Flags  # (M,) left out, because it contradicts the others
    is_used: Flags  # (M,) that the positions come from
    cameras_used: Rows  # (N,)
    misclosure_px: Array  # (N,) of two cameras the epipolar error, both residuals together; of more the largest
    noise_px: Array  # (C,) that was taken where a sighting states none
    scale: float  # residuals against what noise and calibration leave to be expected, robust; nan of few points

    def __post_init__(self) -> None:
        freeze(self, "position_mm", "noise_mm2", "calibration_mm2", "residual_px", "ray_error_mm", "misclosure_px")
        freeze(self, "reason", "cameras_used", dtype=np.int64)
        freeze(self, "is_gross", "is_used", dtype=np.bool_)

    @property
    def covariance_mm2(self) -> Array:
        """Of each point by all that is known.  # (N, 3, 3)"""
        return self.noise_mm2 if self.calibration_mm2 is None else self.noise_mm2 + self.calibration_mm2

    @property
    def is_placed(self) -> Flags:
        """Which points have a position.  # (N,)"""
        return np.asarray(self.reason == 0)


@dataclass(frozen=True, eq=False)
class _Solved:
    """What came of some rays."""

    position_mm: Array  # (N, 3)
    noise_mm2: Array  # (N, 3, 3)
    calibration_mm2: Array | None  # (N, 3, 3)
    squares: Array  # (N,) sum of squared whitened residuals
    expected: Array  # (N,) of it, by noise and calibration
    freedom: Rows  # (N,) 2 rays - 3

    @property
    def contradiction(self) -> Array:
        """The sum of squares, as it would be of noise alone.  # (N,)"""
        with np.errstate(invalid="ignore", divide="ignore"):
            ratio: Array = self.squares * self.freedom / self.expected
        return ratio


@one_thread
def triangulate_points(
    rig: Rig, sightings: PointSightings, noise_px: Array | None = None, *, rejects: bool = True
) -> TriangulatedPoints:
    """The points that the cameras of a rig see.

    Args:
        rig: its rows are those of the sightings' cameras.
        sightings: of points.
        noise_px: of a coordinate in each camera (C,), where a sighting states none; None: the rig's.
        rejects: leave out what contradicts the rest; else all have their say, and each point that can have a position.

    Raises:
        InputError: the noise is nowhere stated.
    """
    noise = noise_of(rig, noise_px, sightings)
    cov = with_noise(sightings, noise)
    has_ray = np.zeros(len(sightings.place), dtype=bool)
    for camera in range(len(rig.cameras)):
        rows = np.flatnonzero(sightings.camera == camera)
        has_ray[rows] = np.isfinite(rig.cameras[camera].rays(sightings.center_px[rows])).all(axis=1)
    seen, used = (np.bincount(sightings.place[rows], minlength=sightings.count) for rows in (slice(None), has_ray))
    reason = np.where(seen < 2, ONE_CAMERA, np.where(used < 2, NO_RAYS, 0))
    use = has_ray & (reason == 0)[sightings.place]
    factor = calibration_factor(rig)
    solved = _solve_all(rig, factor, sightings, cov, np.flatnonzero(use), np.flatnonzero(reason == 0))
    scale = _scale(solved)
    is_gross = np.zeros(len(use), dtype=bool)
    if rejects:
        is_gross, solved, judged = _without_gross(rig, factor, sightings, cov, use, solved, scale)
        reason = np.where(reason == 0, judged, reason)
    return _told(rig, sightings, noise, solved, reason, is_gross, use & ~is_gross, scale)


def noise_of(rig: Rig, noise_px: Array | float | None, sightings: PointSightings | None = None) -> Array:
    """The noise of a coordinate in each camera (C,): as given, as stated, or the rig's.

    Raises:
        InputError: it is nowhere stated, or is not more than zero.
    """
    if noise_px is None and rig.noise_px is None:
        if sightings is not None and sightings.cov_px2 is not None and np.isfinite(sightings.cov_px2).all():
            return np.full(len(rig.cameras), np.nan)
        raise InputError("the rig's file does not tell the noise of its cameras; give --noise, such as 0.1px")
    noise = np.broadcast_to(np.asarray(rig.noise_px if noise_px is None else noise_px, float), (len(rig.cameras),))
    if not (noise > 0).all():
        raise InputError(f"a noise of {noise.min():g} px: it must be more than zero; give --noise, such as 0.1px")
    return noise.copy()


def noise_of_each(rig: Rig, noise_px: float | Sequence[float] | None) -> Array | None:
    """The noise that was given, for each camera (C,); None: none was.

    Raises:
        InputError: not one number, or one for each camera.
    """
    if noise_px is None:
        return None
    each = [noise_px] if isinstance(noise_px, int | float) else list(noise_px)
    if len(each) not in (1, len(rig.names)):
        raise InputError(f"--noise: {len(each)} numbers for {len(rig.names)} cameras; give one, or one a camera")
    return noise_of(rig, np.array(each))


def _solve_all(
    rig: Rig, factor: Array | None, sightings: PointSightings, cov_px2: Array, rows: Rows, places: Rows
) -> _Solved:
    """Solve some points from some sightings, part by part; nan of all other points."""
    count = sightings.count
    whole = _Solved(
        np.full((count, 3), np.nan), np.full((count, 3, 3), np.nan),
        None if factor is None else np.full((count, 3, 3), np.nan), np.full(count, np.nan), np.full(count, np.nan),
        np.zeros(count, dtype=np.int64),
    )  # fmt: skip
    rows = rows[np.argsort(sightings.place[rows], kind="stable")]
    place = sightings.place[rows]
    parts = list(_parts(rig, factor, place, places))

    def solve_part(part: Rows) -> None:
        first, last = np.searchsorted(place, [part[0], part[-1] + 1])
        inside = rows[first:last]
        rays = Rays(
            len(part), sightings.camera[inside], np.searchsorted(part, sightings.place[inside]),
            whitening(cov_px2[inside]),
        )  # fmt: skip
        found = _solve(rig, factor, sightings.center_px[inside], rays)
        for into, values in (
            (whole.position_mm, found.position_mm), (whole.noise_mm2, found.noise_mm2),
            (whole.squares, found.squares), (whole.expected, found.expected), (whole.freedom, found.freedom),
        ):  # fmt: skip
            into[part] = values
        if whole.calibration_mm2 is not None and found.calibration_mm2 is not None:
            whole.calibration_mm2[part] = found.calibration_mm2

    def solve_parts(begin: int, end: int) -> None:
        for part in parts[begin:end]:
            solve_part(part)

    in_chunks(solve_parts, len(parts))
    return whole


def _parts(rig: Rig, factor: Array | None, place: Rows, places: Rows) -> Iterator[Rows]:
    """Points in ascending order, as many at a time as their derivatives may take."""
    if not len(places):
        return
    params = max(len(camera.params) for camera in rig.cameras)
    independent = 0 if factor is None else factor.shape[1]
    rays = max(len(place) / len(places), 1.0)
    size = max(int(AT_ONCE / (rays * (20 + 4 * params + 4 * independent) + 3 * independent)), 16)
    for first in range(0, len(places), size):
        yield places[first : first + size]


def _solve(rig: Rig, factor: Array | None, pixel: Array, rays: Rays) -> _Solved:
    """Start, descend, and say how surely.  # (M, 2)"""
    position, squares = _descend(rig, pixel, rays, _nearest_to_rays(rig, pixel, rays))
    spread = propagate(rig, factor, position, rays)
    freedom = 2 * np.bincount(rays.place, minlength=rays.count) - 3
    return _Solved(position, spread.noise_mm2, spread.calibration_mm2, squares, freedom + spread.misclosure, freedom)


def _nearest_to_rays(rig: Rig, pixel: Array, rays: Rays) -> Array:
    """The points (N, 3) of least sums of squared distances from their rays; nan of parallel ones."""
    across, through = np.zeros((rays.count, 3, 3)), np.zeros((rays.count, 3))
    for camera, rows in rays.of_cameras():
        direction = rays_in_rig(rig, camera, pixel[rows])
        projector = np.eye(3) - direction[:, :, None] * direction[:, None, :]
        place = rays.place[rows]  # of a camera each another
        across[place] += projector
        through[place] += projector @ rig.center_mm[camera]
    nearest: Array = np.einsum("nij,nj->ni", inverse_3x3(across), through)
    return nearest


def _descend(rig: Rig, pixel: Array, rays: Rays, start: Array) -> tuple[Array, Array]:
    """Gauss-Newton with steps that are halved until they help: positions (N, 3), sums of squares (N,)."""
    position, best = start.copy(), np.full(rays.count, np.inf)
    trial, step = start.copy(), np.zeros_like(start)
    active, halvings = np.arange(rays.count), np.zeros(rays.count, dtype=np.int64)
    for _ in range(MOST_STEPS):
        rows = np.flatnonzero(np.isin(rays.place, active)) if len(active) < rays.count else np.arange(len(rays.place))
        part = Rays(len(active), rays.camera[rows], np.searchsorted(active, rays.place[rows]), rays.whiten[rows])
        squares, normal, slope = _linear(rig, pixel[rows], part, trial[active])
        is_better = squares <= best[active]
        taken = active[is_better]
        position[taken], best[taken] = trial[taken], squares[is_better]
        newton = -np.einsum("nij,nj->ni", inverse_3x3(normal[is_better]), slope[is_better])
        step[taken], halvings[taken] = newton, 0
        is_settled = np.zeros(len(active), dtype=bool)
        is_settled[is_better] = ~(-(newton * slope[is_better]).sum(axis=1) > SETTLED)
        worse = active[~is_better]
        step[worse] *= 0.3
        halvings[worse] += 1
        is_settled[~is_better] = (halvings[worse] > MOST_HALVINGS) | ~np.isfinite(best[worse])
        active = active[~is_settled]
        if not len(active):
            break
        trial[active] = position[active] + step[active]
    return np.where(np.isfinite(best)[:, None], position, np.nan), np.where(np.isfinite(best), best, np.nan)


def _linear(rig: Rig, pixel: Array, rays: Rays, position: Array) -> tuple[Array, Array, Array]:
    """Sums of squares (N,) of whitened residuals, `J'J` (N, 3, 3) and `J'r` (N, 3)."""
    jacobian, residual = np.full((len(rays.place), 2, 3), np.nan), np.full((len(rays.place), 2), np.nan)
    for camera, rows in rays.of_cameras():
        sight = linear_sight(rig, camera, position[rays.place[rows]])
        jacobian[rows] = rays.whiten[rows] @ sight.by_point
        residual[rows] = np.einsum("mij,mj->mi", rays.whiten[rows], sight.pixel - pixel[rows])
    slope = np.stack(
        [sums_at(rays.place, (jacobian[:, :, axis] * residual).sum(axis=1), rays.count) for axis in range(3)], axis=1
    )
    squares = sums_at(rays.place, (residual**2).sum(axis=1), rays.count)
    return squares, normal_matrices(rays.place, jacobian, rays.count), slope


def _scale(solved: _Solved) -> float:
    """How much larger residuals are than is to be expected, by the median of all points; nan of few."""
    from scipy.special import chdtri

    known = np.isfinite(solved.contradiction)
    if known.sum() < LEAST_FOR_SCALE:
        return float("nan")
    return float(np.sqrt(np.median(solved.contradiction[known] / chdtri(solved.freedom[known], 0.5))))


def _is_contradiction(solved: _Solved, scale: float) -> Flags:
    """Which points (N,) their sightings contradict, by more than chance makes of so large a noise."""
    from scipy.special import chdtri

    limit = chdtri(np.maximum(solved.freedom, 1), GROSS) * max(1.0, scale if np.isfinite(scale) else 1.0) ** 2
    contradicted: Flags = solved.contradiction > limit
    return contradicted


def _without_gross(
    rig: Rig, factor: Array | None, sightings: PointSightings, cov: Array, use: Flags, solved: _Solved, scale: float
) -> tuple[Flags, _Solved, Rows]:
    """Leave out what contradicts the rest: which sightings (M,), the points from the others, and reasons (N,)."""
    is_gross, reason = np.zeros(len(sightings.place), dtype=bool), np.zeros(sightings.count, dtype=np.int64)
    bad = np.flatnonzero(_is_contradiction(solved, scale))
    while len(bad):
        rays = np.bincount(sightings.place[use & ~is_gross], minlength=sightings.count)
        reason[bad[rays[bad] == 2]] = np.where(seen_by_two(sightings, bad[rays[bad] == 2]), TWO_CONTRADICT, CONTRADICT)
        bad = bad[rays[bad] > 2]
        if not len(bad):
            break
        left_out, passes, is_alone = _leave_each_out(rig, factor, sightings, cov, use & ~is_gross, bad, scale)
        reason[bad[passes & ~is_alone]] = CONTRADICT
        named = left_out[~passes | is_alone]
        is_gross[named] = True
        bad = sightings.place[named]
        again = np.isin(sightings.place, bad) & use & ~is_gross
        fresh = _solve_all(rig, factor, sightings, cov, np.flatnonzero(again), np.sort(bad))
        solved = _replaced(solved, fresh, bad)
        bad = bad[_is_contradiction(solved, scale)[bad]]
    is_gross &= (reason == 0)[sightings.place]
    return is_gross, solved, reason


def seen_by_two(sightings: PointSightings, places: Rows) -> Flags:
    """Which of some points two cameras see and no more."""
    two: Flags = np.bincount(sightings.place, minlength=sightings.count)[places] == 2
    return two


def _leave_each_out(
    rig: Rig, factor: Array | None, sightings: PointSightings, cov: Array, use: Flags, places: Rows, scale: float
) -> tuple[Rows, Flags, Flags]:
    """Of points (B,): the sighting without which the others agree best, whether they agree then, and only then."""
    rows = np.flatnonzero(use & np.isin(sightings.place, places))
    rows = rows[np.argsort(sightings.place[rows], kind="stable")]
    # A copy of its point for each sighting that is left out.
    pair_out, pair_in = _pairs_within(sightings.place[rows])
    kept = rows[pair_in]
    copies = PointSightings(
        ("",), tuple("" for _ in rows), np.zeros(len(rows), dtype=np.int64), np.arange(len(rows)),
        sightings.camera[kept], pair_out, sightings.center_px[kept],
    )  # fmt: skip
    solved = _solve_all(rig, factor, copies, cov[kept], np.arange(len(kept)), np.arange(len(rows)))
    left = np.where(np.isfinite(solved.contradiction), solved.contradiction / np.maximum(solved.freedom, 1), np.inf)
    agrees = ~_is_contradiction(solved, scale) & np.isfinite(left)
    order = np.lexsort((left, sightings.place[rows]))
    first = order[np.searchsorted(sightings.place[rows][order], places)]
    how_many = np.bincount(sightings.place[rows][agrees], minlength=sightings.count)[places]
    return rows[first], agrees[first], how_many == 1


def _pairs_within(group: Rows) -> tuple[Rows, Rows]:
    """All ordered pairs of different rows of the same group, of groups that stand together: first rows, second."""
    start = np.searchsorted(group, group, side="left")
    size = np.searchsorted(group, group, side="right") - start
    first = np.repeat(np.arange(len(group)), size)
    second = np.arange(len(first)) - np.repeat(np.cumsum(size) - size, size) + np.repeat(start, size)
    differ = first != second
    return first[differ], second[differ]


def _replaced(solved: _Solved, fresh: _Solved, places: Rows) -> _Solved:
    """The solution with some points taken from another."""
    take = np.zeros(len(solved.squares), dtype=bool)
    take[places] = True
    flat, matrix = take[:, None], take[:, None, None]
    known = solved.calibration_mm2, fresh.calibration_mm2
    return _Solved(
        np.where(flat, fresh.position_mm, solved.position_mm), np.where(matrix, fresh.noise_mm2, solved.noise_mm2),
        None if known[0] is None or known[1] is None else np.where(matrix, known[1], known[0]),
        np.where(take, fresh.squares, solved.squares), np.where(take, fresh.expected, solved.expected),
        np.where(take, fresh.freedom, solved.freedom),
    )  # fmt: skip


def _told(
    rig: Rig, sightings: PointSightings, noise: Array, solved: _Solved, reason: Rows, is_gross: Flags, use: Flags,
    scale: float,
) -> TriangulatedPoints:  # fmt: skip
    """All that is told of the points; those that are not determined have no position."""
    sigma = np.sqrt(np.trace(solved.noise_mm2, axis1=1, axis2=2))
    away = np.linalg.norm(solved.position_mm[:, None] - rig.center_mm, axis=2).min(axis=1)
    sure = sigma <= UNSURE * away
    reason = np.where((reason == 0) & ~np.isfinite(solved.squares), BEHIND, reason)
    reason = np.where((reason == 0) & ~sure, PARALLEL, reason)
    placed = reason == 0
    position = np.where(placed[:, None], solved.position_mm, np.nan)
    residual, off = np.full((len(sightings.place), 2), np.nan), np.full(len(sightings.place), np.nan)
    for camera in range(len(rig.cameras)):
        rows = np.flatnonzero(sightings.camera == camera)
        at = solved.position_mm[sightings.place[rows]]
        seen = rig.cameras[camera].project(at @ rig.cam_from_rig[camera, :3, :3].T + rig.cam_from_rig[camera, :3, 3])
        residual[rows] = seen - sightings.center_px[rows]
        ray = rays_in_rig(rig, camera, sightings.center_px[rows])
        off[rows] = np.linalg.norm(np.cross(at - rig.center_mm[camera], ray), axis=1)
    kept = placed[sightings.place]
    rays = np.bincount(sightings.place[use], minlength=sightings.count)
    calibration = solved.calibration_mm2
    return TriangulatedPoints(
        rig, sightings, position, np.where(placed[:, None, None], solved.noise_mm2, np.nan),
        None if calibration is None else np.where(placed[:, None, None], calibration, np.nan), reason,
        np.where(kept[:, None], residual, np.nan), np.where(kept, off, np.nan), is_gross, use & kept, rays,
        _misclosure(sightings, residual, use, rays), noise, scale,
    )  # fmt: skip


def _misclosure(sightings: PointSightings, residual: Array, use: Flags, rays: Rows) -> Array:
    """Of two cameras the sum of both residuals' lengths, the epipolar error; of more the largest residual.  # (N,)"""
    length = np.where(use & np.isfinite(residual).all(axis=1), np.hypot(*residual.T), 0.0)
    largest = np.zeros(sightings.count)
    np.maximum.at(largest, sightings.place, length)
    two = sums_at(sightings.place, length, sightings.count)
    misclosure: Array = np.where(rays >= 2, np.where(rays == 2, two, largest), np.nan)
    return misclosure
