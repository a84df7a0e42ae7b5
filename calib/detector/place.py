"""Where all features of the target must be in the image, from those that have names; and more names from that."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calib.core import homography
from calib.core.linear_algebra import solve_square
from calib.detector.candidates import Candidates, nearest_candidates
from calib.detector.lens import Lens, local_form, scale_to_weigh_with
from calib.detector.plan import TargetPlan
from calib.detector.wide_guess import guess_lens
from designer.base.arrays import Array, Flags, Rows

REACH = 0.22
"""A candidate nearer than this share of the pitch to where a feature must be is that feature ..."""
SIZE_RATIO = 1.8
"""... if their areas differ by no more than this."""
OWN_HOMOGRAPHY = 10
"""Faces with fewer named features are placed by the whole solid, if other faces show."""
FLATTEST_GUESS = 0.2
"""Least width over length of circles on a face that others name. At 78 degrees a piece a tenth of the pitch too high
has its rings half a step aside, flatter still a whole one: each would bear the next one's name, and all would agree."""
ROUNDS = 5
MIN_FOR_PROJECTION = 12
NEIGHBOURS, FEWEST_NEIGHBOURS = 9, 4
"""Of the same face, which tell in what light a place lies."""
CHUNK = 256
"""Points whose distances from all others are held at a time."""
STRANGE = 0.2
"""A face whose features lie this share of the pitch off the solid's projection, in the median, has the wrong name."""


@dataclass(frozen=True, eq=False)
class Naming:
    """Which candidates have which names: N pairs of a candidate's row and a target's row."""

    candidate: Rows  # (N,)
    ring: Rows  # (N,)


@dataclass(frozen=True, eq=False)
class Placement:
    """Faces as the image shows them."""

    lens: Lens
    homography: Array  # (F, 3, 3) straight image from face plane; nan: the face is not seen
    by_solid: Array  # (F, 3, 3) the same from the solid's projection alone; nan: one face only, or not seen
    is_mirrored: bool = False

    def seen(self) -> Rows:
        """Faces that show.  # (S,)"""
        return np.flatnonzero(np.isfinite(self.homography[:, 0, 0]))

    def on_face(self, face: int, pixel: Array) -> Array:
        """Where pixels lie in the plane of a face, in mm; nan: it does not show, or from its edge.  # (N, 2)"""
        plane_from_straight = solve_square(self.homography[face], np.eye(3))
        return homography.apply(plane_from_straight, self.lens.straighten(pixel))


@dataclass(frozen=True, eq=False)
class Places:
    """Where N features must be: all on the faces that show."""

    ring: Rows  # (N,) rows of the target
    center_px: Array  # (N, 2)
    shape: Array  # (N, 3) E of the outer circle

    def take(self, rows: NDArray[np.generic]) -> "Places":
        """Some of them."""
        return Places(self.ring[rows], self.center_px[rows], self.shape[rows])

    def are_whole(self, image_size: tuple[int, int]) -> Flags:
        """Whether the image's edge leaves all of a feature in the image, and a pixel around it.  # (N,)"""
        across = np.stack([np.hypot(self.shape[:, 1], self.shape[:, 2]), self.shape[:, 0]], axis=1)
        half = across / (self.shape[:, :1] * self.shape[:, 2:]) + 1
        inside = (self.center_px > half) & (self.center_px < np.array(image_size) - 1 - half)
        return np.asarray(inside.all(axis=1))


