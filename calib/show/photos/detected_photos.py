"""What `calib detect` tells of its photos: whether enough was found, why rings are missing, and what to do about it."""

import math
import os
import shlex
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path

from calib.core.types import NOT_MEASURABLE, UNMEASURABLE_WORDS
from calib.observe.observations import misplaced_pieces
from calib.observe.photos import PhotoResult, Search
from calib.observe.records import ImageRecord, common_remarks, median_sigma_px
from calib.show.parts.gallery import shortened
from calib.show.photos.photos_file import (
    PHOTOS_FILE,
    SHARE_RULE,
    ToldPhoto,
    ToldPhotos,
    ToldSection,
    level_of_share,
    worst_level,
)
from designer.base.answer import program
from designer.base.number_text import figure as digits
from designer.base.words import capital, printable
from designer.page.blocks import Cell, Column, Command, Finding, Findings, Headline, Level, Steps, Table, is_linkable
from designer.page.folders import number, some_of, whole
from designer.target import TargetGeometry

WORDS: Mapping[Level, str] = {"good": "found", "usable": "found in part", "bad": "not found", "note": ""}
SOLVED_FOLDER = "camera"
"""Beside the detections: where the next step solves the camera."""
LOOK = (
    "Open the overlays of photos without the target: is it the target of this file, sharp, and at least a quarter of "
    "the image wide?",
    "Where rings are missing, the reason is in the table: come nearer where they are small, avoid reflections where "
    "they are faint or covered.",
    "Leave out photos in which the target was found by a few rings only.",
)


def told_detected(
    search: Search, target: Path, table: Path, folder: Path | None = None, overlays: Path | None = None
) -> ToldPhotos:
    """What is to be said of photos that were searched.

    Args:
        search: what was found in them.
        target: the target's file.
        table: the detections that were written.
        folder: of the page; None: there is none.
        overlays: folder of the pictures, within the page's; None: the page's.
    """
    way = "" if folder is None else _from_folder(table, folder)
    pictures = "" if overlays in (None, folder) or folder is None else f"{overlays.relative_to(folder).as_posix()}/"
    records = [result.record for result in search.results]
    rows = _checks(search)
    level = worst_level(rows)
    is_solid = not search.target.is_planar
    common = common_remarks([seen.remarks for seen in search.detections])
    return ToldPhotos(
        "detections", _headline(search, level), _facts(search, records, target, str(table), way),
        _columns(search.target),
        tuple(_photo(result, common, pictures, is_solid=is_solid) for result in search.results),
        "The photos with most rings missing first.", _files(way),
        lead=_sigma_words(search),
        notes=(
            *(Finding("note", "All photos", shortened(remark)) for remark in common),
            *(Finding("usable", "Pieces", capital(line)) for line in misplaced_pieces(search.detections)),
            *(Finding("usable", "Not searched", line) for line in some_of(search.failures)),
            *((Finding("note", "Left out", f"{search.overlays_left_out} overlays of an earlier run"),)
              if search.overlays_left_out else ()),
            *(Finding("usable", "", one.overlay_failure) for one in search.results if one.overlay_failure),
        ),
        before=(
            ToldSection("Was enough found?", (Findings(rows),), "The headline is the worst of these."),
            _next(search, target, table, level),
        ),
        after=(
            *((ToldSection("Faces", (_faces_table(search.target, records),)),) if is_solid else ()),
            _missing_section(records),
        ),
        geometry_id=search.target.geometry_id,
    )  # fmt: skip


def _from_folder(path: Path, folder: Path) -> str:
    """The way from a folder to a file, with "/" between folders; "" if there is none."""
    try:
        return Path(os.path.relpath(os.path.realpath(path), os.path.realpath(folder))).as_posix()
    except ValueError:  # on another drive
        return ""


def _checks(search: Search) -> tuple[Finding, ...]:
    """What was found against what could have been."""
    searched, asked = len(search.detections), len(search.results)
    rows = [_check("Photos that show the target", len(search.with_target), searched, "Of photos that could be read.")]
    if search.with_target:
        flat = "Rings that are seen too flat are not counted."
        rows.insert(0, _check("Rings of the faces that show", *search.counts, flat))
    if searched < asked:
        rows.append(_check("Photos that could be read", searched, asked, "The others are listed with the reason."))
    return tuple(rows)


