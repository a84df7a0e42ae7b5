"""Synthetic photos of a target from known poses, of one camera or of a rig's: `calib render`, `calib.render(...)`."""

import math
from os import PathLike, fspath
from typing import TYPE_CHECKING, Annotated

from calib.app.options import (
    MAX_SEED,
    MOST_DISTANCE_MM,
    MOST_VIEWS,
    CameraTemplate,
    Jobs,
    RigTemplate,
    Seed,
    TargetFile,
)
from calib.app.rendered_photos import RenderedPhotos, RenderedRig
from calib.renderer.options import FileFormat, Region, RenderOptions
from designer.base.errors import InputError
from designer.base.options import option
from designer.page.capability import capability, instead, written_to
from designer.page.progress import Progress, unheard

if TYPE_CHECKING:
    from calib.app.inputs import Place
    from designer.base.arrays import Array
    from designer.page.output import Output

QUALITY = 95
Distance = Annotated[
    tuple[float, float] | float | None,
    option("from the target's origin: 250mm..800mm (default: 400mm; of a rig as its template says)", 1,
           MOST_DISTANCE_MM),
]  # fmt: skip
Format = Annotated[FileFormat, option("png, tiff or jpeg", flag="--format")]
Quality = Annotated[int | None, option(f"of JPEG (default: {QUALITY})", 1, 100)]
Folder = Annotated["Output | Place | None", written_to("folder for the images and truth.json", is_needed=True)]
Overwrite = Annotated[bool, option("replace another set in the folder")]


@capability
def render_rig(
    target: TargetFile,
    rig: RigTemplate = "stereo-pair",
    *,
    frames: Annotated[int, option("of a rig: how many times the target is shown to its cameras", 1, 10_000)] = 30,
    unsynchronised_s: Annotated[
        float, option("of a rig: the target moves, and the cameras' clocks differ by up to this: 30ms", 0, 1)
    ] = 0.0,
    distance_mm: Distance = None,
    options: RenderOptions | None = None,
    seed: Seed = 0,
    file_format: Format = "png",
    quality: Quality = None,
    out: Folder = None,
    jobs: Jobs = None,
    overwrite: Overwrite = False,
    progress: Progress = unheard,
) -> RenderedRig:
    """Photos of a target as the cameras of a rig would take them: `render_rig("ico.target.json").save("photos")`.

    In each frame the target is held to one of the cameras in turn, every second frame so that most others see it too.
    It stands still, unless the cameras are not synchronous: then it moves along a smooth way.

    Args:
        unsynchronised_s: by how much the clocks of the cameras but the first run behind or ahead, at most; photos of
            one frame are taken earlier or later by a tenth of it besides, as their time stamps say.
        options: light, lens and sensor; None: plain ones, without noise.
        out: folder to render them into at once, as the rest says, of which `save` tells; None: none.

    Raises:
        InputError: a file that cannot be read, or a value that breaks a rule.
    """
    import numpy as np

    from calib.app.inputs import target_of
    from calib.renderer.held_target import held_frames
    from calib.renderer.job import RenderJob
    from calib.renderer.rig_template import held_before, simulated_rig

    geometry, simulated = target_of(target, "marks"), simulated_rig(rig)
    light = _stored(options, file_format, quality)
    held = held_frames(
        simulated.rig, geometry, held_before(simulated, distance_mm), frames, unsynchronised_s,
        np.random.default_rng([seed, frames]),
    )  # fmt: skip
    of = {
        name: RenderedPhotos(
            RenderJob(geometry, camera, cam_from_rig @ seen, light, (seed + row) % (MAX_SEED + 1), file_format,
                      QUALITY if quality is None else quality),
            looks_aside=True,
        )
        for row, (name, camera, cam_from_rig, seen) in enumerate(
            zip(held.rig.names, held.rig.cameras, held.rig.cam_from_rig, held.as_seen, strict=True)
        )
    }  # fmt: skip
    photos = RenderedRig(simulated, held, of, target_file=_file_name(target))
    return photos.rendered_into(out, jobs, overwrite=overwrite, progress=progress)


