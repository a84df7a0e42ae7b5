"""The design folder's page, `index.html`: what was designed, how to make it, what to measure on it, what comes next.

It follows from the spec and the files alone, so `design make` on the folder's TOML file writes the same bytes.
"""

from collections.abc import Callable, Sequence
from importlib import import_module
from typing import cast

from designer.app.costs import Costs, cost_section, cost_sentence, costs_of, verdict
from designer.app.measuring import measure_blocks, photo_blocks
from designer.app.stands import stand_section, trial_sections
from designer.base.answer import program
from designer.base.codes import CODES, code_positions
from designer.base.units import NO_SKEW, format_skew
from designer.base.words import capital, with_article
from designer.builds.design import Design, maker_of
from designer.builds.pictures import Panels, preview_panels, printed_ink, printed_scene
from designer.builds.slicing import colour_words, layers_of
from designer.formats.folder import OutputFile
from designer.kinds.layout import adjacent_faces, opposite_faces
from designer.make.bed import printed_size_mm
from designer.make.printability import RULES, PrintCheck, sentence
from designer.page.blocks import (
    Block,
    Facts,
    Figure,
    FileList,
    FileRow,
    Findings,
    Fold,
    Headline,
    Leaf,
    Link,
    Page,
    Paragraph,
    Section,
    Steps,
    View3d,
    text_table,
)
from designer.page.folders import Shown, table_of
from designer.page.page_file import PAGE_FILE
from designer.page.shell import page_html
from designer.spec.format import FORMATS
from designer.spec.spec import PrintSpec
from designer.target import TargetGeometry

RULES_TITLE = "Printability"
_MEASURE_LEAD = "A length and the photos say how far the print is from the drawing; the calibration uses the print."
DOT, RING = "●", "○"

Guide = Callable[[str, TargetGeometry, str], tuple[str, ...]]
"""What to do with the files of a format for lasers, cutters or board houses."""


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
    listed = FileList(tuple(FileRow(file.name, file.purpose, len(file.content)) for file in files))
    return Page(
        title=job.name,
        kind="Target",
        headline=headline(job.printing, check, costs),
        lead=_lead(design, panels),
        sections=(
            *((cost_section(costs, job.printing, layers_of(design)),) if costs.is_printed else ()),
            Section(RULES_TITLE, rule_blocks(check), _rule_lead(job.printing, check)),
            maker_of(job.printing).making(design, files),
            *((stand_section(design),) if job.printing.stand else ()),
            *(() if others is None else (others,)),
            *_use_sections(design, panels),
            Section("Files", (Fold(f"{len(files)} files", (listed,)),),
                    f"{job.name}.target.json is what calib reads."),
        ),
        made_by=f"design make {job.name}.toml",
        program=program(),
    )  # fmt: skip


def rule_blocks(check: PrintCheck) -> tuple[Block, ...]:
    """What rules say against a print; those that hold are a line that opens."""
    rows = check.told().rows
    holding = [row for row in rows if row.level == "good"]
    told = tuple(row for row in rows if row.level != "good")
    table = text_table(
        "", ("rule", "here", "limit"), [(row.title, row.measured, row.rule or row.text) for row in holding]
    )
    count = f"{len(holding)} rule{'s hold' if len(holding) > 1 else ' holds'}"
    names = ", ".join(row.title.lower() for row in holding)
    return (*((Findings(told),) if told else ()), *((Fold(f"{count}: {names}", (table,)),) if holding else ()))


def other_makers(design: Design, files: Sequence[OutputFile]) -> Section | None:
    """A fold for each format of lasers, cutters and board houses, with its files; None where there is none."""
    folds = []
    for format_name in design.job.formats:
        entry = FORMATS[format_name]
        if entry.guide:
            steps = cast(Guide, import_module(f"designer.formats.{entry.guide}").steps)
            mine = [file.name for file in files if file.name.endswith(entry.suffix)]
            listed = " and ".join(mine) if len(mine) < 3 else f"{mine[0]} to {mine[-1]}"
            told = Steps(steps(listed, design.target, format_name))
            folds.append(Fold(capital(entry.title), (told,), is_open=True))
    lead = "The same pattern, made in another way; each file is all that a maker needs."
    return Section("Lasers, cutters, board houses", tuple(folds), lead) if folds else None


