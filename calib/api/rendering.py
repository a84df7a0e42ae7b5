"""Synthetic photos of a target from known poses: one as an array, or a set in a folder."""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from os import PathLike
from pathlib import Path
from typing import get_args

import numpy as np

from calib.app.inputs import DISTANCES_MM, MAX_SEED, Place, camera_of, folder_of, processes_of, target_of
from calib.cameras.camera import Camera
from calib.core.se3 import rigid_fault
from calib.core.types import LEAST_RADIUS_PX
from calib.renderer.faces import ring_truth, target_fits
from calib.renderer.job import Rendered, RenderJob, run_job
from calib.renderer.light import Levels
from calib.renderer.options import LIMITS, Bits, RenderOptions, Sampling
from calib.renderer.poses import MAX_VIEWS, PoseGrid, Region, load_poses, photo_poses
from calib.renderer.quantities import choice, real, whole
from calib.renderer.scene import RenderScene, scene_from_target
from calib.renderer.truth import TRUTH_FILE, FileFormat
from calib.renderer.view import render_view
from designer.base.arrays import Array
from designer.base.errors import InputError
from designer.base.words import shown
from designer.page.progress import Progress, unheard
from designer.target import TargetGeometry, bounding_radius_mm

CHECKED_VIEWS = 50
HALF_ANGLE_RAD = {"hemisphere": math.pi / 2, "sphere": math.pi}


@dataclass(frozen=True, eq=False)
class RenderedPhotos:
    """Photos that are rendered when they are asked for: `photos.image(0)`, `photos.save("photos")`."""

    job: RenderJob  # all that determines them
    looks_aside: bool = False  # a target that reaches beyond the image was asked for

    @property
    def cam_from_target(self) -> Array:
        """Where the camera stands in each.  # (V, 4, 4)"""
        return self.job.cam_from_target

    @cached_property
    def scene(self) -> RenderScene:
        """The target as rays meet it."""
        return scene_from_target(self.job.target)

    @cached_property
    def warnings(self) -> tuple[str, ...]:
        """What will make detection hard, from a sample of the views, one line each."""
        return tuple(_warnings(self))

    def image(self, number: int) -> Levels:
        """A photo, the same as the file that `save` writes of it.  # (H, W)"""
        job = self.job
        number = whole("photo", number, 0, len(job.cam_from_target) - 1)
        rng = np.random.default_rng([job.seed, number])
        return render_view(self.scene, job.camera, job.cam_from_target[number], job.options, rng).image

    def save(
        self, folder: Place, *, jobs: int | None = 1, overwrite: bool = False, progress: Progress = unheard
    ) -> Rendered:
        """Render what is missing in a folder, with the `truth.json` of all.

        Args:
            folder: for them; made if need be.
            jobs: processes; None: one per core. More than one start Python anew, so that a script needs the usual
                `if __name__ == "__main__":` around what it does.
            overwrite: replace another set that is there.
            progress: is told how many are done.

        Raises:
            InputError: the folder holds another set, or images of unknown origin.
        """
        processes = processes_of(jobs)
        return run_job(
            self.job, folder_of(folder), processes=processes, overwrite=overwrite,
            on_view=lambda done, total: progress("rendering", done, total),
        )  # fmt: skip

    def files_in(self, folder: Place) -> tuple[Path, ...]:
        """Those of the set that are there."""
        names = (*self.job.file_names, TRUTH_FILE)
        return tuple(path for path in (Path(folder) / name for name in names) if path.exists())


def render(
    target: TargetGeometry | Place,
    camera: Camera | Place = "machine-vision",
    *,
    views: int = 20,
    distance_mm: float | tuple[float, float] = 400.0,
    region: Region | None = None,
    cap_rad: float = math.pi / 3,
    random_roll: bool = False,
    aim_offset_mm: float = 0.0,
    aside_rad: float | None = None,
    poses: Array | Place | None = None,
    options: RenderOptions | None = None,
    seed: int = 0,
    file_format: FileFormat = "png",
    quality: int = 95,
) -> RenderedPhotos:
    """Photos of a target as a camera would take them: `render("ico.target.json", views=30).save("photos")`.

    >>> image = calib.render(geometry, camera, poses=cam_from_target).image(0)

    Args:
        target: a geometry, or its file.
        camera: a camera, a file, or a template.
        views: how many, on a Fibonacci grid.
        distance_mm: from the target's origin, or the nearest and farthest.
        region: of the grid; None: a cap for a flat target, else the sphere.
        cap_rad: half angle of a cap.
        random_roll: turn the camera about its axis at random.
        aim_offset_mm: look past the origin, by up to this.
        aside_rad: see what is aimed at so far off the axis, drawn evenly over the image; None: up to where the image
            of a wide lens ends, straight ahead with others.
        poses: `cam_from_target` (V, 4, 4) or one (4, 4), or a JSON or CSV file of them, instead of a grid.
        options: light, lens and sensor; None: plain ones, without noise.
        seed: of all that is random.
        file_format: of the files that are saved.
        quality: of JPEG.

    Raises:
        InputError: a file that cannot be read, or a value that breaks a rule.
    """
    geometry, taken = target_of(target, "marks"), camera_of(camera)
    light = RenderOptions() if options is None else options
    check_light(light, file_format)
    seed, looks_aside = whole("--seed", seed, 0, MAX_SEED), False
    if poses is None:
        grid = _grid(geometry, views, distance_mm, region, cap_rad, aim_offset_mm, random_roll=random_roll)
        aside_rad = None if aside_rad is None else real("--aside", aside_rad, 0, math.pi, " rad")
        where, limit_rad = photo_poses(grid, taken, seed, aside_rad)
        looks_aside = aim_offset_mm > 0 or limit_rad > 0
    elif isinstance(poses, str | PathLike):
        where = load_poses(Path(poses))
    else:
        where = _checked_poses(poses)
    job = RenderJob(geometry, taken, where, light, seed, file_format, whole("--quality", quality, 1, 100))
    return RenderedPhotos(job, looks_aside=looks_aside)


