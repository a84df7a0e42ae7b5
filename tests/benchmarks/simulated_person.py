"""Persons who take photos of targets, for judging guidance: sightings are computed, not rendered.

Each hands in poses as he can hold them: one waves the target about, one fills the bars of ROS' cameracalibrator, one
follows a ghost.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from calib.cameras import project, rays
from calib.cameras.camera import Camera
from calib.core.se3 import exp_rotation, make_pose, rotation_between, transform
from calib.core.types import Detections
from calib.judge.guide import Guide
from calib.judge.views import px_per_mm
from designer.base.arrays import Array, Rows
from designer.target import TargetGeometry
from designer.tolerance.error_file import error_model
from designer.tolerance.model import perturb
from tests.support.guided_scenes import TREMOR_MM, board_target, held_by_person, ico_target

SIZES = ((640, 480), (1280, 720), (1920, 1080), (2448, 2048), (4000, 3000))
BOARDS = ((9, 7), (12, 9), (16, 12), (20, 15))
FINE_PX, UNREAD_PX = 8.0, 2.5
"""Half the short axis of a ring's image, from which on its centre is as sure as it gets, and below which it is lost."""
INCIDENCE_DEG, LOST_SHARE = 72.0, 0.02
FACE_SHARE = 0.4
"""Of a face, so much must be in the image for its rings to be named."""
FEWEST_RINGS = 12
FILLS = (0.3, 1.0)
"""Of the image's shorter side, what a target fills that is waved about."""
WAVED_TILT_DEG = 45.0
MOST_TRIES, MOST_SKIPS = 8, 3
CLOSE = 0.1
"""Of the distance, to which a target that is held near is held at least, with its ghost in the picture."""


@dataclass(frozen=True, eq=False)
class PhotoScene:
    """A camera and a target that somebody has, and what is believed of the target."""

    name: str
    camera: Camera  # the true one
    target: TargetGeometry  # as its file has it
    true_target: TargetGeometry  # as it came out
    made: str  # how it is said to be made
    noise_px: float  # of the centres of large rings

    @property
    def is_flat(self) -> bool:
        """Whether the target is a board."""
        return self.target.is_planar

    @property
    def extent_mm(self) -> float:
        """Of the target."""
        return float(np.ptp(self.target.center_mm, axis=0).max())


def scene_of(seed: int, *, made: str = "exact", is_lens_odd: bool = False) -> PhotoScene:
    """A draw of a camera and a target.

    Args:
        seed: of the draw; the same camera and target for all the rest.
        made: `exact`, or an error template for boards and another for icosahedra: "sheet-print,fdm-dual-calibrated".
        is_lens_odd: the lens does a little that the model it is solved with does not have.
    """
    rng = np.random.default_rng([20, seed])
    camera = _camera(rng, is_lens_odd=is_lens_odd)
    if is_board := bool(rng.random() < 0.5):
        columns, rows = BOARDS[int(rng.integers(len(BOARDS)))]
        target = board_target(columns, rows, float(rng.uniform(8, 25)))
    else:
        target = ico_target(float(np.exp(rng.uniform(np.log(20), np.log(100)))), int(rng.integers(5, 9)))
    noise_px = float(rng.uniform(0.03, 0.08))
    ways = made.split(",")
    way = ways[0] if is_board else ways[-1]
    true_target = target if way == "exact" else perturb(target, error_model(way), rng)
    kind = "board" if is_board else "ico"
    name = f"{seed:3} {kind:5} {len(target.ring_face):4} rings {np.ptp(target.center_mm, axis=0).max():4.0f} mm"
    return PhotoScene(
        f"{name} {camera.model:8} {camera.image_size[0]:4} px", camera, target, true_target, way, noise_px
    )