@instead(rig=render_rig)
@capability
def render(
    target: TargetFile,
    camera: CameraTemplate = "machine-vision",
    *,
    views: Annotated[int | None, option("how many photos (default: 20)", 1, MOST_VIEWS)] = None,
    distance_mm: Distance = None,
    region: Annotated[
        Region | None, option("hemisphere, sphere or cap (default: cap for a board, else sphere)")
    ] = None,
    cap_rad: Annotated[
        float | None, option("half angle of the cap (default: 60deg)", 0, math.pi, flag="--cap-angle")
    ] = None,
    random_roll: Annotated[bool, option("turn the camera about its axis at random")] = False,
    aim_offset_mm: Annotated[float | None, option("look past the origin, by up to this", 0, MOST_DISTANCE_MM)] = None,
    aside_rad: Annotated[
        float | None,
        option("see the target up to so far off the axis (default: wide lenses to their rim, else 0)", 0, math.pi),
    ] = None,
    poses: Annotated["Array | Place | None", option("poses from a JSON or CSV file, instead of a grid")] = None,
    options: RenderOptions | None = None,
    seed: Seed = 0,
    file_format: Format = "png",
    quality: Quality = None,
    out: Folder = None,
    jobs: Jobs = None,
    overwrite: Overwrite = False,
    progress: Progress = unheard,
) -> RenderedPhotos:
    """Render synthetic photos of a target from known poses: `render("ico.target.json", views=30).save("photos")`.

    Photos that a camera can be calibrated with come from several distances, with --random-roll, and with an
    --aim-offset that brings rings into the corners of the image; the page of a design has the line for its target.
    With --rig several cameras take them, each into a folder of its own.

    >>> image = calib.render(geometry, camera, poses=cam_from_target).image(0)

    Args:
        poses: `cam_from_target` (V, 4, 4) or one (4, 4), or a JSON or CSV file of them, instead of a grid.
        options: light, lens and sensor; None: plain ones, without noise.
        out: folder to render them into at once, as the rest says, of which `save` tells; None: none.

    Raises:
        InputError: a file that cannot be read, or a value that breaks a rule.
    """
    from calib.app.cameras_told import remarks_on
    from calib.app.inputs import opened_camera, target_of
    from calib.renderer.job import RenderJob
    from calib.renderer.poses import grid_around, photo_poses, poses_of

    geometry, taken = target_of(target, "marks"), opened_camera(camera).read
    light, looks_aside = _stored(options, file_format, quality), False
    if poses is None:
        aim_mm = aim_offset_mm or 0.0
        grid = grid_around(
            geometry, views or 20, distance_mm or 400.0, region, cap_rad, aim_mm, random_roll=random_roll
        )
        where, limit_rad = photo_poses(grid, taken.camera, seed, aside_rad)
        looks_aside = aim_mm > 0 or limit_rad > 0
    else:
        of_grid = {
            "--views": views, "--distance": distance_mm, "--region": region, "--cap-angle": cap_rad,
            "--random-roll": random_roll or None, "--aim-offset": aim_offset_mm, "--aside": aside_rad,
        }  # fmt: skip
        if odd := next((name for name, value in of_grid.items() if value is not None), ""):
            raise InputError(f"{odd}: says nothing with --poses, which say where the camera stands; leave it out")
        where = poses_of(poses)
    job = RenderJob(geometry, taken.camera, where, light, seed, file_format, QUALITY if quality is None else quality)
    remarks = remarks_on(_file_name(camera) or "the camera", taken)
    photos = RenderedPhotos(job, looks_aside, remarks, target_file=_file_name(target))
    return photos.rendered_into(out, jobs, overwrite=overwrite, progress=progress)


def _stored(options: RenderOptions | None, file_format: FileFormat, quality: int | None) -> RenderOptions:
    """How photos look that go into files of a format; what does not go together is refused."""
    light = RenderOptions() if options is None else options
    light.require_sense()
    if file_format == "jpeg" and light.bits == 16:
        raise InputError("--bits 16 does not fit --format jpeg, which holds 8; use png or tiff")
    if file_format != "jpeg" and quality is not None:
        raise InputError(f"--quality {quality}: says nothing of {file_format}; add --format jpeg")
    return light


def _file_name(given: object) -> str:
    """As it was given; "": it comes from no file."""
    return fspath(given) if isinstance(given, str | PathLike) else ""
