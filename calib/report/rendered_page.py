"""The page of `calib render`: photos of a target, and where their camera stood."""

import os
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from calib.detect.candidates import MIN_RADIUS_PX
from calib.render.rings import ring_truth
from calib.render.scene import Scene, scene_from_target
from calib.report.camera_section import field_of_view_words
from calib.report.cells import number, whole
from calib.report.folder_blocks import files_section, warnings
from calib.report.gallery import Shot, gallery, spread
from calib.report.kept_target import TARGET_FILE, kept_target, target_words
from calib.report.origin import Origin
from calib.report.place_scene import distance_words, place_view, place_words, tilts_deg
from calib.report.rendered_file import RenderedSet, effects, missing_finding, option_words, read_rendered
from calib.report.titles import title_of
from calib.results.evaluation_table import figure as digits
from calib.types import LEAST_RADIUS_PX
from designer.command import printable
from designer.page.blocks import (
    Block,
    Cell,
    Column,
    Command,
    Facts,
    Findings,
    Headline,
    Level,
    Page,
    Section,
    Table,
)
from designer.page.links import is_linkable
from designer.target import TargetGeometry

TRUTH_FILE = "truth.json"
FILES = (
    (TRUTH_FILE, "camera, poses and options: what a calibration of these photos should find"),
    (TARGET_FILE, "the target as it was rendered"),
)
AGAIN = "in this folder: makes this page again"


@dataclass(frozen=True)
class Row:
    """One photo; nan and None where the target is not known."""

    name: str
    is_there: bool
    distance_mm: float
    tilt_deg: float  # of a flat target
    faces: int | None  # with a ring that can be measured
    rings: int | None  # that can be measured, nothing hiding them
    radius_px: float  # median of their semi-minor axes
    largest_px: float  # of all semi-minor axes; nan where no ring shows

    @property
    def is_too_small(self) -> bool:
        """Whether no ring is as large as the detector wants."""
        return self.largest_px < LEAST_RADIUS_PX


def rendered_page(folder: Path, origin: Origin) -> Page:
    """Read a folder and build its page.

    Raises:
        InputError: `truth.json` cannot be read; the message names it.
    """
    found = read_rendered(folder / TRUTH_FILE)
    target, wrong = kept_target(folder, found.truth.geometry_id)
    rows = _rows(folder, found, target)
    missing = sum(not row.is_there for row in rows)
    careful: tuple[Block, ...] = (
        *((Findings((missing_finding(missing, len(rows)),)),) if missing else ()),
        *warnings("File", (wrong,) if wrong else ()),
        *warnings("Rings too small", (_too_small(rows),) if any(row.is_too_small for row in rows) else ()),
    )
    shots = [Shot(row.name, row.name, _caption(row)) for row in rows if row.is_there]
    names = tuple(printable(row.name) for row in rows)
    poses = found.truth.cam_from_target
    view = place_view(target, found.truth.camera, poses, names, "Each pyramid is a photo; point at one for its name.")
    is_flat = target is not None and target.face_count == 1
    sections = (
        Section("Photos", (*careful, *gallery(folder, spread(shots), "In the order they were rendered."),
                           _table(rows, is_flat=is_flat)), lead=_rings_words(rows)),
        Section("Camera positions", (view,), lead=place_words(target, poses)),
        _next(target, missing),
        files_section(folder, FILES, Command("calib report .", AGAIN)),
    )  # fmt: skip
    return Page(
        title=title_of(folder), kind="Rendered photos", headline=_headline(found, target, rows), sections=sections,
        lead=(Facts(_facts(found, target)),), made_by=origin.command, program=origin.program,
    )  # fmt: skip


def _headline(found: RenderedSet, target: TargetGeometry | None, rows: list[Row]) -> Headline:
    total, missing = len(rows), sum(not row.is_there for row in rows)
    width, height = found.truth.camera.image_size
    seen = effects(found.options)
    sentence = (
        f"{'1 photo' if total == 1 else f'{total} photos'} of {width} x {height} px of "
        f"{target_words(target, found.truth.geometry_id)}, by a camera of model {found.truth.camera.model} from "
        f"{distance_words(found.truth.cam_from_target)}; {seen or 'without blur and noise'}; seed {found.seed}."
    )
    if missing:
        return Headline("usable", "unfinished", f"{total - missing} of {sentence}")
    if all(row.is_too_small for row in rows):
        return Headline("usable", "rings too small", f"{sentence} {_too_small(rows)}")
    return Headline("note", "rendered", sentence)


def _too_small(rows: list[Row]) -> str:
    """Which photos show no ring that is large enough, and what to do, in the words of `calib render`."""
    small = [row for row in rows if row.is_too_small]
    largest = digits(max(row.largest_px for row in small), 2)
    where = "" if len(small) == len(rows) else f" in {len(small)} of {len(rows)} photos"
    return (
        f"The largest ring{where} has a radius of {largest} px; the detector wants {LEAST_RADIUS_PX:g} px: come "
        "nearer, or use a longer lens."
    )


