"""Views of many targets, each before the files of all others: which names are wrong, and which nothing can refute."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache

import numpy as np

from calib.cameras.camera import Camera
from calib.core import homography
from calib.core.types import Detections
from calib.renderer import RenderOptions, View, render_view
from designer.kinds.board import BoardSpec
from designer.kinds.ico import IcoSpec
from designer.kinds.layout import lay_out
from designer.kinds.presets import preset_names, preset_or_file
from designer.kinds.sizing import size_job
from designer.kinds.spec_file import parse_spec, read_spec_file
from designer.spec.spec import Spec
from designer.target import TargetGeometry, bounding_radius_mm
from tests.benchmarks.synthetic import look_at, random_direction, wrong_names
from tests.support.ring_views import INTO_CORNER
from tests.support.sightings import pinhole

PLAIN = RenderOptions(blur_px=0.7, contrast_to_noise=50)
PROPORTIONS_APART = 1.1
"""Rings larger by this, over the pitch, can be told apart in a photo."""
SPACINGS_APART = 0.035
"""Faces farther apart by this, as a logarithm, over the pitch, can be told apart where two are seen."""


@cache
def template_targets() -> Mapping[str, TargetGeometry]:
    """Every target of `templates/`, by name."""
    files = {name: preset_or_file("targets", name) for name in preset_names("targets")}
    return {name: lay_out(size_job(parse_spec(read_spec_file(path), name)).job.target) for name, path in files.items()}


def random_target(rng: np.random.Generator) -> TargetGeometry:
    """A target sized as people do: a solid, or a board of any lattice, bordered or not, mostly with dots."""
    return lay_out(_random_solid(rng) if rng.random() < 0.4 else _random_board(rng))


def _random_solid(rng: np.random.Generator) -> Spec:
    """An icosahedron with 5 to 10 rings a side that fill its faces."""
    edge, rings = 100.0, int(rng.integers(5, 11))
    border = edge * rng.uniform(0.015, 0.035)
    pitch = (edge - 2 * np.sqrt(3) * border) / (rings - 1 + 2 * np.sqrt(3) * rng.uniform(0.5, 0.6))
    diameter = pitch * rng.uniform(0.6, 0.75)
    return IcoSpec(edge, rings, diameter, 0.45, pitch, border, 0.05 * pitch)


def _random_board(rng: np.random.Generator) -> Spec:
    """A board of 5 to 24 columns and rows."""
    columns, rows = (int(n) for n in rng.integers(5, 25, 2))
    pitch, border = 10.0, float(rng.integers(2)) * rng.uniform(2, 4)
    margin = rng.uniform(2, 5)
    size = ((columns + 1) * pitch + 2 * (border + margin), (rows + 1) * pitch + 2 * (border + margin))
    lattice = "square" if rng.random() < 0.6 else "triangular"
    diameter = pitch * rng.uniform(0.55, 0.78)
    has_dots = rng.random() < 0.8
    return BoardSpec(size, 5.0, columns, rows, lattice, diameter, 0.45, pitch, border, margin, dots=has_dots)


@dataclass(frozen=True, eq=False)
class Photo:
    """A view of a target, and the camera that took it."""

    target: TargetGeometry
    camera: Camera
    view: View


def photo_of(
    target: TargetGeometry,
    rng: np.random.Generator,
    *,
    options: RenderOptions = PLAIN,
    size: tuple[int, int] = (1200, 1000),
    radius_px: tuple[float, float] = (5.0, 16.0),
    is_whole: bool = False,
) -> Photo:
    """A view from a random side, from so far that rings in the middle have about a radius from the given range.

    Args:
        target: to look at.
        rng: of all that is random.
        options: light and blur.
        size: of the image.
        radius_px: of rings that face the camera.
        is_whole: whether all of the target has to fit into the image.
    """
    camera = pinhole(*size, 1.3 * size[0])
    focal, extent = 1.3 * size[0], bounding_radius_mm(target)
    radius = rng.uniform(*radius_px)
    distance = focal * float(np.median(target.radius_outer_mm)) / radius
    least = 1.3 * focal * 2 * extent / min(size) if is_whole else 1.5 * extent
    direction = random_direction(rng, is_board=False)
    if target.faces_up and not target.has_back:
        direction = np.array([*((0.7 if target.is_planar else INTO_CORNER) * rng.uniform(-1, 1, 2)), 1.0])
        direction /= np.linalg.norm(direction)
    aim = np.zeros(3) if is_whole else rng.uniform(-0.3, 0.3, 3) * extent
    pose = look_at(rng, direction, max(distance, least), aim)
    return Photo(target, camera, render_view(target, camera, pose, options, rng))


def is_alike(a: TargetGeometry, b: TargetGeometry) -> bool:
    """Whether two targets are one up to scale and what prints change: the same layout in the same proportions."""
    if a.layout_id != b.layout_id:
        return False
    size, spacing = (abs(math.log(of(a) / of(b))) for of in (_ring_over_pitch, _edge_over_pitch))
    return size < math.log(PROPORTIONS_APART) and (a.face_count == 1 or spacing < SPACINGS_APART)


def _pitch_mm(target: TargetGeometry) -> float:
    """The distance of neighbours."""
    return float(np.linalg.norm(target.lattice_mm[0], axis=1).min())


def _ring_over_pitch(target: TargetGeometry) -> float:
    """The outer radius over the pitch."""
    return float(np.median(target.radius_outer_mm)) / _pitch_mm(target)


def _edge_over_pitch(target: TargetGeometry) -> float:
    """The first edge of a face over the pitch."""
    return float(np.linalg.norm(target.outline_mm[0][1] - target.outline_mm[0][0])) / _pitch_mm(target)


def false_names(found: Detections, photo: Photo, asked: TargetGeometry) -> int:
    """How many names are wrong: of another target all, unless nothing in the photo could tell it from the one asked."""
    if is_alike(asked, photo.target):
        return _wrong_of_own(found, photo)
    return 0 if cannot_be_told(found, photo, asked) else len(found.ring)


def _wrong_of_own(found: Detections, photo: Photo) -> int:
    """Names of the photo's own target that are wrong; without dots a board has several right ways, all on its rings."""
    view = photo.view
    if photo.target.is_dot.any():
        return int(wrong_names(found, photo.target, view.center_px, view.visible).sum())
    apart = np.linalg.norm(found.center_px[:, None] - view.center_px[view.visible][None], axis=2)
    return int((apart.min(axis=1) > 2).sum()) if len(found.ring) else 0


