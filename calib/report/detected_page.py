"""The page of the overlays of `calib detect`: what was found in each photo, and why rings are missing."""

from collections import Counter
from collections.abc import Sequence
from pathlib import Path

from calib.inputs.records import measurable
from calib.report.cells import number, whole
from calib.report.detected_file import DETECTED_FILE, DetectedFile, DetectedPhoto, read_detected
from calib.report.detected_words import (
    checks,
    checks_section,
    detected_headline,
    level_of,
    missing_of,
    missing_words,
    next_section,
    readable,
)
from calib.report.folder_blocks import files_section, warnings
from calib.report.gallery import Shot, gallery, is_there, title_of_pictures
from calib.report.origin import Origin
from calib.report.photo_rows import common_remarks
from calib.report.photos import shortened
from calib.results.evaluation_table import figure as digits
from calib.types import NOT_MEASURABLE, UNMEASURABLE_WORDS
from designer.command import printable
from designer.page.blocks import (
    Block,
    Cell,
    Column,
    Command,
    Facts,
    Finding,
    Findings,
    Level,
    Page,
    Section,
    Table,
)

MOST_FAILURES = 20
NO_MARGIN = -1


def detected_page(folder: Path, origin: Origin) -> Page:
    """Read a folder and build its page.

    Raises:
        InputError: `detected.json` cannot be read; the message names it.
    """
    file = read_detected(folder)
    common = common_remarks(file.records)
    rows = checks(file)
    headline = detected_headline(file, rows)
    photos = sorted(file.photos, key=_worst_first)
    shots = [
        Shot(photo.overlay, photo.record.image, _caption(photo, common), _level(photo))
        for photo in photos
        if photo.overlay
    ]
    blocks: tuple[Block, ...] = (
        *_said(file, common), *gallery(folder, shots, "The photos with most rings missing first."),
        _photos_table(folder, file, common),
    )  # fmt: skip
    if file.face_count > 1:
        blocks = (*blocks, _faces_table(file))
    sections = (
        checks_section(rows), next_section(file, headline.level),
        Section("Photos", blocks, lead=_lead(file)), _missing_section(file), _files(folder, file),
    )  # fmt: skip
    return Page(
        title=title_of_pictures(folder), kind="Detections", headline=headline, sections=sections,
        lead=(Facts(_facts(file)),), made_by=origin.command, program=origin.program,
    )  # fmt: skip


def _share(photo: DetectedPhoto) -> float:
    """Of the rings that could have been measured."""
    return photo.record.features / photo.expected if photo.expected else 0.0


def _worst_first(photo: DetectedPhoto) -> float:
    return _share(photo) if photo.record.features else -1.0


def _level(photo: DetectedPhoto) -> Level | None:
    """A photo that is like most has none."""
    if photo.record.failure or not photo.record.features:
        return "bad"
    level = level_of(_share(photo))
    return None if level == "good" else level


def _faces(photo: DetectedPhoto) -> list[int]:
    return sorted({face.face for face in photo.record.faces if face.face is not None})


def _margin(photo: DetectedPhoto) -> int:
    """The least by which a face was told from another; NO_MARGIN where nothing was read."""
    return min((face.margin for face in photo.record.faces if face.face is not None and face.code_read), default=-1)


def _remarks(photo: DetectedPhoto, common: Sequence[str]) -> str:
    own = [remark for remark in photo.record.remarks if remark not in common]
    return "; ".join(filter(None, (photo.record.failure, *own, photo.overlay_failure)))


def _caption(photo: DetectedPhoto, common: Sequence[str]) -> str:
    words = [f"{photo.record.features} of {photo.expected} rings" if photo.record.features else "not found"]
    if photo.sigma_px is not None:
        words.append(f"sigma {digits(photo.sigma_px, 2)} px")
    if missing := missing_words(missing_of(photo)):
        words.append(missing)
    if remarks := _remarks(photo, common):
        words.append(shortened(remarks))
    return ", ".join(words)


def _said(file: DetectedFile, common: Sequence[str]) -> tuple[Block, ...]:
    """What is said of all photos, and of those that could not be searched."""
    notes = tuple(Finding("note", "All photos", shortened(remark)) for remark in common)
    failed = [photo.record.failure for photo in file.photos if photo.record.failure]
    lines = [printable(line) for line in (*file.failures, *failed)]
    more = [f"{len(lines) - MOST_FAILURES} more"] if len(lines) > MOST_FAILURES else []
    return (*((Findings(notes),) if notes else ()), *warnings("Not searched", (*lines[:MOST_FAILURES], *more)))


def _lead(file: DetectedFile) -> str:
    sigmas = sorted(photo.sigma_px for photo in file.photos if photo.sigma_px is not None)
    if not sigmas:
        return ""
    least, most = digits(sigmas[0], 2), digits(sigmas[-1], 2)
    return (
        f"The standard deviation of a centre is {least if least == most else f'{least} to {most}'} px, the median of a "
        "photo: from how well a ring fits its pixels, which says nothing of a bent print."
    )