def _use_sections(design: Design, panels: Panels | None) -> tuple[Section, ...]:
    """What to do with the print."""
    if design.job.target.is_graded:
        return trial_sections(design)
    target = design.target
    codes = "Three dots tell how the board is turned: the table of them" if target.is_dot.any() else "No dots"
    if target.has_codes:
        codes = f"Dots tell each of the {target.face_count} faces: the table of codes"
    return (
        Section("Photos and the camera", photo_blocks(design), "Type the commands in this folder."),
        Section("What was printed: measure it", measure_blocks(design), _MEASURE_LEAD),
        Section("Codes", (*_net(design, panels), Fold(codes, code_blocks(design)))),
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
    cost = f"{cost_sentence(costs.own.estimate)} " if costs and costs.is_printed else ""
    if warnings:
        return Headline("usable", "printable with care", f"{cost}{rules}")
    return Headline("good", "printable", f"{cost}{rules}")


def _rule_lead(printing: PrintSpec, check: PrintCheck) -> str:
    """What the rules were held to."""
    held = f"Held to lines of {printing.pattern_line_mm:g} mm"
    if printing.is_two_filament:
        held += f" and layers of {printing.printer.layer_height_mm:g} mm"
    if any(finding.level == "warning" for finding in check.findings):
        return f"{held}. What warns comes out less true to the drawing."
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
    links = (Link(f"{design.job.name}.png", f"{design.job.name}.png"),)
    if design.target.is_plate:
        alt = f"The back of the board with its own three dots among {design.target.ring_count // 2} rings."
        return (Figure("The back", panels.net, alt, "Face 1, as seen from behind.", links),)
    alt = f"The net of the target: all {design.target.face_count} faces side by side with their numbers and codes."
    return (Figure("All faces unfolded", panels.net, alt, "Seen from outside.", links, is_wide=True),)


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
        lip = ", and has a lip around it" * printing.lip
        rows.append(("sticker", f"{printing.sticker_thickness_mm:g} mm thick; the body is lower by it{lip}"))
    return rows


def code_blocks(design: Design) -> tuple[Leaf, ...]:
    """How faces are told apart, or how a board tells its orientation."""
    target = design.target
    return _face_codes(target) if target.has_codes else _origin_mark(target)


def _face_codes(target: TargetGeometry) -> tuple[Leaf, ...]:
    opposite = {a: b for pair in opposite_faces(target) for a, b in (pair, pair[::-1])}
    beside, codes, shown = adjacent_faces(target).tolist(), target.face_code.tolist(), Shown[int]
    note = (
        f"Which of the {len(code_positions(codes[0]))} positions in a face's corner carry dots tells the face and its "
        "turn. i counts from the code corner down the left side, j down the right one, seen from outside with that "
        "corner up."
    )
    table = table_of(
        range(target.face_count),
        shown("face", lambda face: face),
        shown("marks", lambda face: _code_marks(codes[face]),
              "positions row by row from the code corner; ● dot, ○ ring"),
        shown("dots at (i, j)", lambda face: ", ".join(map(str, sorted(CODES[codes[face]]))),
              "index in the face's lattice, as in the target file"),
        shown("beside it", lambda face: ", ".join(map(str, beside[face])),
              "the faces across its edges, counter-clockwise from the code corner"),
        shown("opposite", lambda face: opposite.get(face, "")),
        title="Codes of the faces", note=note, visible_rows=20,
    )  # fmt: skip
    return (table,)


def _code_marks(code: int) -> str:
    """`● ○○ ●○●`: the corner block, row by row from the code corner."""
    dots, place = CODES[code], code_positions(code)
    rows = sorted({i + j for i, j in place})
    return " ".join("".join(DOT if at in dots else RING for at in place if sum(at) == row) for row in rows)


def _origin_mark(target: TargetGeometry) -> tuple[Leaf, ...]:
    (dots,) = target.is_dot.nonzero()
    if not len(dots):
        text = "Origin and orientation cannot be told from a photo, only up to the symmetry of the lattice."
        return (Paragraph(text),)
    several, place, shown = not target.is_planar, target.center_in_face_mm, Shown[int]
    keep = "Keep them in every photo: a board whose dots are all hidden cannot be named."
    note = f"No turn and no mirror image maps the three dots onto themselves. {keep}"
    if several:
        note = f"No two dots of the back are as far apart as two of the front: two tell the face. {keep}"
    table = table_of(
        dots.tolist(),
        *((shown("face", lambda dot: int(target.ring_face[dot]), "0 is the front, 1 the back"),) if several else ()),
        shown("ring", lambda dot: dot, "row in the target file"),
        shown("index (i, j)", lambda dot: f"({target.ring_index[dot, 0]}, {target.ring_index[dot, 1]})"),
        shown("x mm", lambda dot: f"{place[dot, 0]:.3f}",
              "from the middle of the board, to the right as one looks at the face"),
        shown("y mm", lambda dot: f"{place[dot, 1]:.3f}", "upwards"),
        title="The marks of both faces" if several else "The origin mark", note=note,
    )  # fmt: skip
    return (table,)