def cannot_be_told(found: Detections, photo: Photo, asked: TargetGeometry) -> bool:
    """Whether a photo shows only what the target asked for has at the same places, proportions alike.

    Of a solid that is one face: how far the faces are apart then shows nowhere. Of a board it is a part whose ring
    names, counted from the dots, are the same in both files, as are distances; the rest lies outside the image.
    """
    shown, view = photo.target, photo.view
    if shown.face_count > 1 or asked.face_count > 1:
        is_one_face = len(np.unique(asked.ring_face[found.ring])) < 2
        is_of_size = abs(math.log(_ring_over_pitch(shown) / _ring_over_pitch(asked))) < math.log(PROPORTIONS_APART)
        return shown.layout_id == asked.layout_id and is_one_face and is_of_size
    steps = [board.lattice_mm[0] / np.linalg.norm(board.lattice_mm[0], axis=1).min() for board in (shown, asked)]
    size = [_ring_over_pitch(board) for board in (shown, asked)]
    if np.abs(steps[0] - steps[1]).max() > 0.01 or max(size) > PROPORTIONS_APART * min(size):
        return False
    row_of = {tuple(index): row for row, index in enumerate(shown.ring_index.tolist())}
    same = np.array([row_of.get(tuple(asked.ring_index[row].tolist()), -1) for row in found.ring], dtype=np.int64)
    if (same < 0).any() or (np.linalg.norm(found.center_px - view.center_px[same], axis=1) > 3).any():
        return False
    # All that can be seen is what was asked for; what was asked for and is not there lies outside the image.
    asked_dot = {tuple(index): dot for index, dot in zip(asked.ring_index.tolist(), asked.is_dot.tolist(), strict=True)}
    seen = [tuple(index) for index in shown.ring_index[view.clean].tolist()]
    if any(index not in asked_dot for index in seen):
        return False
    beyond = np.array([index for index in asked_dot if index not in row_of]).reshape(-1, 2)
    if not len(beyond):
        return True
    known = np.isfinite(view.center_px).all(axis=1)
    plane = shown.ring_index[known].astype(np.float64)
    matrix = homography.direct(plane, view.center_px[known])
    # A ring that the image's edge cuts cannot be told from one that is not there.
    turn = np.pi / 4 * np.arange(8)
    around_mm = float(np.median(asked.radius_outer_mm)) * np.stack([np.cos(turn), np.sin(turn)], axis=1)
    outline = beyond[:, None] + around_mm @ np.linalg.inv(asked.lattice_mm[0])
    place = homography.apply(matrix, outline.reshape(-1, 2)).reshape(outline.shape)
    width, height = photo.camera.image_size
    return bool(~((place > 0) & (place < [width - 1, height - 1])).all(axis=(1, 2)).any())
