"""The page of `calib measure`: how a print differs from its design, and whether the measured target is better."""

import shlex
from pathlib import Path

from calib.as_built_report.as_built_file import AS_BUILT, AsBuiltRecord, settings_of
from calib.as_built_report.files import TARGET_SUFFIX
from calib.as_built_report.words import is_plastic
from calib.show.measured.measure_scene import measure_view
from calib.show.measured.measure_tables import cameras_table, faces_table, lengths_table, rings_table, whole_table
from calib.show.measured.measure_words import (
    deviation_sentence,
    face_sentence,
    gain_findings,
    gain_sentence,
    judged_gain,
    measure_headline,
    next_print,
)
from calib.show.parts.folder_blocks import notes, question_section, read_small_bytes, size_bytes, warnings
from calib.show.parts.origin import Origin
from designer.base.errors import InputError
from designer.base.words import capital, printable
from designer.page.blocks import (
    Block,
    Command,
    Figure,
    FileList,
    FileRow,
    Finding,
    Findings,
    Fold,
    Link,
    Page,
    Paragraph,
    Section,
    is_linkable,
)
from designer.target import TargetGeometry, load_target

QUESTION = (
    "How does the printed target differ from its design, and is a calibration with the target as it was measured "
    "better than one with the drawing? Camera, faces and rings are solved together from photos of the print."
)
NAMES = {
    "target": "target as designed", "detections": "detections", "model": "camera model", "rings": "rings",
    "one-camera": "one camera", "weighted": "weighted", "reject": "left out beyond, sigmas", "bow": "bow of faces",
    "fix": "fixed parameters", "share": "shared parameters", "shrink-compensation": "made with shrink compensation",
    "skew-compensation": "made with skew compensation", "bed-turn": "turned on the bed by", "length": "lengths given",
    "held-out": "parts held out",
}  # fmt: skip
REPORT_SUFFIX = ".as_built.json"
MAX_PICTURE_BYTES = 3_500_000
LONGEST_SETTING = 300
OUT_OPTIONS = ("-o", "--out")


def measure_page(folder: Path, origin: Origin) -> Page:
    """The page of a measured print.

    Raises:
        InputError: NAME.as_built.json is damaged.
    """
    stem, others = measured_stem(folder, origin.command)
    record = AS_BUILT.read_if_there(folder / f"{stem}{REPORT_SUFFIX}") if stem else None
    target, wrong = _target(folder / f"{stem}{TARGET_SUFFIX}", record)
    lines = [*wrong, *(f"{name}: another print in this folder, which this page is not of" for name in others)]
    careful = warnings("File", lines)
    title = printable(stem) or printable(folder.absolute().name) or "print"
    if record is None:
        text = f"NAME{REPORT_SUFFIX} is missing: measure the print with photos, and what was found stands here."
        missing = Findings((Finding("usable", "No measurement", text),))
        sections = (question_section(QUESTION, (), missing, *careful), _files(folder, stem))
        return Page(title, "Measured print", None, sections, made_by=origin.command, program=origin.program)
    view = None if target is None else measure_view(record, target)
    return Page(
        title, "Measured print", measure_headline(record),
        (
            question_section(QUESTION, _setting(record), *warnings("Remark", record.remarks), *careful),
            _whole(record, target), _faces(folder, stem, record, target), _gain(record),
            _next(stem, record, target), _files(folder, stem),
        ),
        lead=() if view is None else (view,), made_by=origin.command, program=origin.program,
    )  # fmt: skip


def measured_stem(folder: Path, command: str) -> tuple[str, tuple[str, ...]]:
    """The name of the print that a page is of, and those of others in the folder.

    Of several it is the one that the command wrote, or the first by name.
    """
    found = sorted(path.name.removesuffix(REPORT_SUFFIX) for path in folder.glob(f"*{REPORT_SUFFIX}"))
    named = _named_in(command)
    stem = named if named in found else next(iter(found), named)
    return stem, tuple(printable(name) for name in found if name != stem)


def _named_in(command: str) -> str:
    """The name behind `-o` in a command; "" if there is none."""
    try:
        words = shlex.split(command)
    except ValueError:
        return ""
    for place, word in enumerate(words):
        option, _, value = word.partition("=")
        if option in OUT_OPTIONS:
            out = value or next(iter(words[place + 1 : place + 2]), "")
            name = Path(out).name
            return name.removesuffix(TARGET_SUFFIX) if name.endswith(TARGET_SUFFIX) else ""
    return ""


def _target(path: Path, record: AsBuiltRecord | None) -> tuple[TargetGeometry | None, tuple[str, ...]]:
    """The measured target, and why it cannot be shown."""
    if record is None:
        return None, ()
    try:
        target = load_target(path)
    except InputError as error:
        return None, (printable(str(error).replace(str(path), path.name)),)
    fits = (target.face_count, target.ring_count) == (record.face_count, len(record.ring_offset_mm))
    if not fits or target.geometry_id != record.measured_geometry_id:
        return None, (f"{printable(path.name)}: not the target of this measurement: measure the print again",)
    return target, ()


