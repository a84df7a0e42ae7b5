"""The files of a measured target: NAME.target.json, and NAME.as_built.json, .csv and .png beside it."""

import csv
import io
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from calib.as_built.result import AsBuilt
from calib.as_built_report.as_built_file import AS_BUILT, AsBuiltRecord, HeldOutRecord, LengthRecord, SolvedCamera
from calib.as_built_report.deviations import (
    FREE_PARAMETERS,
    Estimate,
    FaceDeviations,
    RingDeviations,
    WholePrint,
    bed_axes,
    compensation_percent,
    face_deviations,
    next_skew_rad,
    ring_deviations,
    whole_print,
)
from calib.as_built_report.held_out import HeldOut
from calib.as_built_report.length_words import AskedLength
from calib.core.files import check_folder
from designer.base.errors import InputError
from designer.base.own_files import require_ours
from designer.base.units import Skew
from designer.target import FORMAT as TARGET_FORMAT
from designer.target import load_target, target_to_json

TARGET_SUFFIX = ".target.json"
COLUMNS = ("part", "number", "face", "i", "j", "quantity", "value", "sigma", "significance", "unit", "is_known")
_TABLE, _KIND_LINE = "ringsolid.as-built", "# ringsolid as-built deviations, version 1\n"


@dataclass(frozen=True, eq=False)
class MeasureReport:
    """All there is to say of a measured target."""

    found: AsBuilt
    whole: WholePrint
    faces: FaceDeviations | None
    rings: RingDeviations | None
    held_out: HeldOut | None
    lengths: tuple[AskedLength, ...]
    made_with_percent: float  # shrinkage compensation of the print
    made_with_skew_rad: Skew
    bed_turn_rad: float  # of the print, about the bed's normal
    weighted: bool  # by the covariances of the observations
    program: str
    settings: tuple[tuple[str, str], ...]  # of the command: name and value as they were given


def report_of(
    found: AsBuilt,
    held_out: HeldOut | None,
    lengths: Sequence[AskedLength],
    *,
    made_with_percent: float,
    made_with_skew_rad: Skew,
    bed_turn_rad: float,
    weighted: bool,
    program: str,
    settings: tuple[tuple[str, str], ...],
) -> MeasureReport:
    """The report on a measured target."""
    whole, faces, rings = whole_print(found, bed_turn_rad), face_deviations(found), ring_deviations(found)
    return MeasureReport(
        found, whole, faces, rings, held_out, tuple(lengths),
        made_with_percent, made_with_skew_rad, bed_turn_rad, weighted, program, settings,
    )  # fmt: skip


@dataclass(frozen=True)
class FilePlaces:
    """Where the files lie."""

    target: Path
    report: Path
    table: Path
    picture: Path


def places_of(target: Path) -> FilePlaces:
    """The files beside a measured target.

    Raises:
        InputError: its name does not end as those of target files do.
    """
    if not target.name.endswith(TARGET_SUFFIX) or target.name == TARGET_SUFFIX:
        name = target.name.removesuffix(".json").removesuffix(".target").rstrip(".") or "measured"
        raise InputError(f"-o {target}: target files end in {TARGET_SUFFIX}; call it {name}{TARGET_SUFFIX}")
    stem = target.name.removesuffix(TARGET_SUFFIX)
    report, table, picture = (target.with_name(f"{stem}.as_built{end}") for end in (".json", ".csv", ".png"))
    return FilePlaces(target, report, table, picture)


def check_places(places: FilePlaces, nominal: Path | None) -> None:
    """Refuse places that hold something else, before any work is done.

    Raises:
        InputError: a place is the target's own, of another target that is not a measured one, or not to be written.
    """
    out = places.target
    check_folder(out.parent)
    if out.exists() and nominal is not None and nominal.exists() and out.samefile(nominal):
        raise InputError(f"-o {out}: is the target it is measured against; choose another name")
    require_ours(out, kind=TARGET_FORMAT)
    if out.exists() and out.stat().st_size and (source := load_target(out).source) != "measured":
        raise InputError(f"-o {out}: exists and holds a {source} target, not a measured one; choose another name")
    for place, kind in ((places.report, AS_BUILT.format), (places.table, _TABLE), (places.picture, "")):
        require_ours(place, kind=kind)


def report_files(report: MeasureReport, places: FilePlaces) -> dict[Path, bytes]:
    """The target, the numbers and the table."""
    return {
        places.target: target_to_json(report.found.target).encode(),
        places.report: AS_BUILT.text(record_of(report)),
        places.table: table_to_csv(report).encode(),
    }


def table_to_csv(report: MeasureReport) -> str:
    """A line a number, with its standard deviation and how many of them it is from zero."""
    stream = io.StringIO(newline="")
    stream.write(_KIND_LINE)
    stream.write("# faces and rings in the axes of their face, z outwards; the stretch of the whole print taken off\n")
    writer = csv.writer(stream, lineterminator="\n")
    writer.writerow(COLUMNS)
    writer.writerows(_whole_rows(report.whole))
    if report.faces is not None:
        writer.writerows(_face_rows(report.faces))
    if report.rings is not None:
        writer.writerows(_ring_rows(report.found, report.rings))
    return stream.getvalue()


