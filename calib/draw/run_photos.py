"""The photos of a calibration with what was found in them: small pictures of the overlays, and a table.

A few photos of a rig's cameras with what was found in them: of each camera the worst and a usual one.
"""

import math
import os
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from calib.core.types import UNMEASURABLE_WORDS
from calib.draw.gallery import OVERLAYS, STANDS_OUT, Shot, gallery, shortened
from calib.judge.views import ViewFacts, view_facts
from calib.observe.dataset import ImageRecord, Records, common_remarks
from calib.observe.photos import OVERLAY_MARK
from calib.solver.calibration import Calibration
from calib.solver.metrics.evaluation import Evaluation, by_view
from designer.base.words import figure as digits
from designer.base.words import printable
from designer.page.blocks import Cell, Finding, Findings, Leaf, Level, Section, Table
from designer.page.folders import Shown, table_of


@dataclass(frozen=True)
class PhotoRow:
    """One photo; nan where something is not known."""

    name: str
    is_used: bool  # the camera was solved from it
    seen: int  # features that were found, or without records those that were used
    expected: int | None  # that could be measured of the faces that show; None: not known
    outliers: int
    rmse_px: float
    worst_px: float
    intersection_mm: float
    distance_mm: float  # from the camera to the target's middle
    tilt_deg: float  # of a flat target against the image plane
    size_percent: float  # that the sightings fill of the image's width or height
    faces: int  # that were named
    remark: str  # why it was not used, or what to know of it
    level: Level | None  # None: like the others


def photo_rows(evaluation: Evaluation, records: Records | None) -> tuple[PhotoRow, ...]:
    """A row for each photo that was used or searched: those that were used first, in their order.

    What is remarked of all photos is left away; see `remarks_of_all`.
    """
    common = set(remarks_of_all(records))
    images = {
        record.image: replace(record, remarks=tuple(remark for remark in record.remarks if remark not in common))
        for record in (() if records is None else records.images)
    }
    calibration = evaluation.calibration
    used = set(calibration.observations.view_names)
    reprojection, intersection = evaluation.of("reprojection"), evaluation.of("intersection")
    left_over = None if reprojection is None else by_view(evaluation, reprojection)
    meeting = None if intersection is None else by_view(evaluation, intersection)
    unknown = [math.nan] * calibration.observations.view_count
    rows = used_rows(
        calibration, view_facts(calibration), unknown if left_over is None else [one.rmse for one in left_over],
        unknown if left_over is None else [one.largest for one in left_over],
        unknown if meeting is None else [one.rmse for one in meeting], images,
    )  # fmt: skip
    return (*rows, *(_unused_row(one) for one in images.values() if one.image not in used))


def remarks_of_all(records: Records | None) -> tuple[str, ...]:
    """What is remarked of each of several photos that could be searched."""
    return () if records is None else common_remarks([one.remarks for one in records.images if not one.failure])


def used_rows(
    calibration: Calibration, facts: ViewFacts, rmse_px: Sequence[float], worst_px: Sequence[float],
    intersection_mm: Sequence[float], records: Mapping[str, ImageRecord],
) -> list[PhotoRow]:  # fmt: skip
    """A row for each photo that a camera was solved from, with errors of each and what was recorded of some."""
    seen = calibration.observations
    outliers = np.bincount(seen.view[calibration.is_outlier], minlength=seen.view_count).tolist()
    observations = np.bincount(seen.view, minlength=seen.view_count).tolist()
    known = [one for one in rmse_px if math.isfinite(one)]
    usual_px = float(np.median(known)) if known else math.nan
    faces, rows = seen.points.face[seen.point], []
    for view, name in enumerate(seen.view_names):
        record = records.get(name)
        rows.append(PhotoRow(
            name, True, observations[view] if record is None else record.features,
            None if record is None else record.expected, outliers[view], rmse_px[view], worst_px[view],
            intersection_mm[view], float(facts.distance_mm[view]),
            float(facts.tilt_deg[view, 2]) if facts.is_flat else math.nan, 100 * float(facts.size[view]),
            len(np.unique(faces[(seen.view == view) & (faces >= 0)])),
            "" if record is None else "; ".join(record.remarks),
            "usable" if rmse_px[view] > STANDS_OUT * usual_px else None,
        ))  # fmt: skip
    return rows


def _unused_row(record: ImageRecord) -> PhotoRow:
    """A photo that was searched and gave nothing to the camera."""
    why = record.failure or "; ".join(record.remarks) or ("not used" if record.features else "the target was not found")
    faces = len({face.face for face in record.named})
    nan = math.nan
    return PhotoRow(
        record.image, False, record.features, record.expected, 0, nan, nan, nan, nan, nan, nan, faces, why, "bad"
    )


SUFFIXES = (".jpg", ".png")