def place_faces(
    plan: TargetPlan,
    candidates: Candidates,
    naming: Naming,
    image_size: tuple[int, int],
    camera_lens: Lens | None,
    read: Rows | None = None,
) -> Placement:
    """Fit lens, homographies and, over several faces, the projection of the solid to the names so far.

    `read` are the faces that were named by what is on them, None: all; others do not show where they are too flat.
    """
    target = plan.target
    lens = _lens(plan, candidates, naming, image_size, camera_lens)
    straight = lens.straighten(candidates.ellipse[naming.candidate, :2])
    # Beyond a lens's fold there are no rays.
    has_ray = np.isfinite(straight).all(axis=1)
    ring, straight = naming.ring[has_ray], straight[has_ray]
    scale = scale_to_weigh_with(lens, candidates.ellipse[naming.candidate[has_ray], :2])
    face = target.ring_face[ring]
    plane = target.center_in_face_mm[ring, :2]
    faces = np.unique(face)
    mapped = np.full((target.face_count, 3, 3), np.nan)
    by_solid = np.full((target.face_count, 3, 3), np.nan)
    mirrored = False
    if fixes_projection(plane, face):
        projection = direct_projection(target.center_mm[ring], straight)
        mirrored = bool(np.linalg.det(projection[:, :3]) < 0)
        every = projection @ target.target_from_face[:, :, [0, 1, 3]]
        front = _shows_front(every, target.outline_mm)
        if read is not None:
            guessed = np.setdiff1d(np.flatnonzero(front), read)
            front[guessed[_width_over_length(every[guessed]) < FLATTEST_GUESS]] = False
            faces = np.intersect1d(faces, np.union1d(np.flatnonzero(front), read))
        by_solid[front] = every[front]
        mapped[front] = every[front]
    for f in faces:
        mine = face == f
        is_enough = mine.sum() >= OWN_HOMOGRAPHY or len(faces) == 1
        if is_enough and homography.is_determined(plane[mine]):
            weight = 1 / scale[mine] ** 2  # points that lie far off are left out
            own = homography.fit_near(plane[mine], straight[mine], weight, slack=0.2, least=5)[0]
            mapped[f] = own if np.isfinite(own).all() else mapped[f]
    return Placement(lens, mapped, by_solid, mirrored)


def _lens(
    plan: TargetPlan, candidates: Candidates, naming: Naming, image_size: tuple[int, int], camera_lens: Lens | None
) -> Lens:
    """The known lens, or what the named grids show of it."""
    pixel = candidates.ellipse[naming.candidate, :2]
    lens = guess_lens(plan.by_face(naming.ring, pixel), image_size) if camera_lens is None else camera_lens
    return lens.facing(pixel)


def fixes_projection(plane: Array, face: Rows) -> bool:
    """Whether points fix a projection: those of two faces fix a homography each.  # (N, 2), (N,)

    One point beside a face leaves a family of projections open, of which noise chooses.
    """
    fixing = sum(homography.is_determined(plane[face == f]) for f in np.unique(face))
    return len(face) >= MIN_FOR_PROJECTION and fixing > 1


def direct_projection(point: Array, image: Array) -> Array:
    """The 3 x 4 projection by direct linear transform, scaled to positive depth.  # (N, 3), (N, 2)"""
    middle, size = point.mean(axis=0), float(np.abs(point - point.mean(axis=0)).max())
    centre, spread = image.mean(axis=0), float(np.abs(image - image.mean(axis=0)).max())
    x = np.column_stack([(point - middle) / size, np.ones(len(point))])
    u = (image - centre) / spread
    zero = np.zeros_like(x)
    rows = np.concatenate([np.hstack([x, zero, -u[:, :1] * x]), np.hstack([zero, x, -u[:, 1:] * x])])
    _, vectors = np.linalg.eigh(rows.T @ rows)
    normalised = vectors[:, 0].reshape(3, 4)
    to_image = np.array([[spread, 0, centre[0]], [0, spread, centre[1]], [0, 0, 1.0]])
    from_point = np.diag([1 / size, 1 / size, 1 / size, 1.0])
    from_point[:3, 3] = -middle / size
    projection = to_image @ normalised @ from_point
    depth = x @ normalised[2]
    return np.asarray(projection * np.sign(np.median(depth)))


def _shows_front(mapped: Array, outline_mm: Array) -> Flags:
    """Whether faces turn their front to the camera: their outline runs clockwise in the image (v points down)."""
    depth = np.einsum("fkc,fc->fk", outline_mm, mapped[:, 2, :2]) + mapped[:, 2, 2:]
    with np.errstate(divide="ignore", invalid="ignore"):
        corner = np.einsum("fic,fkc->fki", mapped[:, :2, :2], outline_mm) + mapped[:, None, :2, 2]
        corner = corner / depth[:, :, None]
    after = np.roll(corner, -1, axis=1)
    area = (corner[..., 0] * after[..., 1] - after[..., 0] * corner[..., 1]).sum(axis=1)
    return np.asarray((depth.min(axis=1) > 0) & (area < 0))


