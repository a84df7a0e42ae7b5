"""What `calib detect` tells of its photos: whether enough was found, why rings are missing, and what to do about it."""

import math
import os
import shlex
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from calib.core.types import NOT_MEASURABLE, UNMEASURABLE_WORDS, FaceRecord
from calib.draw.gallery import SHARE_RULE, Shot, gallery, is_there, level_of_share, shortened, title_of_pictures
from calib.observe.dataset import ImageRecord, common_remarks, median_sigma_px
from calib.observe.observations import misplaced_pieces
from calib.observe.photos import PhotoResult, Search
from designer.base.answer import program
from designer.base.words import capital, counted, printable, span
from designer.base.words import figure as digits
from designer.page.blocks import (
    Cell,
    Command,
    Facts,
    Finding,
    Findings,
    Headline,
    Level,
    Page,
    Section,
    Steps,
    Table,
    worst_level,
)
from designer.page.folders import Shown, some_of, table_of, whole

if TYPE_CHECKING:
    from calib.app.detect import DetectedPhotos

WORDS: Mapping[Level, str] = {"good": "found", "usable": "found in part", "bad": "not found", "note": ""}
SOLVED_FOLDER = "camera"
"""Beside the detections: where the next step solves the camera."""
_LOOK = (
    "Open the overlays of photos without the target: is it the target of this file, sharp, and at least a quarter of "
    "the image wide?",
    "Where {} are missing, the reason is in the table: come nearer where they are small, avoid reflections where "
    "they are faint or covered.",
    "Leave out photos in which the target was found by a few {} only.",
)
WHICH_BOARD = "calib target --from-photo PHOTO says which board a photo shows."
EXPECTED = f"of the faces that show, without those {UNMEASURABLE_WORDS}"
OVERLAYS_SHOW = "the same command with --overlay DIR draws what was and was not found"


def detected_page(made: "DetectedPhotos", folder: Path | None = None) -> Page:
    """What is to be said of photos that were searched.

    Args:
        folder: of the page, with the pictures; None: a page without them.
    """
    search = made.search
    records, rows = [result.record for result in search.results], _checks(search)
    level, word = worst_level(rows), search.target.feature_word
    which = () if search.target.marks is None or search.with_target else (WHICH_BOARD,)
    look = (*which, *(line.format(word) for line in _LOOK))
    common = common_remarks([seen.remarks for seen in search.detections])
    shots = [] if folder is None else _shots(made, folder, common)
    said = (
        *(Finding("note", "All photos", shortened(remark)) for remark in (*common, *made.remarks)),
        *(Finding("usable", "Pieces", capital(line)) for line in misplaced_pieces(search.detections)),
        *(Finding("usable", "Not searched", line) for line in some_of(search.failures)),
        *((Finding("note", "Left out", f"{search.overlays_left_out} overlays of an earlier run"),)
          if search.overlays_left_out else ()),
        *(Finding("usable", "", one.overlay_failure) for one in search.results if one.overlay_failure),
        *((Finding("note", "No pictures", OVERLAYS_SHOW),) if made.overlays is None else ()),
    )  # fmt: skip
    photos = (
        *((Findings(said),) if said else ()),
        *(() if folder is None else gallery(folder, shots, f"The photos with most {word} missing first.")),
        _photos_table(
            search, common, {shot.name: shot.path for shot in shots if folder and is_there(folder, shot.path)}
        ),
    )
    is_solid = not search.target.is_planar
    sections = (
        Section("Was enough found?", (Findings(rows),), lead="The headline is the worst of these."),
        Section("Photos", photos, lead=_sigma_words(search)),
        *((Section("Faces", (_faces_table(search, records),)),) if is_solid else ()),
        _missing_section(records, word),
        *((Section("Look at the photos", (Steps(look),)),) if level != "good" else ()),
    )
    return Page(
        "" if folder is None else title_of_pictures(folder), "", _headline(search, level), sections,
        lead=(_facts(made, records, folder),), next_steps=_next(made),
    )  # fmt: skip