def _camera(rng: np.random.Generator, *, is_lens_odd: bool) -> Camera:
    """30 to 110 degrees wide, with up to 25 % of barrel distortion at its sides if it is wide."""
    size = SIZES[int(rng.integers(len(SIZES)))]
    width = size[0]
    half = float(np.tan(np.radians(rng.uniform(30, 110) / 2)))
    bend = float(rng.uniform(0.0, 0.25)) * min(half, 1.0)
    focal = 0.5 * width / (half * (1 - bend))
    middle = 0.5 * (np.array(size) - 1) + 0.01 * width * rng.standard_normal(2)
    head = [focal, focal * (1 + 1e-3 * float(rng.standard_normal())), *middle.tolist()]
    tangential = (3e-4 * rng.standard_normal(2)).tolist()
    prism = 0.15 / focal / half**2 * rng.standard_normal(4) * [1, 1 / half**2, 1, 1 / half**2]
    brown = [-1.3 * bend / half**2, 0.3 * bend / half**4, *tangential, 0.0]
    if is_lens_odd:
        return Camera("opencv12", np.array([*head, *brown, 0, 0, 0, *prism]), size)
    return Camera("opencv", np.array([*head, *brown]), size)


def photograph(scene: PhotoScene, pose: Array, rng: np.random.Generator, name: str) -> Detections:
    """What is found in a photo with the target at a pose (4, 4)."""
    target, camera = scene.true_target, scene.camera
    normal = target.target_from_face[target.ring_face, :3, 2] @ pose[:3, :3].T
    place = transform(pose, target.center_mm)
    cosine = -(place * normal).sum(axis=1) / np.linalg.norm(place, axis=1)
    pixel = project(camera, place)
    with np.errstate(invalid="ignore"):
        minor_px = target.radius_outer_mm * px_per_mm(camera, place) * cosine
        inside = ((pixel > minor_px[:, None]) & (pixel < np.array(camera.image_size) - 1 - minor_px[:, None])).all(
            axis=1
        )
        read = inside & (cosine > np.cos(np.radians(INCIDENCE_DEG))) & (place[:, 2] > 0) & (minor_px > UNREAD_PX)
    share = np.bincount(target.ring_face[read], minlength=len(target.target_from_face)) / np.bincount(target.ring_face)
    read &= (share >= FACE_SHARE)[target.ring_face] & (rng.random(len(read)) >= LOST_SHARE)
    ring = np.flatnonzero(read)
    sigma = scene.noise_px * np.sqrt(np.maximum(FINE_PX / minor_px[ring], 1.0))
    center = pixel[ring] + sigma[:, None] * rng.standard_normal((len(ring), 2))
    ellipse = np.column_stack([center, minor_px[ring], minor_px[ring], np.zeros(len(ring))])
    nominal = scene.target
    return Detections(
        name, camera.image_size, nominal.layout_id, nominal.geometry_id, ring, nominal.center_mm[ring], center,
        sigma[:, None, None] ** 2 * np.eye(2), ellipse, (),
    )  # fmt: skip


def waved(scene: PhotoScene, rng: np.random.Generator) -> Iterator[Detections]:
    """Photos while the target is waved about: anywhere in the picture, near and far, tilted by 45 degrees at most."""
    number, middle = 0, 0.5 * (scene.target.center_mm.min(axis=0) + scene.target.center_mm.max(axis=0))
    while True:
        turn = _any_turn(scene, rng)
        ray = rays(scene.camera, rng.uniform(0.05, 0.95, 2) * (np.array(scene.camera.image_size) - 1))
        fills = float(np.exp(rng.uniform(*np.log(FILLS))))
        distance = scene.extent_mm * scene.camera.params[0] / (fills * min(scene.camera.image_size))
        if not scene.is_flat:
            distance += 0.5 * scene.extent_mm
        turn = rotation_between(np.array([0.0, 0.0, 1.0])[None], ray[None])[0] @ turn
        pose = make_pose(turn, distance * ray - turn @ middle)
        found = photograph(scene, pose, rng, f"{number:04d}.png")
        if len(found.ring) >= FEWEST_RINGS:
            number += 1
            yield found


def _any_turn(scene: PhotoScene, rng: np.random.Generator) -> Array:
    """Of a target straight ahead: a board about upright and tilted, a solid anyhow."""
    if not scene.is_flat:
        axis = rng.standard_normal(3)
        return exp_rotation(axis / np.linalg.norm(axis) * rng.uniform(0, np.pi))
    side, tilt = rng.uniform(-np.pi, np.pi), np.radians(rng.uniform(0, WAVED_TILT_DEG))
    roll = exp_rotation(np.array([0.0, 0.0, np.radians(10) * rng.standard_normal()]))
    return exp_rotation(tilt * np.array([np.cos(side), np.sin(side), 0.0])) @ roll @ np.diag([1.0, -1.0, -1.0])


