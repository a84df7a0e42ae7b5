"""The paper's synthetic sets made again: its two targets, photographed from 400 mm, detected, and told by incidence."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from calib.cameras import COMMON
from calib.cameras.camera import Camera, camera_or_preset
from calib.core.types import Detections, Observations, keep_sightings, keep_views, sightings_per_view
from calib.detector.pipeline import detect
from calib.observe.observations import observations_from_detections
from calib.observe.photos import PhotoFile, Pixels, detect_photos, named_photos
from calib.observe.truth import Truth, true_poses
from calib.renderer.job import RenderJob, run_job
from calib.renderer.options import RenderOptions
from calib.renderer.poses import PoseGrid, grid_poses
from calib.solver.solve import solve
from calib.studies.paper_table import BOARD, ICOSAHEDRON
from designer.base.errors import InputError
from designer.spec.kind import spec_from_mapping
from designer.spec.spec import SpecValue
from designer.target import TargetGeometry

DISTANCE_MM = 400.0
CAMERA = "machine-vision"
"""The paper gives no image size; its errors in mm and px fit 2500 px of focal length and 5 megapixels."""
FIRST_PHOTOS = 30
"""At most so many give the lens that all are searched with."""
LEAST_SIGHTINGS = 10
"""Of a view; one with fewer is not used."""

SAMPLINGS = {
    "binary": RenderOptions(sampling="binary"),
    "area": RenderOptions(blur_px=0.7, contrast_to_noise=100),
}
"""As the paper renders, one ray a pixel, black or white; and as a good camera sees: anti-aliased, blurred, noisy."""

_RINGS: Mapping[str, SpecValue] = {"ring_diameter_mm": 7, "ring_ratio": 0.45, "pitch_mm": 10, "margin_mm": 1}
PAPER_SPECS: Mapping[str, Mapping[str, SpecValue]] = {
    BOARD: {
        "kind": "board", "size_mm": [220, 220], "thickness_mm": 5, "columns": 21, "rows": 21, "lattice": "square",
        "border_mm": 0, "dots": True, **_RINGS,
    },
    ICOSAHEDRON: {"kind": "ico", "edge_mm": 100, "rings_per_side": 8, "border_mm": 2, **_RINGS},
}  # fmt: skip
"""The targets of the paper's study, as target files have their specs."""


def paper_targets() -> dict[str, TargetGeometry]:
    """A board of 220 mm and an icosahedron of 100 mm edge, both with rings of 7 mm every 10 mm."""
    return {name: spec_from_mapping(spec).lay_out() for name, spec in PAPER_SPECS.items()}


@dataclass(frozen=True)
class PhotoSet:
    """One target photographed with one sampling."""

    target: str
    sampling: str
    views: int
    seed: int = 1

    @property
    def name(self) -> str:
        """Of its folder."""
        return f"{self.target}-{self.sampling}-{self.views}-views-seed-{self.seed}"


def photograph(
    photos: PhotoSet, target: TargetGeometry, folder: Path, *, jobs: int, tell: Callable[[int], None]
) -> None:
    """Render what is missing of a set, from a hemisphere of poses that look at the target.

    Raises:
        InputError: the folder holds another set.
    """
    grid = PoseGrid(photos.views, np.pi / 2, (DISTANCE_MM, DISTANCE_MM), random_roll=False, aim_offset_mm=0.0)
    poses = grid_poses(grid, np.random.default_rng(photos.seed))
    job = RenderJob(target, camera_or_preset(CAMERA), poses, SAMPLINGS[photos.sampling], seed=photos.seed)
    run_job(job, folder, processes=jobs, overwrite=False, on_view=lambda done, _: tell(done))


def search(
    target: TargetGeometry,
    photos: Sequence[PhotoFile],
    camera: Camera | None,
    *,
    jobs: int,
    tell: Callable[[int], None],
) -> list[Detections]:
    """What the detector finds in photos, those without the target left out.

    Args:
        target: what they show.
        photos: to be searched.
        camera: whose lens is known, or None.
        jobs: photos at a time.
        tell: told how many are done.
    """
    seen = []

    def look(photo: PhotoFile, pixels: Pixels) -> Detections:
        return detect(pixels, target, name=photo.name, camera=camera)

    found = detect_photos(photos, target, look, jobs=jobs)
    for done, result in enumerate(found, start=1):
        tell(done)
        if result.seen is not None and len(result.seen.ring):
            seen.append(result.seen)
    return seen


def photos_in(folder: Path) -> tuple[PhotoFile, ...]:
    """The photos of a set."""
    return named_photos(sorted(folder.glob("*.png")))


def search_with_lens(
    target: TargetGeometry, folder: Path, *, jobs: int, tell: Callable[[int], None]
) -> list[Detections]:
    """What the detector finds with the lens of a first solution, which comes from some of the photos.

    Args:
        target: what the photos show.
        folder: where they lie.
        jobs: photos at a time.
        tell: told how many are done.

    Raises:
        InputError: the first search gives no camera.
    """
    photos = photos_in(folder)
    # Neighbours in the grid of poses are alike; photos far apart in it tell more.
    some = photos[:: math.ceil(len(photos) / FIRST_PHOTOS)]
    first = sightings(search(target, some, None, jobs=jobs, tell=lambda _: None), target, folder)
    return search(target, photos, solve(first, COMMON).camera, jobs=jobs, tell=tell)


def sightings(seen: Sequence[Detections], target: TargetGeometry, folder: Path) -> Observations:
    """What a camera is solved from.

    Raises:
        InputError: nothing that could be used was seen.
    """
    if not seen:
        raise InputError(f"{folder}: no photo shows the target; render them again in another folder")
    return observations_from_detections(seen, target, origin=str(folder))


def incidence_deg(seen: Observations, truth: Truth) -> NDArray[np.float64]:
    """Angle between the line of sight and the face's normal, of each sighting by the true poses.  # (M,)"""
    pose = true_poses(truth, seen.view_names)[seen.view]
    position = seen.points.position_mm[seen.point]
    normal = seen.points.plane[seen.points.face[seen.point], :3]
    eye = -np.einsum("mji,mj->mi", pose[:, :3, :3], pose[:, :3, 3])
    sight = eye - position
    cosine = (sight * normal).sum(axis=1) / np.linalg.norm(sight, axis=1)
    angle: NDArray[np.float64] = np.rad2deg(np.arccos(np.clip(cosine, -1, 1)))
    return angle


def only(seen: Observations, rows: NDArray[np.bool_]) -> Observations:
    """Some of the sightings, without views that keep too few."""
    kept = keep_sightings(seen, rows)
    return keep_views(kept, sightings_per_view(kept) >= LEAST_SIGHTINGS)
