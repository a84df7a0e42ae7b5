"""The command `calib detect`."""

from contextlib import nullcontext
from pathlib import Path
from typing import Annotated

import typer

from calib.commands.folder_page import say_next
from calib.commands.options import PhotoJobsOption, PhotosArgument, TargetArgument
from designer.base.answer import Summary
from designer.kinds.presets import camera_templates
from designer.page.progress import progress_bars
from designer.page.terminal import quoted, shown

NOTHING_FOUND = 1


def detect(
    target: TargetArgument,
    photos: PhotosArgument,
    *,
    out: Annotated[
        Path | None, typer.Option("--out", "-o", help="detections to write (default: exports/NAME/detections.csv)")
    ] = None,
    overlay: Annotated[
        Path | None, typer.Option(help="folder for pictures that show what was and was not found", metavar="DIR")
    ] = None,
    camera: Annotated[
        str | None,
        typer.Option(
            help="camera file (of ours or another tool) or template: centres become surer where its lens is known",
            autocompletion=camera_templates,
        ),
    ] = None,
    jobs: PhotoJobsOption = None,
) -> Summary:
    """Find a target's rings in photos, name them, and measure their centres.

    The exit code is 1 if nothing at all was found.
    """
    from calib.api.searching import PhotoSearch, with_truth, write_search
    from calib.api.staging import keep_pictures, staging_folder
    from calib.commands.camera_argument import read_camera
    from calib.commands.photo_screen import detections_answer, say_photos, with_photos_page
    from calib.observe.dataset import check_output
    from calib.observe.photos import find_photos
    from calib.observe.records import records_path
    from calib.show.photos.detected_photos import SOLVED_FOLDER, told_detected
    from designer.target import load_target

    geometry = load_target(target, "rings")
    named = None if camera is None else read_camera(camera)
    table = _table_path(out, target)
    check_output(table)
    asked, _ = with_truth(find_photos(photos), None)  # a truth that is none does not matter here
    with nullcontext() if overlay is None else staging_folder(overlay) as staging:
        with progress_bars() as progress:
            wanted = PhotoSearch(geometry, asked, staging, jobs, progress)
            search = wanted.once(None if named is None else named.camera)
        write_search(table, search)
        pictures = () if staging is None or overlay is None else keep_pictures(staging, overlay)
    told = told_detected(search, target, table, overlay)
    say_photos(told)
    print(f"wrote {shown(table)}: one line a feature, which is what a calibration reads")
    print(f"      {shown(records_path(table))}: what was read of each face, and why rings are missing")
    if overlay is not None and pictures:
        print(f"      {shown(overlay)}: {len(pictures)} overlays; look at them before you trust the numbers")
    is_found = bool(search.with_target)
    summary = Summary(
        detections_answer(search),
        (table, records_path(table), *pictures),
        (f"calib solve {quoted(table)} --target {quoted(target)} -o {quoted(table.parent / SOLVED_FOLDER)}",)
        if is_found
        else (),
        () if named is None else named.remarks,
        exit_code=0 if is_found else NOTHING_FOUND,
    )
    if overlay is None:
        print("next  the same command with --overlay DIR draws what was and was not found")
        return summary
    return say_next(with_photos_page(summary, overlay, told), overlay)


def _table_path(out: Path | None, target: Path) -> Path:
    """Where the detections go."""
    if out is None:
        return exports_folder(target) / "detections.csv"
    return out / "detections.csv" if out.is_dir() else out


def exports_folder(target: Path) -> Path:
    """Where a target's results go if nobody says otherwise."""
    return Path("exports") / target.name.removesuffix(".json").removesuffix(".target")
