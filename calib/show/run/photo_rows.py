"""What is known of each photo of a calibration: how much of it was seen, and how well the camera explains it."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from calib.metrics.evaluation import by_view
from calib.observe.records import ImageRecord, Records, common_remarks
from calib.verdict.view_facts import view_facts
from designer.page.blocks import Level

if TYPE_CHECKING:
    from calib.show.run.run_folder import RunFolder, Solved

Array = NDArray[np.float64]

STANDS_OUT = 2.0
"""A photo whose error is so many times the median of all is marked."""


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


def photo_rows(run: "RunFolder", one: "Solved") -> tuple[PhotoRow, ...]:
    """A row for each photo that was used or searched: those that were used first, in their order.

    What is remarked of all photos is left away; see `remarks_of_all`.
    """
    names = one.calibration.observations.view_names
    images = () if run.records is None else run.records.images
    common = set(remarks_of_all(run.records))
    records = {
        record.image: replace(record, remarks=tuple(remark for remark in record.remarks if remark not in common))
        for record in images
    }
    used = set(names)
    return (*_used_rows(one, records), *(_unused_row(one) for one in records.values() if one.image not in used))


def remarks_of_all(records: Records | None) -> tuple[str, ...]:
    """What is remarked of each of several photos that could be searched."""
    return () if records is None else common_remarks([one.remarks for one in records.images if not one.failure])


def _used_rows(one: "Solved", records: Mapping[str, ImageRecord]) -> list[PhotoRow]:
    calibration = one.calibration
    seen = calibration.observations
    reprojection = one.evaluation.of("reprojection")
    intersection = one.evaluation.of("intersection")
    left_over = None if reprojection is None else by_view(one.evaluation, reprojection)
    meeting = None if intersection is None else by_view(one.evaluation, intersection)
    outliers = np.bincount(seen.view[calibration.is_outlier], minlength=seen.view_count).tolist()
    sightings = np.bincount(seen.view, minlength=seen.view_count).tolist()
    facts = view_facts(calibration)
    distance, size = facts.distance_mm.tolist(), (100 * facts.size).tolist()
    tilt = facts.tilt_deg[:, 2].tolist() if facts.is_flat else [math.nan] * seen.view_count
    known = np.array([math.nan] if left_over is None else [summary.rmse for summary in left_over])
    known = known[np.isfinite(known)]
    usual = float(np.median(known)) if len(known) else math.nan
    faces = seen.points.face[seen.point]
    rows = []
    for view, name in enumerate(seen.view_names):
        record = records.get(name)
        rmse = math.nan if left_over is None else left_over[view].rmse
        named = np.unique(faces[(seen.view == view) & (faces >= 0)])
        rows.append(PhotoRow(
            name, True, sightings[view] if record is None else record.features, _expected(record), outliers[view], rmse,
            math.nan if left_over is None else left_over[view].largest,
            math.nan if meeting is None else meeting[view].rmse, distance[view], tilt[view], size[view], len(named),
            "" if record is None else "; ".join(record.remarks), "usable" if rmse > STANDS_OUT * usual else None,
        ))  # fmt: skip
    return rows


def _expected(record: ImageRecord | None) -> int | None:
    """How many features of the faces that were found could have been measured, as commands count them too."""
    if record is None:
        return None
    return sum(face.measurable for face in record.faces if face.face is not None)


def _unused_row(record: ImageRecord) -> PhotoRow:
    """A photo that was searched and gave nothing to the camera."""
    why = record.failure or "; ".join(record.remarks) or ("not used" if record.features else "the target was not found")
    faces = len({face.face for face in record.faces if face.face is not None})
    nan = math.nan
    return PhotoRow(
        record.image, False, record.features, _expected(record), 0, nan, nan, nan, nan, nan, nan, faces, why, "bad"
    )  # fmt: skip
