"""What `calib render` tells of its photos: what they show of the target, and what makes them less than ideal."""

import math
import shlex
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from calib.core.types import LEAST_RADIUS_PX
from calib.detector.candidates import MIN_RADIUS_PX
from calib.draw.camera_scene import distance_words, place_view, place_words, tilts_deg
from calib.draw.gallery import Shot, gallery, is_there, spread
from calib.draw.run_tables import field_of_view_words
from calib.renderer.options import PHOTO_TABLE, RIG_FILE, TRUTH_FILE
from designer.base.words import capital, counted, printable
from designer.base.words import figure as digits
from designer.page.blocks import Cell, Command, Facts, Finding, Findings, Headline, Page, Section, Table
from designer.page.folders import Shown, notes, table_of

if TYPE_CHECKING:
    from calib.app.rendered_photos import RenderedPhotos, RenderedRig, RenderedSet
    from calib.renderer.contents import PhotoContent
    from calib.renderer.options import RenderOptions

MOST_NAMED = 12
"""Cameras of which it is told how often two of them see the target together."""


@dataclass(frozen=True)
class NamedPhoto:
    """A photo, and what it shows."""

    path: str  # from the folder of all
    camera: str  # "": there is one only
    off_axis_deg: float  # of the target's origin; nan: the lens is not wide
    tilt_deg: float  # of a flat target; nan of others
    shows: "PhotoContent"
    word: str = "rings"  # what it shows

    @property
    def is_too_small(self) -> bool:
        """Whether no ring is as large as the detector wants; of several cameras not each has to see the target."""
        return not self.camera and self.shows.largest_px < LEAST_RADIUS_PX

    @property
    def caption(self) -> str:
        """What stands below it."""
        side = f"{self.shows.faces} faces" if math.isnan(self.tilt_deg) else f"tilt {self.tilt_deg:.0f}°"
        aside = "" if math.isnan(self.off_axis_deg) else f", {self.off_axis_deg:.0f}° off the axis"
        said = f"{digits(self.shows.distance_mm, 3)} mm away{aside}, {side}, {self.shows.rings} {self.word}"
        return f"{self.camera}: {said}" if self.camera else said


def photos_page(made: "RenderedPhotos", folder: Path | None) -> Page:
    """What is to be said of a camera's photos; with its pictures where a folder holds them."""
    job, photos = made.job, _named(made)
    (width, height), poses = job.camera.image_size, job.cam_from_target
    is_small, word = all(one.is_too_small for one in photos), job.target.feature_word
    headline = Headline(
        "usable" if is_small else "note", f"{word} too small" if is_small else "rendered",
        f"{counted(len(photos), 'photo')} of {width} x {height} px of "
        f"{job.target.words}, by a camera of model {job.camera.model} from {distance_words(poses)}; "
        f"{_ending(made)}",
    )  # fmt: skip
    focal_px = dict.fromkeys(digits(float(value), 6) for value in job.camera.params[:2])
    facts = (
        ("target", f"{job.target.words}, id {job.target.geometry_id}"),
        ("camera model", job.camera.model),
        ("image", f"{width} x {height} px, {_file_words(made)}"),
        ("focal length", f"{' x '.join(focal_px)} px"),
        ("field of view", field_of_view_words(job.camera)),
        ("from the target's origin", distance_words(poses)),
        *option_words(job.options), ("seed", str(job.seed)), *_done(made),
    )  # fmt: skip
    least, most = (limit(one.shows.rings for one in photos) for limit in (min, max))
    size = "with edges of" if word == "corners" else "with a semi-minor axis of"
    lead = "" if is_small else (
        f"Each shows {f'{least}' if least == most else f'{least} to {most}'} {word} whole and {size} "
        f"at least {MIN_RADIUS_PX:g} px. So small ones can be measured beside others; to find and name a face, the "
        f"detector wants {word} of {LEAST_RADIUS_PX:g} px."
    )  # fmt: skip
    view = place_view(job.target, job.camera, poses, tuple(f"{one.path}: {one.caption}" for one in photos))
    places = Section("Camera positions", (view,), lead=place_words(job.target, poses))
    to, target, place = _places(made, "camera")
    steps = (Command(f"calib run {target} {place} -o {to}", f"calibrates, and compares with {TRUTH_FILE}"),)
    can_be_found = made.target_file and (job.target.marks is not None or not job.target.is_dot.all())
    return Page(
        "", "", headline, (_photos(photos, made, folder, lead), places), lead=(Facts(facts),),
        next_steps=steps if can_be_found else (),
    )  # fmt: skip