def _facts(file: DetectedFile) -> tuple[tuple[str, str], ...]:
    sizes = Counter(photo.record.image_size for photo in file.photos if photo.record.image_size is not None)
    shown = ", ".join(f"{width} x {height} px" for (width, height), _ in sizes.most_common(3))
    facts = [
        ("target", f"{printable(file.target)}, id {printable(file.geometry_id)[:40]}"),
        ("photos", f"{len(file.photos)}, {len(readable(file))} of them searched"),
        ("image", f"{shown}{', ...' if len(sizes) > 3 else ''}" if shown else "none could be read"),
    ]  # fmt: skip
    if file.face_count > 1:
        seen = {face for photo in file.photos for face in _faces(photo)}
        facts.append(("faces seen", f"{len(seen)} of {file.face_count}"))
    rejected = sum(photo.record.rejected for photo in file.photos)
    return (
        *facts,
        ("ring-like things without a name", str(rejected)),
        ("found by", printable(file.detector)),
        ("written to", printable(file.table)),
    )


def _photos_table(folder: Path, file: DetectedFile, common: Sequence[str]) -> Table:
    faces = (Column("faces", is_number=False, note="of the target, that were named"),) if file.face_count > 1 else ()
    columns = (
        Column("photo", is_number=False),
        Column("found", note="rings and dots that were named and measured"),
        Column("expected", note=f"of the faces that show, without those {UNMEASURABLE_WORDS}"),
        Column("found %"),
        *faces,
        Column("sigma px", note="median of the centres' standard deviations, along their worse axis"),
        Column("margin", note="how many marks fit the name of a face better than the next best name; the least"),
        Column("no name", note="ring-like things that got no name"),
        Column("missing", is_number=False),
        Column("remark", is_number=False),
    )
    rows = tuple(_photo_row(folder, photo, common, has_faces=file.face_count > 1) for photo in file.photos)
    return Table("All photos", columns, rows)


def _photo_row(folder: Path, photo: DetectedPhoto, common: Sequence[str], *, has_faces: bool) -> tuple[Cell, ...]:
    can_link = is_there(folder, photo.overlay)
    named = _faces(photo)
    margin = _margin(photo)
    return (
        Cell(printable(photo.record.image), path=photo.overlay if can_link else "", level=_level(photo)),
        whole(photo.record.features), whole(photo.expected),
        Cell(f"{100 * _share(photo):.1f}", 100 * _share(photo)) if photo.expected else Cell(""),
        *((Cell(" ".join(map(str, named)), float(len(named))),) if has_faces else ()),
        number(photo.sigma_px if photo.sigma_px is not None else float("nan"), 2),
        whole(margin) if margin != NO_MARGIN else Cell(""),
        whole(photo.record.rejected), Cell(missing_words(missing_of(photo))),
        Cell(shortened(_remarks(photo, common))),
    )  # fmt: skip


def _faces_table(file: DetectedFile) -> Table:
    """How often each face was seen, and how well."""
    photos, found, expected = Counter[int](), Counter[int](), Counter[int]()
    for photo in file.photos:
        for face in photo.record.faces:
            if face.face is None or not face.rings_found:
                continue
            photos[face.face] += 1
            found[face.face] += face.rings_found
            expected[face.face] += measurable(face)
    columns = (
        Column("face"), Column("photos", note="in which rings of it were measured"), Column("found"),
        Column("expected", note=f"of these photos, without those {UNMEASURABLE_WORDS}"),
    )  # fmt: skip
    rows = tuple(
        (Cell(str(face), float(face), level=None if photos[face] else "usable"), whole(photos[face]),
         whole(found[face]), whole(expected[face]))
        for face in range(file.face_count)
    )  # fmt: skip
    return Table("All faces", columns, rows)


def _missing_section(file: DetectedFile) -> Section:
    """Why rings are missing, over all photos."""
    missing = sum((missing_of(photo) for photo in file.photos), Counter[str]())
    title = "Why rings are missing"
    if not any(photo.record.features for photo in file.photos):
        lead = "In no photo was a face named, so no ring can be told missing; what each shows instead stands above."
        return Section(title, (), lead=lead)
    if not missing:
        return Section(title, (), lead="No ring of a face that shows is missing.")
    rows = tuple((Cell(printable(why)), whole(count)) for why, count in missing.most_common())
    unmeasurable = sum(missing[why] for why in NOT_MEASURABLE)
    note = f"Rings {UNMEASURABLE_WORDS} are not expected: no detector measures them." if unmeasurable else ""
    table = Table("Reasons", (Column("reason", is_number=False), Column("rings")), rows, note)
    lost = missing.total() - unmeasurable
    lead = f"{lost} rings are missing that could have been measured" if lost else "Only rings that nobody could measure"
    return Section(title, (table,), lead=f"{lead}.")


def _files(folder: Path, file: DetectedFile) -> Section:
    purposes = [(DETECTED_FILE, "what this page is built from")]
    place = file.table_from_here
    outside: tuple[Finding, ...] = ()
    if is_there(folder, place):
        purposes.insert(0, (place, "the detections, a line a ring: what a calibration reads"))
        records = Path(place).with_suffix(".records.json").as_posix()
        purposes.append((records, "what was read of each face, and why rings are missing"))
    else:
        where = f"; from this folder: {printable(place)}" if place else ""
        outside = (Finding("note", "Detections", f"They are in {printable(file.table)}{where}."),)
    section = files_section(folder, tuple(purposes), Command("calib report .", "in this folder: makes this page again"))
    blocks = (*((Findings(outside),) if outside else ()), *section.blocks)
    return Section(section.title, blocks)