def check_light(options: RenderOptions, file_format: FileFormat) -> None:
    """Refuse what is out of its limits, or does not go together."""
    if not isinstance(options, RenderOptions):
        raise InputError(f"options {shown(options)}: is of type {type(options).__name__}; give calib.RenderOptions")
    for name, (low, high) in LIMITS.items():
        if (value := getattr(options, name)) is not None:
            real(f"--{name.removesuffix('_px').removesuffix('_mm').replace('_', '-')}", value, low, high)
    whole("--clutter", options.clutter, 0, int(LIMITS["clutter"][1]))
    choice("--sampling", options.sampling, get_args(Sampling))
    if options.bits not in get_args(Bits):
        raise InputError(f"--bits {options.bits}: must be 8 or 16, or 32 for arrays of float32")
    if options.white <= options.black:
        raise InputError(
            f"--white {100 * options.white:g}% is not lighter than --black {100 * options.black:g}%; the target would "
            "not show"
        )
    if options.focus_mm is not None and not options.aperture_mm:
        raise InputError("--focus says nothing without --aperture; add an --aperture such as 5mm")
    choice("--format", file_format, get_args(FileFormat))
    if file_format == "jpeg" and options.bits == 16:
        raise InputError("--bits 16 does not fit --format jpeg, which holds 8; use png or tiff")


def _grid(
    target: TargetGeometry,
    views: int,
    distance_mm: float | tuple[float, float],
    region: Region | None,
    cap_rad: float,
    aim_offset_mm: float,
    *,
    random_roll: bool,
) -> PoseGrid:
    """Poses on a Fibonacci grid."""
    both = distance_mm if isinstance(distance_mm, tuple) and len(distance_mm) == 2 else (distance_mm, distance_mm)
    near, far = (real("--distance", one, *DISTANCES_MM, "mm") for one in both)
    aim_offset_mm = real("--aim-offset", aim_offset_mm, 0, DISTANCES_MM[1], "mm")
    inside = bounding_radius_mm(target)
    if not inside + aim_offset_mm < near <= far:
        raise InputError(
            f"--distance {near:g}mm: the target reaches {inside:.0f}mm from its origin, "
            f"and the aim {aim_offset_mm:g}mm; stay farther away"
        )
    where = choice("--region", region or ("cap" if target.is_plate else "sphere"), get_args(Region))
    half_angle = {**HALF_ANGLE_RAD, "cap": real("--cap-angle", cap_rad, 0, math.pi, " rad")}[where]
    is_two_sided = where == "cap" and target.has_back
    return PoseGrid(
        whole("--views", views, 1, MAX_VIEWS), half_angle, (near, far), random_roll, aim_offset_mm, is_two_sided
    )


def _checked_poses(poses: Array) -> Array:
    """Poses (V, 4, 4) of an array.

    Raises:
        InputError: another shape, or no rigid motions.
    """
    try:
        where = np.asarray(poses, dtype=np.float64)
    except (TypeError, ValueError):
        raise InputError("poses are no numbers: give cam_from_target (V, 4, 4)") from None
    where = where[None] if where.ndim == 2 else where
    if where.shape[1:] != (4, 4) or not len(where):
        raise InputError(f"poses of shape {where.shape}: give cam_from_target (V, 4, 4)")
    if fault := rigid_fault(where):
        raise InputError(f"pose {fault[0]}: {fault[1]}; it must be a rigid motion")
    return where


def _warnings(photos: RenderedPhotos) -> Iterator[str]:
    job = photos.job
    if job.options.white * (1 + job.options.light_gradient / 2) > 1.001:
        yield "the light gradient takes the white beyond full scale; lower --white"
    count = len(job.cam_from_target)
    sample = np.unique(np.linspace(0, count - 1, min(count, CHECKED_VIEWS)).round().astype(int))
    poses = job.cam_from_target[sample]
    fitting = sum(target_fits(job.target, job.camera, pose) for pose in poses)
    if fitting < len(poses) and not photos.looks_aside:
        yield (
            f"the target reaches beyond the image in {1 - fitting / len(poses):.0%} of the views; "
            "stand farther away to see all of it"
        )
    truths = [ring_truth(photos.scene, job.camera, pose) for pose in poses]
    radius = np.concatenate([truth.minor_radius_px[truth.visible] for truth in truths])
    if not len(radius):
        yield "no ring faces the camera in any view; check the poses"
    elif (largest := float(radius.max())) < LEAST_RADIUS_PX:
        from calib.show.photos.rendered_photos import too_small_words

        yield too_small_words(largest)