def rig_photos_page(made: "RenderedRig", folder: Path | None) -> Page:
    """What is to be said of a rig's photos; with its pictures where a folder holds them."""
    first, photos, delays_ms, frames = made.first, _named(made), made.delays_ms, len(made.rig_from_target)
    moves = "which moves; the cameras are not synchronous" if delays_ms else "which stands still in each"
    headline = Headline(
        "usable" if made.warnings else "note", "hard to calibrate" if made.warnings else "rendered",
        f"{counted(frames, 'frame')} of {made.simulated.title}: {len(made.of)} cameras, "
        f"{len(photos)} photos of {first.target.words}, {moves}; {_ending(made)}",
    )  # fmt: skip
    late = f"delays up to {max(map(abs, delays_ms.values())):.3g} ms" if delays_ms else "synchronous"
    facts = (
        ("rig", made.simulated.title),
        ("cameras", f"{len(made.of)}, {late}"),
        ("frames", str(frames)),
        ("target", f"{first.target.words}, id {first.target.geometry_id}"),
        ("files", _file_words(made)),
        *option_words(first.options), ("seed", f"{first.seed} of the first camera, one more of each next"),
        *_done(made),
    )  # fmt: skip
    sections = Section("Cameras", tuple(_camera_tables(made, photos))), _photos(photos, made, folder)
    to, target, place = _places(made, "rig")
    seen = f"--table {shlex.quote(printable(str(Path(made.folder) / PHOTO_TABLE)))} --delays" if delays_ms else place
    found = f"calibrates the rig from these photos; what it should find is in {RIG_FILE}"
    steps = (Command(f"calib rig {target} {seen} -o {to}", found),) if made.target_file else ()
    return Page("", "", headline, sections, lead=(Facts(facts),), next_steps=steps)


def _named(made: "RenderedSet") -> list[NamedPhoto]:
    named = list[NamedPhoto]()
    for camera, photos in made.by_folder.items():
        job, unknown = photos.job, [math.nan] * len(photos.contents)
        tilts = tilts_deg(job.target, job.cam_from_target).tolist() if job.target.is_plate else unknown
        word = job.target.feature_word
        for file, tilt, shows in zip(job.file_names, tilts, photos.contents, strict=True):
            aside = shows.off_axis_deg if job.camera.has_dark_corners else math.nan
            named.append(NamedPhoto(f"{camera}/{file}" if camera else file, camera, aside, tilt, shows, word))
    return named


def _ending(made: "RenderedSet") -> str:
    """Of the headline: all that makes the photos less than ideal."""
    said = ", ".join(f"{name} {value}" for name, value in _on(made.first.options))
    return f"{said or 'without blur and noise'}; seed {made.first.seed}."


def _file_words(made: "RenderedSet") -> str:
    quality = f", quality {made.first.quality}" if made.first.file_format == "jpeg" else ""
    return f"{made.first.file_format}{quality}, {made.first.options.bits} bits"


def _done(made: "RenderedSet") -> Iterator[tuple[str, str]]:
    if (done := made.done) is not None:
        there = f", {done.kept} were there already" if done.kept else ""
        yield (
            "rendered",
            f"{done.rendered} in {done.seconds:.1f} s by {done.processes} process{'es' * (done.processes > 1)}{there}",
        )


def _places(made: "RenderedSet", name: str) -> tuple[str, str, str]:
    """Where results could go, the target's file and the photos' folder, as they are typed."""
    place = Path(made.folder)
    out = Path(name) if place.name in ("", "..") else place.with_name(f"{place.name}-{name}")
    return tuple(shlex.quote(printable(str(path))) for path in (out, made.target_file, place))  # type: ignore[return-value]