@dataclass(frozen=True)
class RosBars:
    """The rule of ROS' cameracalibrator: which photos of a board count, and when they are enough.

    A photo is four numbers: where the board is, right and down, of the room it has; how large; and by how much the
    angle at a corner is not a right one. It counts if the sum of their differences from those of each photo so far is
    more than 0.2; enough are 40, or those whose numbers range over .7, .7, .4 and .5, the last two from zero.
    """

    samples: tuple[tuple[float, ...], ...] = ()

    LEAST_APART, RANGES, MOST = 0.2, (0.7, 0.7, 0.4, 0.5), 40

    def takes(self, sample: tuple[float, ...]) -> bool:
        """Whether a photo counts."""
        apart = [sum(abs(a - b) for a, b in zip(sample, one, strict=True)) for one in self.samples]
        return all(value > self.LEAST_APART for value in apart)

    def plus(self, sample: tuple[float, ...]) -> "RosBars":
        """With a photo."""
        return replace(self, samples=(*self.samples, sample))

    @property
    def are_full(self) -> bool:
        """Whether the photos are enough."""
        if not self.samples:
            return False
        value = np.array(self.samples)
        low = np.where([True, True, False, False], value.min(axis=0), 0.0)
        return len(value) >= self.MOST or bool((value.max(axis=0) - low >= self.RANGES).all())


def ros_sample(scene: PhotoScene, found: Detections) -> tuple[float, ...] | None:
    """The four numbers of a photo of a board; None if a corner of the board is not in it."""
    corners = _corner_rings(scene.target)
    if not np.isin(corners, found.ring).all():
        return None
    a, b, c, d = (found.center_px[found.ring == ring][0] for ring in corners)
    first, second = c - a, d - b
    area = 0.5 * abs(first[0] * second[1] - first[1] * second[0])
    side, (width, height) = np.sqrt(area), found.image_size
    before, after = a - b, c - b
    angle = np.arccos(before @ after / np.linalg.norm(before) / np.linalg.norm(after))
    place = (found.center_px.mean(axis=0) - side / 2) / (np.array([width, height]) - side)
    x, y = np.clip(place, 0, 1).tolist()
    return x, y, float(np.sqrt(area / (width * height))), float(min(1.0, 2 * abs(np.pi / 2 - angle)))


def _corner_rings(target: TargetGeometry) -> Rows:
    """Rings in the corners of a board, in order around it."""
    x, y = target.center_mm[:, 0], target.center_mm[:, 1]
    return np.array([np.argmin(x - y), np.argmax(x + y), np.argmax(x - y), np.argmin(x + y)])


def filling_bars(scene: PhotoScene, rng: np.random.Generator) -> Iterator[tuple[Detections, RosBars]]:
    """Photos of a board that is waved about in front of ROS' cameracalibrator, and its bars after each."""
    bars = RosBars()
    for found in waved(scene, rng):
        sample = ros_sample(scene, found)
        if sample is not None and bars.takes(sample):
            bars = bars.plus(sample)
            yield replace(found, image=f"{len(bars.samples):04d}.png"), bars


def taken_with(guide: Guide, scene: PhotoScene, rng: np.random.Generator) -> tuple[Guide, int]:
    """The guide after one more photo of a person who follows its ghost, and how often the ghost was given up.

    He tries until the frame is wanted, now and then asks for another ghost, and takes what he has in the end.
    """
    name = f"{len(guide.photos):04d}.png"
    for skipped in range(MOST_SKIPS + 1):
        ghost, found = guide.told.ghost, None
        if ghost is None:
            return guide, skipped
        for _ in range(MOST_TRIES):
            near = min(1.0, CLOSE * ghost.distance_mm / TREMOR_MM)
            pose = held_by_person(ghost.cam_from_target, scene.target, rng, steady=near)
            found = photograph(scene, pose, rng, name)
            if guide.look(found).is_wanted:
                return guide.with_photo(found), skipped
        if skipped < MOST_SKIPS:
            guide = guide.skipping()
    return (guide if found is None else guide.with_photo(found)), MOST_SKIPS
