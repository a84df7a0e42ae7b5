"""The paper's synthetic sets made again: its two targets, photographed from 400 mm, detected, and told by incidence."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from calib.camera_file import camera_or_preset
from calib.detect.batch import detect_photos, named_photos
from calib.detect.pipeline import detect
from calib.inputs.observations import dataset_of, observations_from_detections
from calib.render.job import RenderJob, run_job
from calib.render.options import RenderOptions
from calib.render.poses import PoseGrid, grid_poses
from calib.results.truth import Truth, true_poses
from calib.sightings import keep_sightings, keep_views, sightings_per_view
from calib.solver.solve import solve
from calib.types import Camera, Detections, Observations
from designer.errors import InputError
from designer.layout import lay_out
from designer.spec import BoardSpec, IcoSpec
from designer.target import TargetGeometry

DISTANCE_MM = 400.0
CAMERA = "machine-vision"
"""The paper gives no image size; its errors in mm and px fit 2500 px of focal length and 5 megapixels."""
LEAST_SIGHTINGS = 10
"""Of a view; one with fewer is not used."""

SAMPLINGS = {
    "binary": RenderOptions(sampling="binary"),
    "area": RenderOptions(blur_px=0.7, contrast_to_noise=100),
}
"""As the paper renders, one ray a pixel, black or white; and as a good camera sees: anti-aliased, blurred, noisy."""


def paper_targets() -> dict[str, TargetGeometry]:
    """A board of 220 mm and an icosahedron of 100 mm edge, both with rings of 7 mm every 10 mm."""
    board = BoardSpec(
        size_mm=(220, 220), thickness_mm=5, columns=21, rows=21, lattice="square", ring_diameter_mm=7,
        ring_ratio=0.45, pitch_mm=10, border_mm=0, margin_mm=1, dots=True,
    )  # fmt: skip
    ico = IcoSpec(
        edge_mm=100, rings_per_side=8, ring_diameter_mm=7, ring_ratio=0.45, pitch_mm=10, border_mm=2, margin_mm=1
    )
    return {"board": lay_out(board), "icosahedron": lay_out(ico)}


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
    target: TargetGeometry, folder: Path, camera: Camera | None, *, jobs: int, tell: Callable[[int], None]
) -> list[Detections]:
    """What the detector finds in a folder of photos, those without the target left out.

    Args:
        target: what they show.
        folder: where they lie.
        camera: whose lens is known, or None.
        jobs: photos at a time.
        tell: told how many are done.
    """
    found = detect_photos(
        named_photos(sorted(folder.glob("*.png"))), target, detect=detect, camera=camera, overlay_folder=None, jobs=jobs
    )
    seen = []
    for done, result in enumerate(found, start=1):
        tell(done)
        if result.seen is not None and len(result.seen.ring):
            seen.append(result.seen)
    return seen


def search_twice(target: TargetGeometry, folder: Path, *, jobs: int, tell: Callable[[int], None]) -> list[Detections]:
    """What the detector finds with the lens of a first solution, as a person's photos are searched.

    Args:
        target: what the photos show.
        folder: where they lie.
        jobs: photos at a time.
        tell: told how many are done, of twice as many as there are photos.

    Raises:
        InputError: the first search gives no camera.
    """
    done = 0

    def count(_: int) -> None:
        nonlocal done
        done += 1
        tell(done)

    first = sightings(search(target, folder, None, jobs=jobs, tell=count), target, folder)
    return search(target, folder, solve(first, "opencv").camera, jobs=jobs, tell=count)


def sightings(seen: Sequence[Detections], target: TargetGeometry, folder: Path) -> Observations:
    """What a camera is solved from.

    Raises:
        InputError: nothing that could be used was seen.
    """
    if not seen:
        raise InputError(f"{folder}: no photo shows the target; render them again in another folder")
    return observations_from_detections(dataset_of(seen), target, origin=str(folder)).observations


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
