"""What `calib detect` tells of its photos: whether enough was found, why rings are missing, and what to do about it."""

import math
import os
import shlex
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from calib.core.number_text import figure as digits
from calib.core.types import NOT_MEASURABLE, UNMEASURABLE_WORDS
from calib.observe.records import ImageRecord, common_remarks, image_record
from calib.show.parts.folder_blocks import number, some_of, whole
from calib.show.parts.gallery import shortened
from calib.show.photos.levels import SHARE_RULE, level_of_share, worst_level
from calib.show.photos.photos_file import PHOTOS_FILE, ToldPhoto, ToldPhotos, ToldSection
from designer.base.words import capital, printable
from designer.page.blocks import (
    Cell,
    Column,
    Command,
    Finding,
    Findings,
    Headline,
    Level,
    Steps,
    Table,
    is_linkable,
)

if TYPE_CHECKING:
    from calib.observe.photos import PhotoResult
    from designer.target import TargetGeometry

WORDS: Mapping[Level, str] = {"good": "found", "usable": "found in part", "bad": "not found", "note": ""}


@dataclass(frozen=True)
class SearchedPhoto:
    """A photo that was searched, or could not be."""

    record: ImageRecord
    sigma_px: float  # median standard deviation of the centres; nan: there are none
    overlay: str  # within the folder; "": there is none
    overlay_failure: str  # why

    @property
    def expected(self) -> int:
        """Features of the faces that show, without those that nobody could measure."""
        return sum(face.measurable for face in self.record.faces if face.face is not None)

    @property
    def share(self) -> float:
        """Of the rings that could have been measured."""
        return self.record.features / self.expected if self.expected else 0.0

    @property
    def faces(self) -> list[int]:
        """The faces that were named."""
        return sorted({face.face for face in self.record.faces if face.face is not None})

    @property
    def missing(self) -> Counter[str]:
        """Why rings of faces that show are missing, those seen too flat among them."""
        missing = Counter[str]()
        for face in self.record.faces:
            if face.face is not None:
                missing.update(dict(face.missing))
        return missing

    @property
    def level(self) -> Level | None:
        """A photo that is like most has none."""
        if self.record.failure or not self.record.features:
            return "bad"
        level = level_of_share(self.share)
        return None if level == "good" else level


@dataclass(frozen=True)
class Detected:
    """What was found in photos, and where it is."""

    target: Path  # its file
    geometry: "TargetGeometry"
    detector: str  # program and version
    table: Path  # the detections
    table_from_here: str  # the way to it from the page's folder; "" if there is none
    photos: tuple[SearchedPhoto, ...]
    failures: tuple[str, ...]  # arguments that stood for no photo, one line each

    @property
    def readable(self) -> list[SearchedPhoto]:
        """The photos that could be read and searched."""
        return [photo for photo in self.photos if not photo.record.failure]

    @property
    def showing(self) -> list[SearchedPhoto]:
        """Those that show the target."""
        return [photo for photo in self.readable if photo.record.features]

    @property
    def common_remarks(self) -> tuple[str, ...]:
        """What is remarked of each of several photos."""
        return common_remarks([photo.record.remarks for photo in self.readable])

    @property
    def counts(self) -> tuple[int, int]:
        """Rings that were found, and that could have been measured."""
        return sum(photo.record.features for photo in self.readable), sum(photo.expected for photo in self.readable)


def detected(
    folder: Path,
    target: Path,
    geometry: "TargetGeometry",
    table: Path,
    results: "Sequence[PhotoResult]",
    sigmas_px: Sequence[float],
    failures: Sequence[str],
    *,
    overlays: Path | None = None,
) -> Detected:
    """What the search of photos gave.

    Args:
        folder: of the page.
        target: its file.
        geometry: the target.
        table: the detections that were written.
        results: of each photo.
        sigmas_px: median standard deviation of each photo's centres; nan without centres.
        failures: arguments that stood for no photo.
        overlays: their folder, within the page's (default: the page's).
    """
    from designer.base.answer import program

    way = "" if overlays is None or overlays == folder else f"{overlays.relative_to(folder).as_posix()}/"
    photos = tuple(_searched(result, sigma_px, way) for result, sigma_px in zip(results, sigmas_px, strict=True))
    return Detected(target, geometry, program(), table, _from_folder(table, folder), photos, tuple(failures))


def _from_folder(path: Path, folder: Path) -> str:
    """The way from a folder to a file, with "/" between folders."""
    try:
        return Path(os.path.relpath(os.path.realpath(path), os.path.realpath(folder))).as_posix()
    except ValueError:  # on another drive
        return ""


