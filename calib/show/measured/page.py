"""The page of `calib measure`: how a print differs from its design, and whether the measured target is better."""

import shlex
from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

from calib.records.as_built_file import AS_BUILT, AsBuiltRecord
from calib.show.measured.files import TARGET_SUFFIX, places_of
from calib.show.measured.next_print import next_steps
from calib.show.measured.scene import measure_view
from calib.show.measured.tables import cameras_table, faces_table, gains_table, rings_table, whole_table
from calib.show.measured.words import (
    deviation_sentence,
    face_sentence,
    facts_of,
    findings_of,
    gain_sentence,
    headline_of,
    is_plastic,
    validation_findings,
    why_not,
)
from calib.show.parts.origin import Origin
from designer.base.errors import InputError
from designer.base.words import capital, cut, printable
from designer.page.blocks import (
    Block,
    Command,
    Facts,
    Figure,
    Finding,
    Findings,
    Fold,
    Headline,
    Level,
    Link,
    Page,
    Paragraph,
    Section,
    View3d,
    is_linkable,
)
from designer.page.folders import files_section, question_section, read_small_bytes
from designer.target import TargetGeometry, load_target

QUESTION = (
    "How does the printed target differ from its design, and is a calibration with the target as it was measured "
    "better than one with the drawing? Camera, faces and rings are solved together from photos of the print."
)
RECORD_SUFFIX = ".as_built.json"
MAX_PICTURE_BYTES = 3_500_000
LONGEST_SETTING = 300
WORST_LAST: tuple[Level, ...] = ("good", "note", "usable", "bad")


@dataclass(frozen=True, eq=False)
class MeasuredPrint:
    """One measured print of a folder."""

    folder: Path
    stem: str
    record: AsBuiltRecord
    target: TargetGeometry | None  # as it was printed; None: it cannot be shown
    fault: str  # why not

    @cached_property
    def view(self) -> tuple[View3d, ...]:
        """The print in 3D, if it can be shown."""
        view = None if self.target is None else measure_view(self.record, self.target)
        return () if view is None else (view,)

    @property
    def findings(self) -> Findings:
        """What a person must know."""
        fault = (Finding("usable", "File", self.fault),) if self.fault else ()
        return Findings((*findings_of(self.record).rows, *fault))


def measure_page(folder: Path, origin: Origin) -> Page:
    """The page of the measured prints of a folder.

    Raises:
        InputError: a NAME.as_built.json is damaged.
    """
    prints = [_read(path) for path in sorted(folder.glob(f"?*{RECORD_SUFFIX}"))]
    kind, folder_name = "Measured print" + "s" * (len(prints) > 1), printable(folder.absolute().name)
    if not prints:
        text = f"NAME{RECORD_SUFFIX} is missing: measure the print with photos, and what was found stands here."
        missing = Findings((Finding("usable", "No measurement", text),))
        nothing = (question_section(QUESTION, (), missing), _files(folder, ()))
        return Page(folder_name or "print", kind, None, nothing, made_by=origin.command, program=origin.program)
    headlines = [headline_of(one.record) for one in prints]
    if len(prints) == 1:
        (one,), (headline,) = prints, headlines
        asked = question_section(QUESTION, _setting(one.record), one.findings)
        return Page(
            printable(one.stem), kind, headline, (asked, *_sections(one), _files(folder, prints)), lead=one.view,
            made_by=origin.command, program=origin.program, is_negative=bool(why_not(one.record)),
        )  # fmt: skip
    worst = max((one.level for one in headlines), key=WORST_LAST.index)
    each = "; ".join(f"{printable(one.stem)}: {told.word}" for one, told in zip(prints, headlines, strict=True))
    return Page(
        folder_name or "prints", kind, Headline(worst, f"{len(prints)} prints", f"{each}."),
        (question_section(QUESTION, ()), *(_whole_print(one) for one in prints), _files(folder, prints)),
        made_by=origin.command, program=origin.program, is_negative=any(why_not(one.record) for one in prints),
    )  # fmt: skip