def option_words(options: "RenderOptions") -> tuple[tuple[str, str], ...]:
    """What is on, as names and values; what is off is left out."""
    black, white, background = (f"{100 * light:.3g} %" for light in (options.black, options.white, options.background))
    sampling = "by area (anti-aliased)" if options.sampling == "area" else "one ray a pixel, black or white"
    return ("sampling", sampling), ("light of ink, white, background", f"{black}, {white}, {background}"), *_on(options)


def _on(options: "RenderOptions") -> tuple[tuple[str, str], ...]:
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
    )  # fmt: skip
    return tuple((name, value) for name, value, is_on in rows if is_on)


def _photos(photos: Sequence[NamedPhoto], made: "RenderedSet", folder: Path | None, lead: str = "") -> Section:
    """What to know of the photos, their pictures, and a row a photo, whose name leads to it."""

    def name(one: NamedPhoto) -> Cell:
        path = one.path if folder is not None and is_there(folder, one.path) else ""
        return Cell(printable(one.path), path=path, level="usable" if one.is_too_small else None)

    shots = [Shot(one.path, one.path, one.caption, "usable" if one.is_too_small else None) for one in photos]
    order = "Camera by camera, in the order of frames." if photos[0].camera else "In the order they were rendered."
    warned = tuple(Finding("usable", "", f"{capital(line)}.") for line in made.warnings)
    said = [line for line in made.remarks if line not in made.warnings]
    kind, size, word = Shown[NamedPhoto], f"at least {MIN_RADIUS_PX:g} px small", photos[0].word
    aside = kind("off axis °", lambda one: one.off_axis_deg, "of the target's origin")
    tilt = kind(
        "tilt °", lambda one: one.tilt_deg, "between the target's normal and the line of sight; 0 is straight on"
    )
    faces = kind("faces", lambda one: one.shows.faces, f"with {word} that are whole and {size}")
    table = table_of(
        photos, kind("photo", name),
        kind("distance mm", lambda one: one.shows.distance_mm, "from the camera to the target's origin", 3),
        *(() if all(math.isnan(one.off_axis_deg) for one in photos) else (aside,)),
        faces if math.isnan(photos[0].tilt_deg) else tilt,
        kind(word, lambda one: one.shows.rings, f"whole in the image, {size}; things in front are not counted off"),
        kind("size px", lambda one: one.shows.radius_px, "of these, the median of the semi-minor axes", 3),
        title="All photos",
    )  # fmt: skip
    pictures = () if folder is None else gallery(folder, spread(shots), order)
    return Section("Photos", (*notes(said), *((Findings(warned),) if warned else ()), *pictures, table), lead=lead)


def _camera_tables(made: "RenderedRig", photos: Sequence[NamedPhoto]) -> Iterator[Table]:
    """A row a camera; and how many frames two of them share."""
    names, shared, late_ms = made.rig.names, made.shared_frames, made.delays_ms
    kind, rows = Shown[int], range(len(names))
    delay = kind("delay ms", lambda row: late_ms[names[row]], "by which the camera's time stamps run behind", 3)
    yield table_of(
        rows, kind("camera", lambda row: names[row]), kind("model", lambda row: made.rig.cameras[row].model),
        kind("image px", lambda row: "{} x {}".format(*made.rig.cameras[row].image_size)),
        kind("frames", lambda row: shared[row][row], "in which it sees what is large enough for the detector"),
        kind(photos[0].word, lambda row: sum(one.shows.rings for one in photos if one.camera == names[row]),
             "that can be measured, in all its photos"),
        *((delay,) if late_ms else ()), title="What each camera sees",
    )  # fmt: skip
    if 1 < len(names) <= MOST_NAMED:
        pairs = (kind(name, partial(lambda frames, row: frames[row], shared[at])) for at, name in enumerate(names))
        yield table_of(rows, kind("camera", lambda row: names[row]), *pairs, title="Frames that two cameras share")