def _searched(result: "PhotoResult", sigma_px: float, way: str) -> SearchedPhoto:
    if result.seen is None:
        record = ImageRecord(result.photo.name, None, 0, 0, (), (), result.failure)
        return SearchedPhoto(record, math.nan, "", "")
    overlay = "" if result.overlay is None else f"{way}{result.overlay.name}"
    return SearchedPhoto(image_record(result.seen), sigma_px, overlay, result.overlay_failure)


def told_detected(made: Detected) -> ToldPhotos:
    """What the page says."""
    rows, common = _checks(made), made.common_remarks
    level = worst_level(rows)
    faces = (ToldSection("Faces", (_faces_table(made),)),) if not made.geometry.is_planar else ()
    return ToldPhotos(
        "detections", _headline(made, level), _facts(made), _columns(made),
        tuple(_photo(made, photo, common) for photo in made.photos),
        "The photos with most rings missing first.", _files(made),
        lead=_sigma_words(made), notes=_notes(made),
        before=(
            ToldSection("Was enough found?", (Findings(rows),), "The headline is the worst of these."),
            _next(made, level),
        ),
        after=(*faces, _missing_section(made)), geometry_id=made.geometry.geometry_id,
    )  # fmt: skip


def _checks(made: Detected) -> tuple[Finding, ...]:
    """What was found against what could have been."""
    searched, asked = len(made.readable), len(made.photos) + len(made.failures)
    rows = [_check("Photos that show the target", len(made.showing), searched, "Of the photos that could be read.")]
    if made.showing:
        flat = "Rings that are seen too flat are not counted."
        rows.insert(0, _check("Rings of the faces that show", *made.counts, flat))
    if searched < asked:
        rows.append(_check("Photos that could be read", searched, asked, "The others are listed with the reason."))
    return tuple(rows)


def _check(title: str, part: int, whole: int, text: str) -> Finding:
    share = part / whole if whole else 0.0
    percent = f"{int(1000 * share + 1e-9) / 10:g} %"  # rounded down, so that 100 % are all
    return Finding(level_of_share(share), title, text, f"{part} of {whole} ({percent})", SHARE_RULE)


def _headline(made: Detected, level: Level) -> Headline:
    """The worst of the checks, and the counts."""
    photos = "1 photo" if len(made.photos) == 1 else f"{len(made.photos)} photos"
    if made.showing:
        found, expected = made.counts
        sentence = (
            f"The target was found in {len(made.showing)} of {photos}, with {found} of the {expected} rings "
            "that could have been measured."
        )
    else:
        sentence = f"The target was found in none of {photos}. {_first_reason(made)}".rstrip()
    if failed := len(made.photos) - len(made.readable):
        sentence += f" {failed} could not be read."
    return Headline(level, WORDS[level], sentence)


def _first_reason(made: Detected) -> str:
    """What is said of a photo that does not show the target, as a sentence; "" if nothing is."""
    without = [photo.record for photo in made.readable if not photo.record.features and photo.record.remarks]
    if not without:
        return ""
    words = printable("; ".join(without[0].remarks))
    is_same = all(record.remarks == without[0].remarks for record in without)
    return f"{capital(words)}." if is_same else f"{printable(without[0].image)}: {words}."


def _facts(made: Detected) -> tuple[tuple[str, str], ...]:
    sizes = Counter(photo.record.image_size for photo in made.photos if photo.record.image_size is not None)
    shown = ", ".join(f"{width} x {height} px" for (width, height), _ in sizes.most_common(3))
    facts = [
        ("target", f"{made.target}, id {made.geometry.geometry_id}"),
        ("photos", f"{len(made.photos)}, {len(made.readable)} of them searched"),
        ("image", f"{shown}{', ...' if len(sizes) > 3 else ''}" if shown else "none could be read"),
    ]  # fmt: skip
    if not made.geometry.is_planar:
        seen = {face for photo in made.photos for face in photo.faces}
        facts.append(("faces seen", f"{len(seen)} of {made.geometry.face_count}"))
    way = f"; from this folder: {made.table_from_here}" if made.table_from_here else ""
    return (
        *facts,
        ("ring-like things without a name", str(sum(photo.record.rejected for photo in made.photos))),
        ("found by", made.detector),
        ("written to", f"{made.table}{way}"),
    )


def _sigma_words(made: Detected) -> str:
    sigmas_px = sorted(photo.sigma_px for photo in made.photos if math.isfinite(photo.sigma_px))
    if not sigmas_px:
        return ""
    least, most = digits(sigmas_px[0], 2), digits(sigmas_px[-1], 2)
    return (
        f"The standard deviation of a centre is {least if least == most else f'{least} to {most}'} px, the median of a "
        "photo: from how well a ring fits its pixels, which says nothing of a bent print."
    )