def _setting(record: AsBuiltRecord) -> list[tuple[str, str]]:
    views, seen = (sum(getattr(one, name) for one in record.cameras) for name in ("views", "observations"))
    facts = [("photos", f"{views} of {len(record.cameras)} camera{'s' * (len(record.cameras) != 1)}, {seen} sightings")]
    for name, value in settings_of(record).items():
        text = printable(value)
        short = text if len(text) <= LONGEST_SETTING else f"{text[: LONGEST_SETTING - 3]}..."
        facts.append((NAMES.get(name, name), {"True": "yes", "False": "no"}.get(short, short)))
    if record.observation_sigma is not None:
        unit = "times the stated sigma" if record.settings.get("weighted") == "True" else "px"
        facts.append(("standard deviation of a sighting", f"{record.observation_sigma:.4f} {unit}"))
    return [*facts, ("solution", record.status), ("measured by", record.program)]


def _whole(record: AsBuiltRecord, target: TargetGeometry | None) -> Section:
    lengths = lengths_table(record)
    blocks: tuple[Block, ...] = (whole_table(record, target), *(() if lengths is None else (lengths,)))
    if record.size is None:
        blocks = (
            Paragraph(
                "The size is not known: photos do not tell it. The measured target is as large as the design; measure "
                "one length with a caliper and give it with --length."
            ),
            *blocks,
        )
    return Section("The whole print", blocks, lead=deviation_sentence(record))


def _faces(folder: Path, stem: str, record: AsBuiltRecord, target: TargetGeometry | None) -> Section:
    """Faces and rings one by one."""
    faces, rings = faces_table(record), rings_table(record, target)
    picture = _picture(folder, stem, record)
    blocks: tuple[Block, ...] = (*(() if picture is None else (picture,)), *(() if faces is None else (faces,)))
    if picture is None:
        text = f"{printable(stem)}.as_built.png: not there, or not a picture. Measure the print again."
        blocks = (Findings((Finding("usable", "The picture is missing", text),)), *blocks)
    if rings is not None:
        blocks = (*blocks, Fold(f"Ring by ring ({len(rings.rows)})", (rings,)))
    lead = face_sentence(record)
    return Section("Faces and rings", blocks, lead=f"{capital(lead)}." if lead else "")


def _picture(folder: Path, stem: str, record: AsBuiltRecord) -> Figure | None:
    """The picture that the measurement left."""
    from designer.page.pictures import raster_of

    name = f"{stem}.as_built.png"
    content = read_small_bytes(folder / name, MAX_PICTURE_BYTES)
    try:
        image = None if content is None else raster_of(content)
    except ValueError:
        image = None
    if image is None:
        return None
    links = (Link("PNG", name),) if is_linkable(name) else ()
    return Figure(
        "The target as it was printed", image, deviation_sentence(record),
        "Colour: out (red) or in (blue); dashed outlines and arrows: in the plane, exaggerated as the picture says.",
        links, is_wide=True,
    )  # fmt: skip


def _gain(record: AsBuiltRecord) -> Section:
    """Whether the measured target is better."""
    rows = tuple(gain_findings(record))
    held = record.held_out
    blocks: tuple[Block, ...] = (Findings(rows),) if rows else ()
    blocks += () if held is None else notes(held.remarks)
    title = "Gain"
    if held is None:
        blocks = (Paragraph("No photos were held out: measure again with --held-out 5 to judge the gain."), *blocks)
    else:
        blocks = (
            *blocks,
            Paragraph(
                f"Root mean square errors of photos held out, in {held.parts} parts: camera and target are solved from "
                "the other parts, only a photo's own pose from itself."
            ),
        )
    return Section(title, (*blocks, cameras_table(record)), lead=gain_sentence(record))


def _next(stem: str, record: AsBuiltRecord, target: TargetGeometry | None) -> Section:
    """The next print, and the next calibration with what was judged better."""
    commands, lines = next_print(record, plastic=target is None or is_plastic(target))
    name = printable(f"{stem}{TARGET_SUFFIX}")
    blocks: list[Block] = []
    gain = judged_gain(record)
    is_better = record.status != "degenerate" and gain is not None and bool(gain.is_better)
    if is_better:
        command = f"calib run {shlex.quote(name)} PHOTOS -o DIR"
        blocks.append(Command(command, "calibrates with the target as it was printed"))
    blocks += commands
    blocks += [Paragraph(line) for line in lines]
    lead = "Calibrate with the measured target, and correct the next print."
    return Section("Next", tuple(blocks), lead=lead if is_better else "Keep the drawing until photos show a gain.")


def _files(folder: Path, stem: str) -> Section:
    purposes = (
        (TARGET_SUFFIX, "the target as it was printed, with the covariances of its faces"),
        (REPORT_SUFFIX, "all numbers with their covariances"),
        (".as_built.csv", "a line a number, with its sigma"), (".as_built.png", "the picture"),
    )  # fmt: skip
    rows = tuple(
        FileRow(f"{stem}{end}", why, size)
        for end, why in purposes
        if stem and is_linkable(f"{stem}{end}") and (size := size_bytes(folder / f"{stem}{end}")) is not None
    )
    again = Command("calib report .", "in this folder: makes this page again")
    return Section("Files", (*((FileList(rows),) if rows else ()), again))