def _check(title: str, part: int, of: int, text: str) -> Finding:
    share = part / of if of else 0.0
    percent = f"{int(1000 * share + 1e-9) / 10:g} %"  # rounded down, so that 100 % are all
    return Finding(level_of_share(share), title, text, f"{part} of {of} ({percent})", SHARE_RULE)


def _headline(search: Search, level: Level) -> Headline:
    """The worst of the checks, and the counts."""
    total = len(search.results)
    photos = "1 photo" if total == 1 else f"{total} photos"
    if search.with_target:
        found, expected = search.counts
        sentence = (
            f"The target was found in {len(search.with_target)} of {photos}, with {found} of the {expected} rings "
            "that could have been measured."
        )
    else:
        sentence = f"The target was found in none of {photos}. {_first_reason(search)}".rstrip()
    if failed := total - len(search.detections):
        sentence += f" {failed} could not be read."
    return Headline(level, WORDS[level], sentence)


def _first_reason(search: Search) -> str:
    """What is said of a photo that does not show the target, as a sentence; "" if nothing is."""
    without = [seen for seen in search.detections if seen.remarks]
    if not without:
        return ""
    words = printable("; ".join(without[0].remarks))
    is_same = all(seen.remarks == without[0].remarks for seen in without)
    return f"{capital(words)}." if is_same else f"{printable(without[0].image)}: {words}."


def _facts(
    search: Search, records: Sequence[ImageRecord], target: Path, table: str, way: str
) -> tuple[tuple[str, str], ...]:
    sizes = Counter(seen.image_size for seen in search.detections)
    shown = ", ".join(f"{width} x {height} px" for (width, height), _ in sizes.most_common(3))
    facts = [
        ("target", f"{target}, id {search.target.geometry_id}"),
        ("photos", f"{len(search.results)}, {len(search.detections)} of them searched"),
        ("image", f"{shown}{', ...' if len(sizes) > 3 else ''}" if shown else "none could be read"),
    ]  # fmt: skip
    if not search.target.is_planar:
        seen = {face.face for record in records for face in record.named}
        facts.append(("faces seen", f"{len(seen)} of {search.target.face_count}"))
    return (
        *facts,
        ("ring-like things without a name", str(sum(record.rejected for record in records))),
        ("found by", program()),
        ("written to", f"{table}; from this folder: {way}" if way else table),
    )


def _sigma_words(search: Search) -> str:
    sigmas_px = sorted(median_sigma_px(seen) for seen in search.with_target)
    if not sigmas_px:
        return ""
    least, most = digits(sigmas_px[0], 2), digits(sigmas_px[-1], 2)
    return (
        f"The standard deviation of a centre is {least if least == most else f'{least} to {most}'} px, the median of a "
        "photo: from how well a ring fits its pixels, which says nothing of a bent print."
    )


def _columns(target: TargetGeometry) -> tuple[Column, ...]:
    faces = (Column("faces", is_number=False, note="of the target, that were named"),)
    return (
        Column("found", note="rings and dots that were named and measured"),
        Column("expected", note=f"of the faces that show, without those {UNMEASURABLE_WORDS}"),
        *(faces if not target.is_planar else ()),
        Column("sigma px", note="median of the centres' standard deviations, along their worse axis"),
        Column("margin", note="how many marks fit the name of a face better than the next best name; the least"),
        Column("no name", note="ring-like things that got no name"),
        Column("missing", is_number=False),
        Column("remark", is_number=False),
    )


