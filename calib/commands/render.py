"""The command `calib render`."""

import math
from dataclasses import replace
from inspect import signature
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, cast, get_args

import typer

from calib.commands.options import CameraTemplateOption, JobsOption, RigOption, SeedOption
from designer.base.answer import StoppedError, Summary
from designer.base.errors import InputError
from designer.kinds.presets import one_of
from designer.page.progress import progress_bars
from designer.page.terminal import shown

if TYPE_CHECKING:
    from calib.api.rendering import RenderedPhotos

REGIONS = ("hemisphere", "sphere", "cap")


def render(
    target: Annotated[Path, typer.Argument(help="a target file (NAME.target.json)")],
    *,
    out: Annotated[Path, typer.Option("--out", "-o", help="folder for the images and truth.json")],
    camera: CameraTemplateOption = "machine-vision",
    rig: RigOption = None,
    views: Annotated[int, typer.Option(help="how many photos")] = 20,
    frames: Annotated[int, typer.Option(help="of a rig: how many times the target is shown to its cameras")] = 30,
    unsynchronised: Annotated[
        str, typer.Option(help="of a rig: the target moves, and the cameras' clocks differ by up to this: 30ms")
    ] = "",
    distance: Annotated[
        str, typer.Option(help="from the target's origin: 250mm..800mm (default: 400mm; of a rig as its template says)")
    ] = "",
    region: Annotated[
        str,
        typer.Option(
            help="hemisphere, sphere or cap (default: cap for a board, else sphere)", autocompletion=one_of(REGIONS)
        ),
    ] = "",
    cap_angle: Annotated[str, typer.Option(help="half angle of the cap")] = "60deg",
    random_roll: Annotated[
        bool, typer.Option("--random-roll", help="turn the camera about its axis at random")
    ] = False,
    aim_offset: Annotated[str, typer.Option(help="look past the origin, by up to this")] = "0mm",
    aside: Annotated[
        str, typer.Option(help="see the target up to so far off the axis (default: wide lenses to their rim, else 0)")
    ] = "",
    poses: Annotated[Path | None, typer.Option(help="poses from a JSON or CSV file, instead of a grid")] = None,
    sampling: Annotated[str, typer.Option(help="area: anti-aliased; binary: one ray a pixel, black or white")] = "area",
    black: Annotated[str, typer.Option(help="light of the ink")] = "10%",
    white: Annotated[str, typer.Option(help="light of the white")] = "80%",
    background: Annotated[str, typer.Option(help="light of the background")] = "40%",
    light_gradient: Annotated[str, typer.Option(help="change of the light across the target")] = "0%",
    shading: Annotated[str, typer.Option(help="share of the light that depends on how a face is turned")] = "0%",
    glare: Annotated[str, typer.Option(help="peak light of a lamp mirrored by a glossy target")] = "0%",
    clutter: Annotated[int, typer.Option(help="shapes behind the target, rings among them")] = 0,
    occlusion: Annotated[str, typer.Option(help="share of the target hidden by things in front")] = "0%",
    blur: Annotated[str, typer.Option(help="Gaussian blur: its standard deviation")] = "0px",
    aperture: Annotated[str, typer.Option(help="opening of the lens: defocus of what is nearer or farther")] = "0mm",
    focus: Annotated[str, typer.Option(help="distance of best focus (default: the target's origin)")] = "",
    vignetting: Annotated[str, typer.Option(help="light lost in the corners")] = "0%",
    contrast_to_noise: Annotated[str, typer.Option(help="even noise: white - black over its sigma; 0: none")] = "0",
    read_noise: Annotated[str, typer.Option(help="standard deviation of even noise, of full scale")] = "0%",
    full_well: Annotated[str, typer.Option(help="shot noise: electrons at full scale, such as 10000; 0: none")] = "0",
    gamma: Annotated[str, typer.Option(help="exponent of the tone curve: 2.2 for everyday images")] = "1",
    bits: Annotated[int, typer.Option(help="8 or 16")] = 8,
    file_format: Annotated[
        str, typer.Option("--format", help="png, tiff or jpeg", autocompletion=one_of(("png", "tiff", "jpeg")))
    ] = "png",
    quality: Annotated[int, typer.Option(help="of JPEG, 1 to 100")] = 95,
    seed: SeedOption = 0,
    jobs: JobsOption = None,
    overwrite: Annotated[bool, typer.Option("--overwrite", help="replace another set in the folder")] = False,
) -> Summary:
    """Render synthetic photos of a target from known poses.

    Photos that a camera can be calibrated with come from several distances, with --random-roll, and with an
    --aim-offset that brings rings into the corners of the image; the page of a design has the line for its target.
    With --rig several cameras take them, each into a folder of its own.
    """
    from calib.api.rendering import render as photos_of
    from calib.app.inputs import processes_of
    from calib.commands.camera_argument import read_camera
    from calib.renderer.options import LIMITS, Bits, RenderOptions, Sampling
    from calib.renderer.poses import Region
    from calib.renderer.quantities import (
        bounded,
        choice,
        length,
        length_range,
        parse_degrees,
        parse_number,
        parse_pixels,
        share,
    )
    from calib.renderer.truth import FileFormat

    if bits not in (8, 16):
        raise InputError(f"--bits {bits}: must be 8 or 16")

    def part(name: str, text: str) -> float:
        low, high = LIMITS[name]
        return share(f"--{name.replace('_', '-')}", text, 100 * low, 100 * high)

    options = RenderOptions(
        sampling=cast("Sampling", choice("--sampling", sampling, get_args(Sampling))),
        black=part("black", black),
        white=part("white", white),
        background=part("background", background),
        light_gradient=part("light_gradient", light_gradient),
        shading=part("shading", shading),
        glare=part("glare", glare),
        clutter=clutter,
        occlusion=part("occlusion", occlusion),
        blur_px=bounded("--blur", blur, parse_pixels, *LIMITS["blur_px"], "px"),
        aperture_mm=length("--aperture", aperture, *LIMITS["aperture_mm"]),
        focus_mm=length("--focus", focus, *LIMITS["focus_mm"]) if focus else None,
        vignetting=part("vignetting", vignetting),
        contrast_to_noise=bounded(
            "--contrast-to-noise", contrast_to_noise, parse_number, *LIMITS["contrast_to_noise"], ""
        ),
        read_noise=part("read_noise", read_noise),
        full_well=bounded("--full-well", full_well, parse_number, *LIMITS["full_well"], ""),
        gamma=bounded("--gamma", gamma, parse_number, *LIMITS["gamma"], ""),
        bits=cast("Bits", bits),
    )
    if rig is not None or unsynchronised:
        from calib.commands.render_rig import render_frames

        of_one_camera: dict[str, object] = {
            "camera": camera, "views": views, "region": region, "cap_angle": cap_angle, "random_roll": random_roll,
            "aim_offset": aim_offset, "aside": aside, "poses": poses,
        }  # fmt: skip
        default = signature(render).parameters
        return render_frames(
            target, rig, out, frames, unsynchronised, distance, options,
            unused=tuple(name for name, value in of_one_camera.items() if value != default[name].default),
            seed=seed, file_format=file_format, quality=quality, jobs=jobs, overwrite=overwrite,
        )  # fmt: skip
    named = read_camera(camera)
    photos = photos_of(
        target, named.camera, views=views, distance_mm=length_range("--distance", distance or "400mm", 1, 10_000),
        region=cast("Region", choice("--region", region, REGIONS)) if region else None,
        cap_rad=math.radians(bounded("--cap-angle", cap_angle, parse_degrees, 0, 180, "deg")),
        random_roll=random_roll, aim_offset_mm=length("--aim-offset", aim_offset, 0, 10_000),
        aside_rad=math.radians(bounded("--aside", aside, parse_degrees, 0, 180, "deg")) if aside else None, poses=poses,
        options=options, seed=seed, file_format=cast("FileFormat", file_format), quality=quality,
    )  # fmt: skip
    processes_of(jobs)
    for warning in photos.warnings:
        typer.echo(f"warning: {warning}", err=True)
    done = _run(photos, target, out, jobs, overwrite)
    return replace(done, remarks=(*named.remarks, *photos.warnings, *done.remarks))