_Row = tuple[str | int | float, ...]


def _numbers(one: Estimate, unit: str, *, is_known: bool = True) -> _Row:
    significance = f"{one.significance:.3g}" if math.isfinite(one.significance) else ""
    return f"{one.value:.9g}", f"{one.sigma:.4g}", significance, unit, int(is_known)


def _whole_rows(whole: WholePrint) -> Iterator[_Row]:
    if whole.size is not None:
        yield "print", "", "", "", "", "size", *_numbers(whole.size, "1")
    for name, one in whole.axes:
        yield "print", "", "", "", "", f"axis {name}", *_numbers(one, "1")
    for name, one in whole.skews:
        yield "print", "", "", "", "", f"skew {name}", *_numbers(one, "rad")


def _face_rows(faces: FaceDeviations) -> Iterator[_Row]:
    for face, verdict in enumerate(faces.verdict):
        for k, name in enumerate(FREE_PARAMETERS):
            one = Estimate(float(faces.value[face, k]), float(faces.sigma[face, k]))
            unit = "mm" if name.startswith("shift") else "rad"
            yield "face", face, face, "", "", name, *_numbers(one, unit, is_known=verdict != "not known")


def _ring_rows(found: AsBuilt, rings: RingDeviations) -> Iterator[_Row]:
    target = found.nominal
    for row, ring in enumerate(rings.seen.tolist()):
        i, j = target.ring_index[ring].tolist()
        for axis in range(3):
            one = Estimate(float(rings.offset_mm[row, axis]), float(rings.sigma_mm[row, axis]))
            yield "ring", ring, int(target.ring_face[ring]), i, j, f"offset {'xyz'[axis]}", *_numbers(one, "mm")


def record_of(report: MeasureReport) -> AsBuiltRecord:
    """What NAME.as_built.json says."""
    found, whole = report.found, report.whole
    size = whole.size
    return AsBuiltRecord(
        program=report.program,
        settings=dict(report.settings),
        layout_id=found.nominal.layout_id,
        nominal_geometry_id=found.nominal.geometry_id,
        measured_geometry_id=found.target.geometry_id,
        status=found.status,
        remarks=tuple(found.remarks),
        iterations=found.iterations,
        observation_sigma=_number(found.scale),
        size_is_known=found.scale_known,
        size_sigma=_number(found.scale_sigma),
        size=size,
        axes=dict(whole.axes),
        skews_rad=dict(whole.skews),
        bed_axes_from_target=bed_axes(found.nominal, report.bed_turn_rad),
        made_with_shrink_compensation_percent=report.made_with_percent,
        next_shrink_compensation_percent=(
            None if size is None else compensation_percent(size.value, report.made_with_percent)
        ),
        made_with_skew_compensation_rad=report.made_with_skew_rad,
        next_skew_compensation_rad=next_skew_rad(whole, report.made_with_skew_rad),
        strain=found.strain,
        strain_covariance=found.strain_covariance,
        lengths=tuple(
            LengthRecord(asked.length.name, asked.length.value_mm, asked.length.sigma_mm, _number(left))
            for asked, (_, left) in zip(report.lengths, found.lengths, strict=True)
        ),
        face_views=found.face_views,
        face_is_determined=found.is_determined,
        face_motion=found.motion,
        face_motion_covariance=found.motion_covariance,
        face_verdict=() if report.faces is None else tuple(report.faces.verdict),
        face_bow_mm=found.bow_mm,
        face_bow_covariance=found.bow_covariance,
        ring_sigma_mm=found.ring_sigma_mm,
        ring_is_seen=found.is_ring_seen,
        ring_offset_mm=found.offset_mm,
        ring_offset_sigma_mm=found.offset_sigma_mm,
        cameras=tuple(_cameras(found)),
        held_out=None if report.held_out is None else _held_out(report.held_out),
    )


def _cameras(found: AsBuilt) -> Iterator[SolvedCamera]:
    for camera, covariance, seen, residual, is_outlier in zip(
        found.cameras, found.param_covariance, found.observations, found.residual_px, found.is_outlier, strict=True
    ):
        used = residual[~is_outlier]
        rms_px = float(np.sqrt((used**2).sum(axis=1).mean())) if len(used) else math.nan
        yield SolvedCamera(
            camera.model, camera.image_size, camera.parameters, covariance, seen.view_count, len(seen.view),
            int(is_outlier.sum()), _number(rms_px),
        )  # fmt: skip


def _held_out(held: HeldOut) -> HeldOutRecord:
    is_better = None if held.judged_by is None else held.judged_by.is_better
    return HeldOutRecord(held.folds, held.gains, held.against_truth, held.remarks, is_better)


def _number(value: float) -> float | None:
    return value if math.isfinite(value) else None