def _width_over_length(mapped: Array) -> Array:
    """Of circles about the faces' origins in the image.  # (F, 3, 3) -> (F,)"""
    point = mapped[:, :2, 2] / mapped[:, 2:, 2]
    derivative = (mapped[:, :2, :2] - point[:, :, None] * mapped[:, 2:, :2]) / mapped[:, 2:, 2:]
    length = np.linalg.svd(derivative, compute_uv=False)
    return np.asarray(length[:, 1] / length[:, 0])


def predict(plan: TargetPlan, placement: Placement, image_size: tuple[int, int]) -> Places:
    """All features on faces that show, as far as they lie in the image."""
    target = plan.target
    row = np.flatnonzero(np.isfinite(placement.homography[:, 0, 0])[target.ring_face])
    row = row[np.argsort(target.ring_face[row], kind="stable")]
    face, plane, radius = target.ring_face[row], target.center_in_face_mm[row, :2], target.radius_outer_mm[row]
    return imaged(plan, placement, face, row, plane, radius, image_size)


def imaged(
    plan: TargetPlan,
    placement: Placement,
    face: Rows,
    ring: Rows,
    plane_mm: Array,
    radius_mm: Array,
    image_size: tuple[int, int],
) -> Places:
    """Circles in the planes of faces that show, as far as they lie in the image."""
    matrix, lens = placement.homography[face], placement.lens
    front = (matrix[:, 2, :2] * plane_mm).sum(axis=1) + matrix[:, 2, 2] > 0
    ring, plane_mm, radius_mm, matrix = ring[front], plane_mm[front], radius_mm[front], matrix[front]
    pixel = lens.distort(homography.apply(matrix, plane_mm))
    jacobian, _ = local_form(lens, pixel)
    shape = _shape(matrix, jacobian, plane_mm, radius_mm)
    inside = ((pixel > 2) & (pixel < np.array(image_size) - 3)).all(axis=1)
    # Beyond a lens's fold there are no rays.
    inside &= np.isfinite(jacobian).all(axis=(1, 2)) & (shape[:, 0] > 0) & (shape[:, 2] > 0)
    return Places(ring, pixel, shape).take(inside)


def _shape(matrix: Array, jacobian: Array, plane: Array, radius_mm: Array) -> Array:
    """E of circles in the image: E'E is the inverse of J J' R^2, J the derivative of the map from the plane."""
    mapped = np.einsum("nij,nj->ni", matrix[:, :, :2], plane) + matrix[:, :, 2]
    straight = mapped[:, :2] / mapped[:, 2:]
    derivative = (matrix[:, :2, :2] - straight[:, :, None] * matrix[:, 2:, :2]) / mapped[:, 2:, None]
    spread = derivative * radius_mm[:, None, None]
    with np.errstate(divide="ignore", invalid="ignore"):
        cross = spread[:, 0, 0] * spread[:, 1, 1] - spread[:, 0, 1] * spread[:, 1, 0]
        # inv(D) A takes pixels to radii.
        back = np.stack([spread[:, 1, 1], -spread[:, 0, 1], -spread[:, 1, 0], spread[:, 0, 0]], axis=1)
        to_radii = (back / cross[:, None]).reshape(-1, 2, 2) @ jacobian
        gram = np.swapaxes(to_radii, 1, 2) @ to_radii
        e11 = np.sqrt(np.maximum(gram[:, 1, 1], 1e-12))
        e10 = gram[:, 0, 1] / e11
        e00 = np.sqrt(np.maximum(gram[:, 0, 0] - e10**2, 1e-12))
    return np.stack([e00, e10, e11], axis=1)


def assign(plan: TargetPlan, candidates: Candidates, places: Places) -> Naming:
    """Pair places with the candidates at them: nearest in the plane, alike in size, one to one."""
    nearest, distance = nearest_candidates(
        candidates, places.center_px, places.shape, reach=REACH * plan.pitch_radii, size_ratio=SIZE_RATIO
    )
    found = np.flatnonzero(nearest >= 0)
    closest_first = found[np.argsort(distance[found], kind="stable")]
    _, first = np.unique(nearest[closest_first], return_index=True)
    rows = closest_first[first]
    rows = rows[np.argsort(places.ring[rows], kind="stable")]
    return Naming(nearest[rows], places.ring[rows])