def _run(photos: "RenderedPhotos", target: Path, out: Path, jobs: int | None, overwrite: bool) -> Summary:
    """Render the set, and say what was done and what to do next."""
    from calib.commands.photo_screen import say_photos, with_photos_page
    from calib.show.photos.rendered_photos import commands_after, told_rendered

    job = photos.job
    try:
        with progress_bars() as progress:
            rendered = photos.save(out, jobs=jobs, overwrite=overwrite, progress=progress)
    except KeyboardInterrupt:
        done = tuple(path for path in photos.files_in(out) if path.name in job.file_names)
        raise StoppedError(
            f"stopped; {len(done)} of {len(job.file_names)} images are in {out}; the same command renders the others",
            Summary({"images": len(done), "asked": len(job.file_names)}, done),
        ) from None
    told = told_rendered(job, target, out)
    say_photos(told, has_table=False)
    there = f", {rendered.kept} were there already" if rendered.kept else ""
    speed = f"; {rendered.seconds:.1f} s in {rendered.processes} process{'es' * (rendered.processes > 1)}"
    print(f"wrote {shown(out)}: {rendered.written} images and truth.json{there}{speed if rendered.written else ''}")
    steps = tuple(command.line for command in commands_after(job, target, out))
    summary = Summary(
        {
            "folder": str(out),
            "images": len(job.cam_from_target),
            "rendered": rendered.written,
            "kept": rendered.kept,
            "image_size_px": job.camera.image_size,
            "target_id": job.target.geometry_id,
            "seed": job.seed,
            "seconds": rendered.seconds,
            "processes": rendered.processes,
        },
        (*(out / name for name in job.file_names), out / "truth.json"),
        steps,
    )
    summary = with_photos_page(summary, out, told, job.target)
    for step in steps:
        print(f"next  {step}")
    return summary