def overlay_paths(folder: Path, rows: Sequence[PhotoRow]) -> dict[str, str]:
    """Where in the folder the overlays of photos lie, of those that have one: named after the photo, or numbered."""
    place = folder / OVERLAYS
    try:
        there = {entry.name for entry in os.scandir(place) if entry.is_file()}
    except OSError:
        return {}
    flat = [row.name.replace("/", "_") for row in rows]
    count = Counter(Path(name).stem for name in flat)
    found = {}
    for order, (row, name) in enumerate(zip(rows, flat, strict=True), start=1):
        stem = Path(name).stem
        stems = (*((stem,) if count[stem] == 1 else ()), name, f"{order}-{name}", f"{order}")
        names = (f"{one}{OVERLAY_MARK}{suffix}" for one in stems for suffix in SUFFIXES)
        if (first := next((one for one in names if one in there), None)) is not None:
            found[row.name] = f"{OVERLAYS}/{first}"
    return found


def photos_section(folder: Path | None, rows: Sequence[PhotoRow], common: Sequence[str], *, is_flat: bool) -> Section:
    """Pictures and table."""
    said = (Findings(tuple(Finding("note", "All photos", shortened(remark)) for remark in common)),) if common else ()
    blocks = (*said, *_pictures(folder, rows), views_table(rows, is_flat=is_flat))
    return Section("Photos", blocks, lead=_lead(rows))


def _lead(rows: Sequence[PhotoRow]) -> str:
    used = [row for row in rows if row.is_used]
    known = [row for row in used if math.isfinite(row.rmse_px)]
    words = f"{len(used)} of {len(rows)} photos were used"
    if known:
        least, most = min(known, key=lambda row: row.rmse_px), max(known, key=lambda row: row.rmse_px)
        words += (
            f"; the residuals of one are {digits(least.rmse_px, 2)} to {digits(most.rmse_px, 2)} px (RMS), "
            f"the largest in {printable(most.name)}"
        )
    marked = sum(row.level == "usable" for row in rows)
    if marked:
        words += f". {marked} with more than twice the usual error {'is' if marked == 1 else 'are'} marked"
    return f"{words}."


def _pictures(folder: Path | None, rows: Sequence[PhotoRow]) -> tuple[Leaf, ...]:
    """Small pictures of as many overlays as a page can take, the worst first, and what there is not."""
    places = {} if folder is None else overlay_paths(folder, rows)
    if folder is None or not places:
        why = f"The folder {OVERLAYS}/ holds no overlay of these photos; calib run draws them."
        return (Findings((Finding("note", "No pictures", why),)),)
    worst_first = sorted(rows, key=lambda row: (row.is_used, -row.rmse_px if math.isfinite(row.rmse_px) else math.inf))
    shots = [Shot(places[row.name], row.name, caption_of(row), row.level) for row in worst_first if row.name in places]
    without = len(rows) - len(shots)
    has_none = f" {without} {'has' if without == 1 else 'have'} no overlay." if without else ""
    return gallery(folder, shots, f"The photos with the largest errors first.{has_none}")


def caption_of(row: PhotoRow) -> str:
    """What is said under a photo."""
    seen = f"{row.seen} points" if row.expected is None else f"{row.seen} of {row.expected} points"
    words = [seen]
    if math.isfinite(row.rmse_px):
        words.append(f"RMS {digits(row.rmse_px, 2)} px")
    if math.isfinite(row.tilt_deg):
        words.append(f"tilt {row.tilt_deg:.0f}°")
    elif row.faces > 1:
        words.append(f"{row.faces} faces")
    if math.isfinite(row.distance_mm):
        words.append(f"{row.distance_mm:.0f} mm away")
    if row.outliers:
        words.append(f"{row.outliers} outliers")
    if row.remark:
        words.append(shortened(row.remark))
    return ", ".join(words)


def views_table(rows: Sequence[PhotoRow], *, is_flat: bool) -> Table:
    """A row a photo."""
    column = Shown[PhotoRow]

    def points(row: PhotoRow) -> Cell:
        return Cell(str(row.seen) if row.expected is None else f"{row.seen} / {row.expected}", float(row.seen))

    tilt = column("tilt °", lambda row: row.tilt_deg, "between the target and the image plane; 0 is straight on")
    return table_of(
        rows, column("photo", lambda row: Cell(printable(row.name), level=row.level)),
        column("points", points,
               f"found, of those of the faces in the photo that could be measured: not those {UNMEASURABLE_WORDS}"),
        column("outliers", lambda row: row.outliers, "observations that were left out of the solution"),
        column("RMSE px", lambda row: row.rmse_px, "root mean square of the residuals: predicted - measured", 3),
        column("worst px", lambda row: row.worst_px, "the largest residual", 3),
        column("intersection mm", lambda row: row.intersection_mm,
               "RMS distance on the target between the ray of an observation and its point", 3),
        tilt if is_flat else column("faces", lambda row: row.faces, "of the target, that were read"),
        column("distance mm", lambda row: row.distance_mm, "from the camera to the target's middle", 3),
        column("size %", lambda row: row.size_percent,
               "of the image's width or height that the points fill, whichever is more"),
        column("remark", lambda row: shortened(row.remark)), title="All photos",
    )  # fmt: skip