def complete(
    plan: TargetPlan, candidates: Candidates, naming: Naming, image_size: tuple[int, int], camera_lens: Lens | None
) -> tuple[Naming, Placement]:
    """Place the target by the names so far, name what lies where features must be, and again until nothing is new."""
    read = np.unique(plan.target.ring_face[naming.ring])
    placement = place_faces(plan, candidates, naming, image_size, camera_lens, read)
    for _ in range(ROUNDS):
        wider = assign(plan, candidates, predict(plan, placement, image_size))
        if len(wider.ring) < 4 or len(wider.ring) < 0.5 * len(naming.ring):
            break
        grown = len(wider.ring) > len(naming.ring)
        naming = wider
        placement = place_faces(plan, candidates, naming, image_size, camera_lens, read)
        if not grown:
            break
    return naming, placement


def without_strangers(
    plan: TargetPlan, candidates: Candidates, naming: Naming, image_size: tuple[int, int], camera_lens: Lens | None
) -> tuple[Naming, tuple[int, ...]]:
    """Drop whole faces that no one projection of the solid brings together with the others.

    Each time the face goes without which the others agree best.
    """
    dropped: list[int] = []
    lens = _lens(plan, candidates, naming, image_size, camera_lens)
    while (worst := _worst_misfit(plan, candidates, naming, lens)) >= STRANGE:
        face = plan.target.ring_face[naming.ring]
        faces, count = np.unique(face, return_counts=True)
        rest = [Naming(naming.candidate[face != f], naming.ring[face != f]) for f in faces]
        misfit = [_worst_misfit(plan, candidates, part, lens) for part in rest]
        # Of two faces the one with more features stays: alone, either fits.
        best = min(range(len(faces)), key=lambda k: (misfit[k], count[k]))
        if len(faces) > 2 and misfit[best] >= worst:
            best = int(np.argmin(count))
        dropped.append(int(faces[best]))
        naming = rest[best]
    return naming, tuple(dropped)


def _worst_misfit(plan: TargetPlan, candidates: Candidates, naming: Naming, lens: Lens) -> float:
    """The largest of the faces' median distances from one projection of the solid, in pitches.

    0 if there are too few faces to disagree; infinite if only a mirrored projection fits.
    """
    straight = lens.straighten(candidates.ellipse[naming.candidate, :2])
    has_ray = np.isfinite(straight).all(axis=1)
    ring, straight = naming.ring[has_ray], straight[has_ray]
    face = plan.target.ring_face[ring]
    faces = np.unique(face)
    if not fixes_projection(plan.target.center_in_face_mm[ring, :2], face):
        return 0.0
    projection = direct_projection(plan.target.center_mm[ring], straight)
    if np.linalg.det(projection[:, :3]) < 0:
        return np.inf
    mapped = plan.target.center_mm[ring] @ projection[:, :3].T + projection[:, 3]
    off = np.linalg.norm(mapped[:, :2] / mapped[:, 2:] - straight, axis=1)
    share = off / (plan.pitch_radii * candidates.radius_px[naming.candidate[has_ray]])
    return max(float(np.median(share[face == f])) for f in faces)


def usual_nearby(plan: TargetPlan, places: Places, wanted: Flags, value: Array, is_known: Flags) -> Array:
    """Median of a value over the nearest places of a face that have a known one; nan: too few or not wanted.  # (N,)"""
    usual, face = np.full(len(value), np.nan), plan.target.ring_face[places.ring]
    for f in np.unique(face[wanted]):
        mine, known = (face == f) & wanted, np.flatnonzero((face == f) & is_known)
        if len(known) >= FEWEST_NEIGHBOURS:
            near = nearest_rows(places.center_px[mine], places.center_px[known], NEIGHBOURS)
            usual[mine] = np.median(value[known[near]], axis=1)
    return usual


def nearest_rows(point: Array, among: Array, most: int = 1) -> Rows:
    """Rows of the points among others that are nearest to each, in any order.  # (N, 2), (M, 2) -> (N, most)"""
    count = min(most, len(among))
    near = np.zeros((len(point), count), dtype=np.int64)
    for start in range(0, len(point), CHUNK):
        square = ((point[start : start + CHUNK, None] - among[None]) ** 2).sum(axis=2)
        if count == 1:
            near[start : start + CHUNK, 0] = np.argmin(square, axis=1)
        else:
            near[start : start + CHUNK] = np.argpartition(square, count - 1, axis=1)[:, :count]
    return near
