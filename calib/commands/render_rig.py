"""`calib render --rig`: the photos of several cameras."""

from pathlib import Path
from typing import TYPE_CHECKING, cast

import typer

from designer.base.answer import StoppedError, Summary
from designer.base.errors import InputError
from designer.page.progress import progress_bars
from designer.page.terminal import say_table, shown

if TYPE_CHECKING:
    from calib.api.rendering_rigs import RenderedRig
    from calib.renderer.options import RenderOptions
    from calib.renderer.truth import FileFormat


def render_frames(
    target: Path,
    rig: str | None,
    out: Path,
    frames: int,
    unsynchronised: str,
    distance: str,
    options: "RenderOptions",
    *,
    unused: tuple[str, ...],
    seed: int,
    file_format: str,
    quality: int,
    jobs: int | None,
    overwrite: bool,
) -> Summary:
    """Render what `calib render` was asked for, by the cameras of a rig; `unused` are options of one camera."""
    from calib.api.rendering_rigs import render_rig
    from calib.app.inputs import processes_of
    from calib.renderer.quantities import length_range
    from designer.base.units import parse_quantity

    if rig is None:
        raise InputError(f"--unsynchronised {unsynchronised}: says nothing without --rig; add one, such as stereo-pair")
    if unused:
        raise InputError(
            f"--{unused[0].replace('_', '-')} says nothing with --rig, which says where its cameras are; leave it out"
        )
    try:
        delay_s = parse_quantity(unsynchronised or "0s", {"ms": 1e-3, "s": 1.0}, "a time such as 30ms", 1.0)
    except ValueError as error:
        raise InputError(f"--unsynchronised {unsynchronised}: {error}") from None
    photos = render_rig(
        target, rig, frames=frames, unsynchronised_s=delay_s, options=options, seed=seed,
        distance_mm=length_range("--distance", distance, 1, 10_000) if distance else None,
        file_format=cast("FileFormat", file_format), quality=quality,
    )  # fmt: skip
    processes_of(jobs)
    for warning in photos.warnings:
        typer.echo(f"warning: {warning}", err=True)
    return _run(photos, target, out, jobs, overwrite=overwrite)


def _run(photos: "RenderedRig", target: Path, out: Path, jobs: int | None, *, overwrite: bool) -> Summary:
    """Render the set, and say what was done and what to do next."""
    from calib.commands.photo_screen import say_photos, with_photos_page
    from calib.show.photos.rendered_rig import command_after_rig, told_rendered_rig
    from designer.page.blocks import Table

    by_camera = dict(zip(photos.rig.names, photos.jobs, strict=True))
    asked = sum(len(job.cam_from_target) for job in photos.jobs)
    try:
        with progress_bars() as progress:
            rendered = photos.save(out, jobs=jobs, overwrite=overwrite, progress=progress)
    except KeyboardInterrupt:
        done = tuple(path for path in photos.files_in(out) if path.suffix not in (".json", ".csv"))
        raise StoppedError(
            f"stopped; {len(done)} of {asked} images are in {out}; the same command renders the others",
            Summary({"images": len(done), "asked": asked}, done),
        ) from None
    after = command_after_rig(target, out, is_moving=bool(photos.delays_ms))
    title = photos.simulated.title
    told = told_rendered_rig(by_camera, title, photos.sees, photos.delays_ms, photos.warnings, after)
    say_photos(told, has_table=False)
    for section in told.before:
        for block in section.blocks:
            if isinstance(block, Table):
                say_table(block)
    there = f", {rendered.kept} were there already" if rendered.kept else ""
    speed = f"; {rendered.seconds:.1f} s in {rendered.processes} process{'es' * (rendered.processes > 1)}"
    print(f"wrote {shown(out)}: {rendered.written} images and rig.json{there}{speed if rendered.written else ''}")
    shared = photos.sees.astype(int) @ photos.sees.T.astype(int)
    summary = Summary(
        {
            "folder": str(out),
            "rig": photos.simulated.name,
            "cameras": list(photos.rig.names),
            "frames": len(photos.rig_from_target),
            "images": asked,
            "rendered": rendered.written,
            "kept": rendered.kept,
            "shared_frames": shared.tolist(),
            "delays_ms": dict(photos.delays_ms),
            "target_id": photos.jobs[0].target.geometry_id,
            "seed": photos.jobs[0].seed,
            "seconds": rendered.seconds,
            "processes": rendered.processes,
        },
        photos.files_in(out),
        (after.line,),
        remarks=photos.warnings,
    )
    summary = with_photos_page(summary, out, told, photos.jobs[0].target)
    print(f"next  {after.line}")
    return summary
