"""The design folder's page, `index.html`: what was designed, how to make it, what to measure on it, what comes next.

It follows from the spec and the files alone, so `design make` on the folder's TOML file writes the same bytes.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import cast

from designer.base.answer import program
from designer.base.solid import CODES, code_positions
from designer.base.units import NO_SKEW, format_skew
from designer.base.words import capital, with_article
from designer.formats.folder import OutputFile
from designer.kinds.layout import adjacent_faces, opposite_faces
from designer.make.bed import printed_size_mm
from designer.make.printability import RULES, PrintCheck, sentence
from designer.page.blocks import (
    Block,
    Cell,
    Column,
    Facts,
    Figure,
    FileList,
    FileRow,
    Fold,
    Headline,
    Leaf,
    Link,
    Page,
    Paragraph,
    Section,
    Steps,
    Table,
    View3d,
)
from designer.page.shell import page_html
from designer.produce import Design, maker_of
from designer.report.costs import Costs, cost_section, cost_sentence, costs_of, verdict
from designer.report.making import colour_words, layers_of
from designer.report.measuring import measure_blocks, photo_blocks
from designer.report.pictures import Panels, preview_panels, printed_ink, printed_scene
from designer.report.stands import stand_section, trial_sections
from designer.spec.format import FORMATS
from designer.spec.spec import PrintSpec
from designer.target import TargetGeometry

PAGE_FILE = "index.html"
RULES_TITLE = "Printability"
_MEASURE_LEAD = (
    "The print is not the drawing. A length and the photos say by how much, and the calibration uses what was printed."
)
DOT, RING = "●", "○"

Guide = Callable[[str, TargetGeometry, str], tuple[str, ...]]
"""What to do with the files of a format for lasers, cutters or board houses."""


@dataclass(frozen=True, eq=False)
class Written:
    """What a run wrote, and what an earlier run of the same name left beside it."""

    folder: Path
    files: tuple[OutputFile, ...]
    left: tuple[str, ...]
    replaced: tuple[str, ...]  # a line on another target that stood under this name
    page: Page  # of which the terminal tells the lead


def page_file(page: Page) -> OutputFile:
    """The page as a file of the folder. The same spec gives the same bytes."""
    return OutputFile(PAGE_FILE, page_html(page), "this folder at a glance: open it in a browser")


def design_page(design: Design, check: PrintCheck, files: Sequence[OutputFile], costs: Costs | None = None) -> Page:
    """The page of a design.

    Args:
        design: what was made.
        check: what the design rules said of it.
        files: all other files of the folder.
        costs: what it takes, if that is known already.
    """
    job, costs = design.job, costs or costs_of(design)
    preview = next((file.content for file in files if file.name == f"{job.name}.png"), None)
    panels, others = None if preview is None else preview_panels(preview), other_makers(design, files)
    return Page(
        title=job.name,
        kind="Target",
        headline=headline(job.printing, check, costs),
        lead=_lead(design, panels),
        sections=(
            *((cost_section(costs, job.printing, layers_of(design)),) if costs.is_printed else ()),
            Section(RULES_TITLE, (check.told(),), _rule_lead(job.printing, check)),
            maker_of(job.printing).making(design, files),
            *((stand_section(design),) if job.printing.stand else ()),
            *(() if others is None else (others,)),
            *_use_sections(design, panels),
            Section(
                "Files",
                (FileList(tuple(FileRow(file.name, file.purpose, len(file.content)) for file in files)),),
                f"{job.name}.target.json is the file that calib reads.",
            ),
        ),
        made_by=f"design make {job.name}.toml",
        program=program(),
    )


def other_makers(design: Design, files: Sequence[OutputFile]) -> Section | None:
    """A fold for each such format; None where there is none.

    Args:
        design: what is made.
        files: of the folder.
    """
    folds = tuple(_folds(design, [file.name for file in files]))
    lead = "The same pattern, made in another way; each file is all that a maker needs."
    return Section("Lasers, cutters, board houses", folds, lead) if folds else None


def _folds(design: Design, names: Sequence[str]) -> Iterator[Fold]:
    for format_name in design.job.formats:
        entry = FORMATS[format_name]
        if not entry.guide:
            continue
        steps = cast(Guide, import_module(f"designer.formats.{entry.guide}").steps)
        mine = [name for name in names if name.endswith(entry.suffix)]
        listed = " and ".join(mine) if len(mine) < 3 else f"{mine[0]} to {mine[-1]}"
        yield Fold(capital(entry.title), (Steps(steps(listed, design.target, format_name)),), is_open=True)


def _use_sections(design: Design, panels: Panels | None) -> tuple[Section, ...]:
    """What to do with the print."""
    if design.job.target.is_graded:
        return trial_sections(design)
    return (
        Section("Photos and the camera", photo_blocks(design), "Type the commands in this folder."),
        Section("What was printed: measure it", measure_blocks(design), _MEASURE_LEAD),
        Section("Codes", (*code_blocks(design), *_net(design, panels))),
    )


def headline(printing: PrintSpec, check: PrintCheck, costs: Costs | None = None) -> Headline:
    """Whether a target can be made, whether it should be, and why."""
    if check.violations:
        return Headline("bad", "not printable", check.violations[0].text)
    warnings = [finding for finding in check.findings if finding.level == "warning"]
    warned = sum(len(finding.rules) for finding in warnings)
    count = len(check.holding) + warned
    how = maker_of(printing).machine_words(printing)
    which = ", ".join(RULES[rule].title.lower() for finding in warnings for rule in finding.rules)
    rules = f"All {count} design rules hold on {how}."
    if warnings:
        rules = f"{warned} of {count} design rules warn on {how}: {which}."
    if costs is not None and (against := verdict(costs)):
        return Headline("usable", "printable, but not sensible", f"{against} {rules}")
    cost = f" {cost_sentence(costs.own.estimate)}" if costs and costs.is_printed else ""
    if warnings:
        return Headline("usable", "printable with care", f"{rules}{cost}")
    return Headline("good", "printable", f"{rules}{cost}")


def _rule_lead(printing: PrintSpec, check: PrintCheck) -> str:
    """What the rules were held to."""
    held = f"Held to lines of {printing.pattern_line_mm:g} mm"
    if printing.is_two_filament:
        held += f" and layers of {printing.printer.layer_height_mm:g} mm"
    if any(finding.level == "warning" for finding in check.findings):
        return f"{held}. What warns can be made, but comes out less true to the drawing."
    return f"{held}."


def _lead(design: Design, panels: Panels | None) -> tuple[Block, ...]:
    """The target in 3D, and its dimensions."""
    what, target = design.job.target.words, design.target
    dots = int(target.is_dot.sum())
    view = View3d(
        "The target",
        printed_scene(design),
        f"{capital(with_article(what))} with {target.ring_count - dots} rings and {dots} dots in "
        f"{colour_words(design.job.printing.ink_colour)} on {colour_words(design.job.printing.body_colour)}.",
        caption=f"{capital(what)}, as designed. {sentence(printed_ink(design).lettering.remark)}",
        poster=None if panels is None else panels.target,
    )
    return (view, dimension_facts(design))


def _net(design: Design, panels: Panels | None) -> tuple[Block, ...]:
    """All faces unfolded, from the preview."""
    if panels is None or panels.net is None:
        return ()
    path = f"{design.job.name}.png"
    if design.target.is_plate:
        alt = "The back of the board with its rings and its own three dots."
        return (Figure("The back", panels.net, alt, "Face 1, as seen from behind.", (Link(path, path),)),)
    return (
        Figure(
            "All faces unfolded",
            panels.net,
            "The net of the target: all faces side by side with their numbers and codes.",
            "As seen from outside; numbers are those of the faces.",
            (Link(path, path),),
            is_wide=True,
        ),
    )


def dimension_facts(design: Design) -> Facts:
    """What a drawing would say."""
    spec, target = design.job.target, design.target
    rings = f"{target.ring_count} in all, of which {int(target.is_dot.sum())} are dots"
    if not target.is_planar:
        rings = f"{target.ring_count // target.face_count} on each of {target.face_count} faces, {rings}"
    centre_mm = spec.ring_diameter_mm * spec.ring_ratio
    return Facts((
        *spec.facts(),
        ("rings", rings),
        ("ring", f"diameter {spec.ring_diameter_mm:g} mm, white centre {centre_mm:.4g} mm"),
        ("pitch", f"{spec.pitch_mm:g} mm between neighbouring centres"),
        ("border", f"{spec.border_mm:g} mm" if spec.border_mm else "none"),
        *_print_rows(design),
        ("target id", target.geometry_id),
        ("layout id", target.layout_id),
    ))  # fmt: skip


def _print_rows(design: Design) -> list[tuple[str, str]]:
    """Sizes of what is made."""
    printing = design.job.printing
    if printing.way.is_in_parts:
        return [("plates", str(len(design.plates)))]
    if not printing.way.has_body:
        pages = design.pages
        width, height = pages[0].width_mm, pages[0].height_mm
        return [("sheet", f"{len(pages)} page{'s' * (len(pages) > 1)} of {width:.0f} x {height:.0f} mm")]
    size = " x ".join(f"{length:.1f}" for length in printed_size_mm(design.target, printing))
    rows = [("on the bed", f"{size} mm")]
    if printing.is_two_filament:
        offset = f", grown by {printing.ink_offset_mm:+g} mm a side" if printing.ink_offset_mm else ""
        rows.append(("ink", f"{printing.inlay_mm:g} mm deep{offset}"))
    if printing.shrink_compensation_percent:
        rows.append(("shrinkage", f"files are {printing.shrink_compensation_percent:+g} % against the design"))
    if printing.skew_compensation_rad != NO_SKEW:
        rows.append(("skew", f"files are sheared against {format_skew(printing.skew_compensation_rad)}"))
    if printing.way.has_stickers:
        rows.append(("sticker", f"{printing.sticker_thickness_mm:g} mm thick; the body is smaller by it on every face"))
    return rows


def code_blocks(design: Design) -> tuple[Leaf, ...]:
    """How faces are told apart, or how a board tells its orientation."""
    target = design.target
    return _face_codes(target) if target.has_codes else _origin_mark(target)


def _face_codes(target: TargetGeometry) -> tuple[Leaf, ...]:
    opposite = {a: b for pair in opposite_faces(target) for a, b in (pair, pair[::-1])}
    columns = (
        Column("face"),
        Column("marks", is_number=False, note="positions row by row from the code corner; ● dot, ○ ring"),
        Column("dots at (i, j)", is_number=False, note="index in the face's lattice, as in the target file"),
        Column("beside it", is_number=False, note="the faces across its edges, counter-clockwise from the code corner"),
        Column("opposite"),
    )
    beside = adjacent_faces(target).tolist()
    rows = tuple(
        (
            Cell(str(face), float(face)),
            Cell(_code_marks(int(code))),
            Cell(", ".join(str(index) for index in sorted(CODES[int(code)]))),
            Cell(", ".join(map(str, beside[face]))),
            Cell(str(opposite[face]), opposite[face]) if face in opposite else Cell(""),
        )
        for face, code in enumerate(target.face_code.tolist())
    )
    positions = len(code_positions(int(target.face_code[0])))
    note = (
        f"Three of the {positions} positions in the corner of a face carry dots, in {target.face_count} different ways:"
        " so one face tells which it is and how it is turned. i counts from the code corner down the left side, j down "
        "the right side, the face seen from outside with its code corner up."
    )
    return (Table("Codes of the faces", columns, rows, note=note, visible_rows=20),)


def _code_marks(code: int) -> str:
    """`● ○○ ●○●`: the corner block, row by row from the code corner."""
    dots, place = CODES[code], code_positions(code)
    rows = sorted({i + j for i, j in place})
    return " ".join("".join(DOT if at in dots else RING for at in place if sum(at) == row) for row in rows)


def _origin_mark(target: TargetGeometry) -> tuple[Leaf, ...]:
    (dots,) = target.is_dot.nonzero()
    if not len(dots):
        text = "No dots: origin and orientation cannot be told from a photo, only up to the symmetry of the lattice."
        return (Paragraph(text),)
    several = not target.is_planar
    columns = (
        *((Column("face", note="0 is the front, 1 the back"),) if several else ()),
        Column("ring", note="row in the target file"),
        Column("index (i, j)", is_number=False),
        Column("x mm", note="from the middle of the board, to the right as one looks at the face"),
        Column("y mm", note="upwards"),
    )
    place = target.center_in_face_mm
    rows = tuple(
        (
            *((Cell(str(target.ring_face[dot]), float(target.ring_face[dot])),) if several else ()),
            Cell(str(dot), float(dot)),
            Cell(f"({target.ring_index[dot, 0]}, {target.ring_index[dot, 1]})"),
            Cell(f"{place[dot, 0]:.3f}", float(place[dot, 0])),
            Cell(f"{place[dot, 1]:.3f}", float(place[dot, 1])),
        )
        for dot in dots.tolist()
    )
    note = (
        "Three dots instead of rings mark origin and orientation; no turn and no mirror image maps them onto "
        "themselves. Keep them in every photo: a board whose dots are all hidden cannot be named."
    )
    if several:
        note = (
            "Three dots on each face mark origin, orientation and face; no two of the back's are as far apart as two "
            "of the front's, so that two dots tell the face. Keep them in every photo: a board whose dots are all "
            "hidden cannot be named."
        )
    return (Table("The marks of both faces" if several else "The origin mark", columns, rows, note=note),)