def _notes(made: Detected) -> tuple[Finding, ...]:
    """What is said of all photos, and of those that could not be searched."""
    failed = [*made.failures, *(photo.record.failure for photo in made.photos if photo.record.failure)]
    return (
        *(Finding("note", "All photos", shortened(remark)) for remark in made.common_remarks),
        *(Finding("usable", "Not searched", line) for line in some_of(failed)),
    )


def _columns(made: Detected) -> tuple[Column, ...]:
    faces = (Column("faces", is_number=False, note="of the target, that were named"),)
    return (
        Column("found", note="rings and dots that were named and measured"),
        Column("expected", note=f"of the faces that show, without those {UNMEASURABLE_WORDS}"),
        Column("found %"),
        *(faces if not made.geometry.is_planar else ()),
        Column("sigma px", note="median of the centres' standard deviations, along their worse axis"),
        Column("margin", note="how many marks fit the name of a face better than the next best name; the least"),
        Column("no name", note="ring-like things that got no name"),
        Column("missing", is_number=False),
        Column("remark", is_number=False),
    )


def _photo(made: Detected, photo: SearchedPhoto, common: tuple[str, ...]) -> ToldPhoto:
    record, faces = photo.record, photo.faces
    own = [remark for remark in record.remarks if remark not in common]
    remark = shortened("; ".join(filter(None, (record.failure, *own, photo.overlay_failure))))
    missing = ", ".join(
        f"{count} {why}" for why, count in photo.missing.most_common() if count and why not in NOT_MEASURABLE
    )
    margins = [face.margin for face in record.faces if face.face is not None and face.code_read]
    cells = (
        whole(record.features), whole(photo.expected),
        Cell(f"{100 * photo.share:.1f}", 100 * photo.share) if photo.expected else Cell(""),
        *((Cell(" ".join(map(str, faces)), float(len(faces))),) if not made.geometry.is_planar else ()),
        number(photo.sigma_px, 2), whole(min(margins)) if margins else Cell(""), whole(record.rejected), Cell(missing),
        Cell(remark),
    )  # fmt: skip
    words = (
        f"{record.features} of {photo.expected} rings" if record.features else "not found",
        f"sigma {digits(photo.sigma_px, 2)} px" if math.isfinite(photo.sigma_px) else "", missing, remark,
    )  # fmt: skip
    return ToldPhoto(record.image, cells, photo.overlay, ", ".join(filter(None, words)), photo.level, 1 - photo.share)


def _faces_table(made: Detected) -> Table:
    """How often each face was seen, and how well."""
    seen = [face for photo in made.photos for face in photo.record.faces if face.face is not None and face.rings_found]
    columns = (
        Column("face"), Column("photos", note="in which rings of it were measured"), Column("found"),
        Column("expected", note=f"of these photos, without those {UNMEASURABLE_WORDS}"),
    )  # fmt: skip
    rows = []
    for number_ in range(made.geometry.face_count):
        own = [face for face in seen if face.face == number_]
        rows.append((
            Cell(str(number_), float(number_), level=None if own else "usable"), whole(len(own)),
            whole(sum(face.rings_found for face in own)), whole(sum(face.measurable for face in own)),
        ))  # fmt: skip
    return Table("All faces", columns, tuple(rows))


def _missing_section(made: Detected) -> ToldSection:
    """Why rings are missing, over all photos."""
    missing = sum((photo.missing for photo in made.photos), Counter[str]())
    title = "Why rings are missing"
    if not made.showing:
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


def _files(made: Detected) -> tuple[tuple[str, str], ...]:
    table = made.table_from_here
    own = (
        (table, "the detections, a line a ring: what a calibration reads"),
        (Path(table).with_suffix(".records.json").as_posix(), "what was read of each face, and why rings are missing"),
    ) if is_linkable(table) else ()  # fmt: skip
    return *own, (PHOTOS_FILE, "what this page is built from")


def _next(made: Detected, level: Level) -> ToldSection:
    """What to do with the detections."""
    blocks: list[Command | Steps] = []
    if made.showing:
        target, table = (shlex.quote(printable(str(path))) for path in (made.target, made.table))
        blocks.append(Command(
            f"calib solve {table} --target {target} -o DIR", "solves the camera; type it where calib detect was typed"
        ))  # fmt: skip
    if level != "good":
        blocks.append(Steps((
            "Open the overlays of photos without the target: is it the target of this file, sharp, and at least a "
            "quarter of the image wide?",
            "Where rings are missing, the reason is in the table: come nearer where they are small, avoid reflections "
            "where they are faint or covered.",
            "Leave out photos in which the target was found by a few rings only.",
        )))  # fmt: skip
    lead = {
        "good": "Look at some overlays, then solve the camera.",
        "usable": "Enough to go on with, if the rings that are missing are not all in one part of the image.",
    }.get(level, "Find out why before going on.")
    return ToldSection("Next", tuple(blocks), lead)