def _read(path: Path) -> MeasuredPrint:
    """A print's files."""
    stem, record = path.name.removesuffix(RECORD_SUFFIX), AS_BUILT.read(path)
    place = path.with_name(f"{stem}{TARGET_SUFFIX}")
    try:
        target = load_target(place)
    except InputError as error:
        return MeasuredPrint(path.parent, stem, record, None, printable(str(error).replace(str(place), place.name)))
    fits = (target.face_count, target.ring_count) == (len(record.face_motion), len(record.ring_offset_mm))
    if not fits or target.geometry_id != record.measured_geometry_id:
        fault = f"{printable(place.name)}: not the target of this measurement: measure the print again"
        return MeasuredPrint(path.parent, stem, record, None, fault)
    return MeasuredPrint(path.parent, stem, record, target, "")


def _setting(record: AsBuiltRecord) -> tuple[tuple[str, str], ...]:
    """What was measured from, and how."""
    given = [
        (name.replace("-", " "), cut(value, LONGEST_SETTING))
        for name, text in record.settings.items()
        if (value := {"True": "yes", "False": "no"}.get(text, printable(text))).strip()
    ]
    return (*facts_of(record).rows, *given, ("measured by", record.program))


def _sections(one: MeasuredPrint) -> tuple[Section, ...]:
    """All that is told of a print."""
    record, target = one.record, one.target
    use = f"calib run {shlex.quote(printable(f'{one.stem}{TARGET_SUFFIX}'))} PHOTOS -o DIR"
    gains, whole = gains_table(record), whole_table(record, target)
    validated = (validation_findings(record), *(() if gains is None else (gains,)), cameras_table(record))
    return (
        Section("The whole print", () if whole is None else (whole,), lead=deviation_sentence(record)),
        _faces(one),
        Section("Cross-validation", validated, lead=gain_sentence(record)),
        Section("Next", next_steps(record, use, plastic=target is None or is_plastic(target))),
    )


def _whole_print(one: MeasuredPrint) -> Section:
    """All of one print in one section, where a folder has several."""
    headline = headline_of(one.record)
    answer = Findings((Finding(headline.level, headline.word, headline.sentence),))
    inside: list[Block] = []
    for section in _sections(one):
        folded = [leaf for block in section.blocks for leaf in (block.blocks if isinstance(block, Fold) else (block,))]
        inside.append(Fold(section.title, (*((Paragraph(section.lead),) if section.lead else ()), *folded)))
    return Section(printable(one.stem), (answer, *one.view, Facts(_setting(one.record)), one.findings, *inside))


def _faces(one: MeasuredPrint) -> Section:
    """Faces and rings one by one."""
    faces, rings, picture = faces_table(one.record), rings_table(one.record, one.target), _picture(one)
    text = f"{printable(one.stem)}.as_built.png: not there, or not a picture. Measure the print again."
    missing = Findings((Finding("usable", "The picture is missing", text),))
    blocks: tuple[Block, ...] = (missing if picture is None else picture, *(() if faces is None else (faces,)))
    if rings is not None:
        blocks = (*blocks, Fold(f"Ring by ring ({len(rings.rows)})", (rings,)))
    lead = face_sentence(one.record)
    return Section("Faces and rings", blocks, lead=f"{capital(lead)}." if lead else "")


def _picture(one: MeasuredPrint) -> Figure | None:
    """The picture that the measurement left."""
    from designer.page.pictures import raster_of

    name = f"{one.stem}.as_built.png"
    content = read_small_bytes(one.folder / name, MAX_PICTURE_BYTES)
    try:
        image = None if content is None else raster_of(content)
    except ValueError:
        image = None
    if image is None:
        return None
    links = (Link("PNG", name),) if is_linkable(name) else ()
    return Figure(
        "The target as it was printed", image, deviation_sentence(one.record),
        "Colour: out (red) or in (blue); arrows: in the plane, exaggerated as the picture says.",
        links, is_wide=True,
    )  # fmt: skip


def _files(folder: Path, prints: Iterable[MeasuredPrint]) -> Section:
    purposes = (
        "the target as it was printed, with the covariances of its faces", "all numbers with their covariances",
        "a line a number, with its sigma", "the picture",
    )  # fmt: skip
    rows: list[tuple[str, str]] = []
    for one in prints:
        places = places_of(folder / f"{one.stem}{TARGET_SUFFIX}")
        names = (place.name for place in (places.target, places.record, places.table, places.picture))
        rows += zip(names, purposes, strict=True)
    return files_section(folder, rows, Command("calib report .", "in this folder: makes this page again"))