def _photo(result: PhotoResult, common: Sequence[str], pictures: str, *, is_solid: bool) -> ToldPhoto:
    record, seen = result.record, result.seen
    own = [remark for remark in record.remarks if remark not in common]
    remark = shortened("; ".join(filter(None, (record.failure, *own))))
    missing = ", ".join(
        f"{count} {why}" for why, count in record.missing.most_common() if count and why not in NOT_MEASURABLE
    )
    margins = [face.margin for face in record.named if face.code_read]
    faces = sorted({face.face for face in record.named if face.face is not None})
    sigma_px = math.nan if seen is None else median_sigma_px(seen)
    share = record.features / record.expected if record.expected else 0.0
    cells = (
        whole(record.features), whole(record.expected),
        *((Cell(" ".join(map(str, faces)), float(len(faces))),) if is_solid else ()),
        number(sigma_px, 2), whole(min(margins)) if margins else Cell(""), whole(record.rejected),
        Cell(missing), Cell(remark),
    )  # fmt: skip
    words = (
        f"{record.features} of {record.expected} rings" if record.features else "not found",
        f"sigma {digits(sigma_px, 2)} px" if record.features else "", missing, remark,
    )  # fmt: skip
    level = level_of_share(share) if record.features else "bad"
    picture = "" if result.overlay is None else f"{pictures}{result.overlay.name}"
    return ToldPhoto(
        record.image, cells, picture, ", ".join(filter(None, words)), None if level == "good" else level, 1 - share
    )


def _faces_table(target: TargetGeometry, records: Sequence[ImageRecord]) -> Table:
    """How often each face was seen, and how well."""
    seen = [face for record in records for face in record.named if face.rings_found]
    columns = (
        Column("face"), Column("photos", note="in which rings of it were measured"), Column("found"),
        Column("expected", note=f"of these photos, without those {UNMEASURABLE_WORDS}"),
    )  # fmt: skip
    rows = []
    for row in range(target.face_count):
        own = [face for face in seen if face.face == row]
        rows.append((
            Cell(str(row), float(row), level=None if own else "usable"), whole(len(own)),
            whole(sum(face.rings_found for face in own)), whole(sum(face.measurable for face in own)),
        ))  # fmt: skip
    return Table("All faces", columns, tuple(rows))


def _missing_section(records: Sequence[ImageRecord]) -> ToldSection:
    """Why rings are missing, over all photos."""
    missing = sum((record.missing for record in records), Counter[str]())
    title = "Why rings are missing"
    if not any(record.features for record in records):
        lead = "In no photo was a face named, so no ring can be told missing; what each shows instead stands above."
        return ToldSection(title, (), lead)
    if not missing:
        return ToldSection(title, (), "No ring of a face that shows is missing.")
    rows = tuple((Cell(why), whole(count)) for why, count in missing.most_common())
    unmeasurable = sum(missing[why] for why in NOT_MEASURABLE)
    note = f"Rings {UNMEASURABLE_WORDS} are not expected: no detector measures them." if unmeasurable else ""
    table = Table("Reasons", (Column("reason", is_number=False), Column("rings")), rows, note)
    lost = missing.total() - unmeasurable
    lead = f"{lost} rings are missing that could have been measured" if lost else "Only rings that nobody could measure"
    return ToldSection(title, (table,), f"{lead}.")


def _files(table: str) -> tuple[tuple[str, str], ...]:
    own = (
        (table, "the detections, a line a ring: what a calibration reads"),
        (Path(table).with_suffix(".records.json").as_posix(), "what was read of each face, and why rings are missing"),
    ) if is_linkable(table) else ()  # fmt: skip
    return *own, (PHOTOS_FILE, "what this page is built from")


def _next(search: Search, target: Path, table: Path, level: Level) -> ToldSection:
    """What to do with the detections."""
    blocks: list[Command | Steps] = []
    if search.with_target:
        places = (target, table, table.parent / SOLVED_FOLDER)
        shown, found, out = (shlex.quote(printable(str(path))) for path in places)
        blocks.append(Command(
            f"calib solve {found} --target {shown} -o {out}", "solves the camera; type it where calib detect was typed"
        ))  # fmt: skip
    if level != "good":
        blocks.append(Steps(LOOK))
    lead = {
        "good": "Look at some overlays, then solve the camera.",
        "usable": "Enough to go on with, if the rings that are missing are not all in one part of the image.",
    }.get(level, "Find out why before going on.")
    return ToldSection("Next", tuple(blocks), lead)