def way_to(path: Path | None, folder: Path | None) -> str:
    """The way from a folder to a file, with "/" between folders; "" if there is none."""
    try:
        if path is not None and folder is not None:
            return Path(os.path.relpath(os.path.realpath(path), os.path.realpath(folder))).as_posix()
    except ValueError:  # on another drive
        pass
    return ""


def _checks(search: Search) -> tuple[Finding, ...]:
    """What was found against what could have been."""
    searched, asked = len(search.detections), len(search.results)
    rows = [_check("Photos that show the target", len(search.with_target), searched, "Of photos that could be read.")]
    if search.with_target:
        word = capital(search.target.feature_word)
        flat = f"{word} that are seen too flat are not counted."
        rows.insert(0, _check(f"{word} of the faces that show", *search.counts, flat))
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
    photos = counted(total, "photo")
    if search.with_target:
        found, expected = search.counts
        sentence = (
            f"The target was found in {len(search.with_target)} of {photos}, with {found} of the {expected} "
            f"{search.target.feature_word} that could have been measured."
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
    end = "" if words.endswith("?") else "."
    return capital(f"{words}{end}") if is_same else f"{printable(without[0].image)}: {words}{end}"


def _facts(made: "DetectedPhotos", records: Sequence[ImageRecord], folder: Path | None) -> Facts:
    search = made.search
    sizes = Counter(seen.image_size for seen in search.detections)
    shown = ", ".join(f"{width} x {height} px" for (width, height), _ in sizes.most_common(3))
    seen = {face.face for record in records for face in record.named}
    table, way = "" if made.table is None else str(made.table), way_to(made.table, folder)
    return Facts((
        ("target", printable(f"{made.target_file or 'given'}, id {search.target.geometry_id}")),
        ("photos", f"{len(search.results)}, {len(search.detections)} of them searched"),
        ("image", f"{shown}{', ...' if len(sizes) > 3 else ''}" if shown else "none could be read"),
        *(() if search.target.is_planar else (("faces seen", f"{len(seen)} of {search.target.face_count}"),)),
        *((("ring-like things without a name", str(sum(record.rejected for record in records))),)
          if search.target.marks is None else ()),
        ("found by", program()),
        *((("written to", printable(f"{table}; from this folder: {way}" if way else table)),) if table else ()),
    ))  # fmt: skip


def _sigma_words(search: Search) -> str:
    if not search.with_target:
        return ""
    return (
        f"The standard deviation of a centre is {span(map(median_sigma_px, search.with_target), 2)} px, the median of "
        f"a photo: from how well {search.target.feature_word} fit their pixels, which says nothing of a bent print."
    )


def _photos_table(search: Search, common: Sequence[str], pictures: Mapping[str, str]) -> Table:
    """A row a photo, whose name leads to its picture."""
    kind, word = Shown[PhotoResult], search.target.feature_word
    is_ours = search.target.marks is None
    found = f"{'rings and dots' if is_ours else word} that were named and measured"
    faces = kind("faces", lambda one: Cell(" ".join(map(str, _faces(one))), float(len(_faces(one)))),
                 "of the target, that were named")  # fmt: skip
    return table_of(
        search.results,
        kind("photo", lambda one: Cell(printable(one.photo.name), path=pictures.get(one.photo.name, ""),
                                       level=_level(one))),
        kind("found", lambda one: one.record.features, found),
        kind("expected", lambda one: one.record.expected, EXPECTED),
        *(() if search.target.is_planar else (faces,)),
        kind("sigma px", _sigma_px, "median of the centres' standard deviations, along their worse axis"),
        *((kind("margin", _margin, "how many marks fit the name of a face better than the next best name; the least"),
           kind("no name", lambda one: one.record.rejected, "ring-like things that got no name")) if is_ours else ()),
        kind("missing", _missing), kind("remark", lambda one: _remark(one, common)), title="All photos",
    )  # fmt: skip


def _faces(result: PhotoResult) -> list[int]:
    return sorted({face.face for face in result.record.named if face.face is not None})


def _sigma_px(result: PhotoResult) -> float:
    return math.nan if result.seen is None else median_sigma_px(result.seen)


def _margin(result: PhotoResult) -> Cell:
    margins = [face.margin for face in result.record.named if face.code_read]
    return whole(min(margins)) if margins else Cell("")


def _missing(result: PhotoResult) -> str:
    missing = result.record.missing.most_common()
    return ", ".join(f"{count} {why}" for why, count in missing if count and why not in NOT_MEASURABLE)


def _remark(result: PhotoResult, common: Sequence[str]) -> str:
    own = [remark for remark in result.record.remarks if remark not in common]
    return shortened("; ".join(filter(None, (result.record.failure, *own))))


def _share(result: PhotoResult) -> float:
    """Of the rings that could have been measured."""
    return result.record.features / result.record.expected if result.record.expected else 0.0


def _level(result: PhotoResult) -> Level | None:
    """None: like most."""
    level = level_of_share(_share(result)) if result.record.features else "bad"
    return None if level == "good" else level


def _shots(made: "DetectedPhotos", folder: Path, common: Sequence[str]) -> list[Shot]:
    """The pictures, the worst first."""
    inside = "" if made.overlays in (None, folder) else f"{made.overlays.relative_to(folder).as_posix()}/"
    shots = []
    for one in sorted(made.search.results, key=_share):
        if one.overlay is not None:
            word = made.search.target.feature_word
            rings = f"{one.record.features} of {one.record.expected} {word}, sigma {digits(_sigma_px(one), 2)} px"
            words = (rings if one.record.features else "not found", _missing(one), _remark(one, common))
            caption = ", ".join(filter(None, words))
            shots.append(Shot(f"{inside}{one.overlay.name}", one.photo.name, caption, _level(one)))
    return shots


def _faces_table(search: Search, records: Sequence[ImageRecord]) -> Table:
    """How often each face was seen, and how well."""
    seen = [face for record in records for face in record.named if face.rings_found]
    rows = [(row, [face for face in seen if face.face == row]) for row in range(search.target.face_count)]
    kind = Shown[tuple[int, list[FaceRecord]]]
    return table_of(
        rows, kind("face", lambda row: Cell(str(row[0]), float(row[0]), level=None if row[1] else "usable")),
        kind("photos", lambda row: len(row[1]), f"in which {search.target.feature_word} of it were measured"),
        kind("found", lambda row: sum(face.rings_found for face in row[1])),
        kind("expected", lambda row: sum(face.measurable for face in row[1]),
             f"of these photos, without those {UNMEASURABLE_WORDS}"),
        title="All faces",
    )  # fmt: skip


def _missing_section(records: Sequence[ImageRecord], word: str) -> Section:
    """Why features are missing, over all photos."""
    missing = sum((record.missing for record in records), Counter[str]())
    title = f"Why {word} are missing"
    if not any(record.features for record in records):
        lead = f"In no photo was a face named, so no {word[:-1]} can be told missing; what each shows stands above."
        return Section(title, (), lead=lead)
    if not missing:
        return Section(title, (), lead=f"No {word[:-1]} of a face that shows is missing.")
    lost = missing.total() - sum(missing[why] for why in NOT_MEASURABLE)
    note = f"{capital(word)} {UNMEASURABLE_WORDS} are not expected: no detector measures them."
    kind = Shown[tuple[str, int]]
    table = table_of(
        missing.most_common(), kind("reason", lambda row: row[0]), kind(word, lambda row: row[1]), title="Reasons",
        note=note if lost < missing.total() else "",
    )  # fmt: skip
    said = f"{lost} {word} are missing that could have been measured" if lost else f"Only {word} nobody could measure"
    return Section(title, (table,), lead=f"{said}.")


def _next(made: "DetectedPhotos") -> tuple[Command, ...]:
    """What to do with the detections."""
    if made.table is None or not made.search.with_target or not made.target_file:
        return ()
    places = (made.table, made.target_file, made.table.parent / SOLVED_FOLDER)
    table, target, out = (shlex.quote(printable(str(place))) for place in places)
    return (Command(f"calib solve {table} --target {target} -o {out}"),)
