"""What `calib render` tells of its photos: what they show of the target, and what makes them less than ideal."""

import math
import shlex
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from calib.core.types import LEAST_RADIUS_PX
from calib.detector.candidates import MIN_RADIUS_PX
from calib.draw.run_tables import field_of_view_words
from calib.renderer.faces import ring_truth
from calib.renderer.job import RenderJob
from calib.renderer.options import RenderOptions
from calib.renderer.scene import scene_from_target
from calib.renderer.truth import TRUTH_FILE
from calib.show.parts.kept_target import TARGET_FILE, target_words
from calib.show.photos.photos_file import PHOTOS_FILE, ToldPhoto, ToldPhotos, ToldSection
from calib.show.photos.place_scene import distance_words, tilts_deg
from designer.base.arrays import Array
from designer.base.words import capital, printable
from designer.base.words import figure as digits
from designer.page.blocks import Cell, Column, Command, Finding, Headline
from designer.page.folders import number, whole

FILES = (
    (TRUTH_FILE, "camera, poses and options: what a calibration of these photos should find"),
    (TARGET_FILE, "the target as it was rendered"),
    (PHOTOS_FILE, "what this page is built from"),
)


@dataclass(frozen=True)
class RenderedPhoto:
    """What one photo shows."""

    name: str
    distance_mm: float
    off_axis_deg: float | None  # of the target's origin, where the lens is wide
    tilt_deg: float  # of a flat target; nan of others
    faces: int  # with a ring that can be measured
    rings: int  # that can be measured, nothing hiding them
    radius_px: float  # median of their semi-minor axes
    largest_px: float  # of all semi-minor axes

    @property
    def is_too_small(self) -> bool:
        """Whether no ring is as large as the detector wants."""
        return self.largest_px < LEAST_RADIUS_PX


def told_rendered(job: RenderJob, target: Path, folder: Path) -> ToldPhotos:
    """What is to be said of a finished set.

    Args:
        job: that made it.
        target: the target's file, as it was given.
        folder: of the photos.
    """
    photos, is_flat = photos_of_job(job), job.target.is_plate
    is_wide = job.camera.has_dark_corners
    too_small = _small_words(photos) if any(photo.is_too_small for photo in photos) else ""
    return ToldPhotos(
        "photos", _headline(job, photos, too_small), _facts(job),
        photo_columns(is_flat=is_flat, is_wide=is_wide),
        tuple(
            ToldPhoto(
                photo.name, photo_cells(photo, is_flat=is_flat, is_wide=is_wide), photo.name, photo_caption(photo),
                "usable" if photo.is_too_small else None, cam_from_target=pose,
            )
            for photo, pose in zip(photos, job.cam_from_target, strict=True)
        ),
        "In the order they were rendered.", FILES, lead=_rings_words(photos),
        notes=(Finding("usable", "Rings too small", too_small),) if too_small else (),
        after=(ToldSection("Next", commands_after(job, target, folder)),),
        geometry_id=job.target.geometry_id, camera=job.camera,
    )  # fmt: skip


def commands_after(job: RenderJob, target: Path, folder: Path) -> tuple[Command, ...]:
    """What the photos are for; dots alone are not detected here."""
    if job.target.is_dot.all():
        return ()
    camera = Path("camera") if folder.name in ("", "..") else folder.with_name(f"{folder.name}-camera")
    shown, photos, out = (shlex.quote(printable(str(path))) for path in (target, folder, camera))
    return (Command(
        f"calib run {shown} {photos} -o {out}",
        f"calibrates from these photos, and compares with {TRUTH_FILE}; type it where calib render was typed",
    ),)  # fmt: skip


def photos_of_job(job: RenderJob) -> list[RenderedPhoto]:
    """What each photo shows: faces and rings that each photo shows large enough, and how large they are."""
    scene, poses, photos = scene_from_target(job.target), job.cam_from_target, []
    tilt_deg = tilts_deg(job.target, poses).tolist() if job.target.is_plate else [np.nan] * len(poses)
    for name, pose, tilt in zip(job.file_names, poses, tilt_deg, strict=True):
        rings = ring_truth(scene, job.camera, pose)
        clear = rings.whole & (rings.minor_radius_px >= MIN_RADIUS_PX)
        off_axis_deg = _off_axis_deg(pose) if job.camera.has_dark_corners else None
        radius_px = float(np.median(rings.minor_radius_px[clear])) if clear.any() else np.nan
        photos.append(RenderedPhoto(
            name, float(np.linalg.norm(pose[:3, 3])), off_axis_deg, tilt, len(np.unique(scene.ring_face[clear])),
            int(clear.sum()), radius_px, float(rings.minor_radius_px[rings.visible].max(initial=0)),
        ))  # fmt: skip
    return photos


def _off_axis_deg(cam_from_target: Array) -> float:
    """The angle between the camera's axis and the way to the target's origin."""
    x, y, z = cam_from_target[:3, 3].tolist()
    return math.degrees(math.atan2(math.hypot(x, y), z))


def _headline(job: RenderJob, photos: list[RenderedPhoto], too_small: str) -> Headline:
    total, (width, height) = len(photos), job.camera.image_size
    sentence = (
        f"{'1 photo' if total == 1 else f'{total} photos'} of {width} x {height} px of {target_words(job.target)}, "
        f"by a camera of model {job.camera.model} from {distance_words(job.cam_from_target)}; "
        f"{effects(job.options) or 'without blur and noise'}; seed {job.seed}."
    )
    if all(photo.is_too_small for photo in photos):
        return Headline("usable", "rings too small", f"{sentence} {too_small}")
    return Headline("note", "rendered", sentence)