def _facts(found: RenderedSet, target: TargetGeometry | None) -> tuple[tuple[str, str], ...]:
    camera = found.truth.camera
    width, height = camera.image_size
    return (
        ("target", f"{target_words(target, '')}, id {printable(found.truth.geometry_id)[:40]}"
         if target is not None else target_words(None, found.truth.geometry_id)),
        ("camera model", camera.model),
        ("image", f"{width} x {height} px, {found.stored_as}"),
        ("focal length", " x ".join(dict.fromkeys(digits(float(value), 6) for value in camera.params[:2])) + " px"),
        ("field of view", field_of_view_words(camera)),
        ("from the target's origin", distance_words(found.truth.cam_from_target)),
        *option_words(found.options),
        ("seed", str(found.seed)),
    )  # fmt: skip


def _rows(folder: Path, found: RenderedSet, target: TargetGeometry | None) -> list[Row]:
    """What is known of each photo."""
    truth = found.truth
    there = _images(folder)
    distance = np.linalg.norm(truth.cam_from_target[:, :3, 3], axis=1).tolist()
    flat = target is not None and target.face_count == 1
    tilt = tilts_deg(target, truth.cam_from_target).tolist() if flat and target else [np.nan] * len(distance)
    scene = None if target is None else scene_from_target(target)
    return [
        Row(name, name in there, distance[view], tilt[view], *_seen(found, scene, view))
        for view, name in enumerate(truth.files)
    ]


def _images(folder: Path) -> set[str]:
    """The names of the files in the folder."""
    with os.scandir(folder) as entries:
        return {entry.name for entry in entries if entry.is_file()}


def _seen(found: RenderedSet, scene: Scene | None, view: int) -> tuple[int | None, int | None, float, float]:
    """Faces and rings that a photo shows large enough, and how large they are."""
    if scene is None:
        return None, None, np.nan, np.nan
    rings = ring_truth(scene, found.truth.camera, found.truth.cam_from_target[view])
    clear = rings.whole & (rings.minor_radius_px >= MIN_RADIUS_PX)
    radius = float(np.median(rings.minor_radius_px[clear])) if clear.any() else np.nan
    largest = float(rings.minor_radius_px[rings.visible].max(initial=0))
    return len(np.unique(scene.ring_face[clear])), int(clear.sum()), radius, largest


def _rings_words(rows: list[Row]) -> str:
    counts = [row.rings for row in rows if row.rings is not None]
    if not counts:
        return ""
    least, most = min(counts), max(counts)
    each = f"{least}" if least == most else f"{least} to {most}"
    if all(row.is_too_small for row in rows):
        return ""  # said already
    return (
        f"Each shows {each} rings whole and with a semi-minor axis of at least {MIN_RADIUS_PX:g} px. So small ones can "
        f"be measured beside others; to find and name a face, the detector wants rings of {LEAST_RADIUS_PX:g} px."
    )


def _caption(row: Row) -> str:
    words = [f"{digits(row.distance_mm, 3)} mm away"]
    if np.isfinite(row.tilt_deg):
        words.append(f"tilt {row.tilt_deg:.0f}°")
    elif row.faces is not None:
        words.append(f"{row.faces} faces")
    if row.rings is not None:
        words.append(f"{row.rings} rings")
    return ", ".join(words)


def _table(rows: list[Row], *, is_flat: bool) -> Table:
    known = bool(rows) and rows[0].rings is not None
    columns = [Column("photo", is_number=False), Column("distance mm", note="from the camera to the target's origin")]
    if is_flat:
        columns.append(Column("tilt °", note="between the target's normal and the line of sight; 0 is straight on"))
    if known:
        size = f"with a semi-minor axis of at least {MIN_RADIUS_PX:g} px"
        columns += [
            *(() if is_flat else (Column("faces", note="with such a ring"),)),
            Column("rings", note=f"whole in the image, {size}; things in front are not counted off"),
            Column("ring size px", note="median of their semi-minor axes"),
        ]
    return Table("All photos", tuple(columns), tuple(_cells(row, is_flat=is_flat) for row in rows))


def _cells(row: Row, *, is_flat: bool) -> tuple[Cell, ...]:
    link = row.name if row.is_there and is_linkable(row.name) else ""
    name = printable(row.name) if row.is_there else f"{printable(row.name)} (not there)"
    level: Level | None = "usable" if row.is_too_small or not row.is_there else None
    cells = [Cell(name, path=link, level=level), number(row.distance_mm)]
    if is_flat:
        cells.append(number(row.tilt_deg, 2))
    if row.rings is not None and row.faces is not None:
        cells += [*(() if is_flat else (whole(row.faces),)), whole(row.rings), number(row.radius_px, 3)]
    return tuple(cells)


def _next(target: TargetGeometry | None, missing: int) -> Section:
    """What these photos are for."""
    name = TARGET_FILE if target is not None else "NAME.target.json"
    run = Command(
        f"calib run {name} . -o calibration",
        f"in this folder: calibrates from these photos, and compares with {TRUTH_FILE}",
    )
    see = Command(
        f"calib detect {name} . -o detections/detections.csv --overlay detections",
        "only finds the rings, and shows what was found",
    )
    lead = "Render the missing photos first." if missing else ""
    return Section("Next", (run, see), lead=lead)