def _small_words(photos: list[RenderedPhoto]) -> str:
    """Which photos show no ring that is large enough, and what to do."""
    small = [photo for photo in photos if photo.is_too_small]
    where = "" if len(small) == len(photos) else f" in {len(small)} of {len(photos)} photos"
    return f"{capital(too_small_words(max(photo.largest_px for photo in small), where))}."


def too_small_words(largest_px: float, where: str = "") -> str:
    """What to do where the largest ring is too small for the detector."""
    return (
        f"the largest ring{where} has a radius of {digits(largest_px, 2)} px; the detector wants {LEAST_RADIUS_PX:g} "
        "px: come nearer, or use a longer lens"
    )


def _facts(job: RenderJob) -> tuple[tuple[str, str], ...]:
    camera, options = job.camera, job.options
    width, height = camera.image_size
    quality = f", quality {job.quality}" if job.file_format == "jpeg" else ""
    return (
        ("target", f"{target_words(job.target)}, id {job.target.geometry_id}"),
        ("camera model", camera.model),
        ("image", f"{width} x {height} px, {job.file_format}{quality}, {options.bits} bits"),
        ("focal length", " x ".join(dict.fromkeys(digits(float(value), 6) for value in camera.params[:2])) + " px"),
        ("field of view", field_of_view_words(camera)),
        ("from the target's origin", distance_words(job.cam_from_target)),
        *option_words(options),
        ("seed", str(job.seed)),
    )


def option_words(options: RenderOptions) -> tuple[tuple[str, str], ...]:
    """What is on, as names and values; what is off is left out."""
    black, white, background = (f"{100 * light:.3g} %" for light in (options.black, options.white, options.background))
    sampling = "by area (anti-aliased)" if options.sampling == "area" else "one ray a pixel, black or white"
    return ("sampling", sampling), ("light of ink, white, background", f"{black}, {white}, {background}"), *_on(options)


def _on(options: RenderOptions) -> tuple[tuple[str, str], ...]:
    """What makes the photos less than ideal."""
    focus = "the target's origin" if options.focus_mm is None else f"{options.focus_mm:g} mm"
    rows = (
        ("blur", f"{options.blur_px:g} px (sigma)", options.blur_px),
        ("opening of the lens", f"{options.aperture_mm:g} mm, in focus at {focus}", options.aperture_mm),
        ("contrast over noise", f"{options.contrast_to_noise:g}", options.contrast_to_noise),
        ("read noise", f"{100 * options.read_noise:.3g} % of full scale", options.read_noise),
        ("shot noise", f"of {options.full_well:g} electrons at full scale", options.full_well),
        ("light lost in the corners", f"{100 * options.vignetting:.3g} %", options.vignetting),
        ("light gradient", f"{100 * options.light_gradient:.3g} %", options.light_gradient),
        ("shading", f"{100 * options.shading:.3g} %", options.shading),
        ("glare", f"{100 * options.glare:.3g} %", options.glare),
        ("clutter", f"{options.clutter} shapes", options.clutter),
        ("hidden by things in front", f"{100 * options.occlusion:.3g} %", options.occlusion),
        ("gamma", f"{options.gamma:g}", options.gamma != 1),
    )
    return tuple((name, value) for name, value, is_on in rows if is_on)


def effects(options: RenderOptions) -> str:
    """The same in a few words."""
    return ", ".join(f"{name} {value}" for name, value in _on(options))


def _rings_words(photos: list[RenderedPhoto]) -> str:
    if all(photo.is_too_small for photo in photos):
        return ""  # said already
    least, most = min(photo.rings for photo in photos), max(photo.rings for photo in photos)
    each = f"{least}" if least == most else f"{least} to {most}"
    return (
        f"Each shows {each} rings whole and with a semi-minor axis of at least {MIN_RADIUS_PX:g} px. So small ones can "
        f"be measured beside others; to find and name a face, the detector wants rings of {LEAST_RADIUS_PX:g} px."
    )


def photo_caption(photo: RenderedPhoto) -> str:
    """What stands below a photo."""
    side = f"tilt {photo.tilt_deg:.0f}°" if np.isfinite(photo.tilt_deg) else f"{photo.faces} faces"
    aside = "" if photo.off_axis_deg is None else f", {photo.off_axis_deg:.0f}° off the axis"
    return f"{digits(photo.distance_mm, 3)} mm away{aside}, {side}, {photo.rings} rings"


def photo_columns(*, is_flat: bool, is_wide: bool) -> tuple[Column, ...]:
    """Heads of the numbers of each photo."""
    size = f"with a semi-minor axis of at least {MIN_RADIUS_PX:g} px"
    tilt = Column("tilt °", note="between the target's normal and the line of sight; 0 is straight on")
    return (
        Column("distance mm", note="from the camera to the target's origin"),
        *((Column("off axis °", note="of the target's origin"),) if is_wide else ()),
        tilt if is_flat else Column("faces", note=f"with a ring that is whole and {size}"),
        Column("rings", note=f"whole in the image, {size}; things in front are not counted off"),
        Column("ring size px", note="median of their semi-minor axes"),
    )


def photo_cells(photo: RenderedPhoto, *, is_flat: bool, is_wide: bool) -> tuple[Cell, ...]:
    """A photo's row under `photo_columns`."""
    side = number(photo.tilt_deg, 2) if is_flat else whole(photo.faces)
    aside = (Cell("") if photo.off_axis_deg is None else number(photo.off_axis_deg, 2),) if is_wide else ()
    return number(photo.distance_mm), *aside, side, whole(photo.rings), number(photo.radius_px, 3)
