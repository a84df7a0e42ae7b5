"""The design folder's page, `index.html`: what was designed, how to make it, what to measure on it, what comes next.

It follows from the spec and the files alone, so `design make` on the folder's TOML file writes the same bytes.
"""

from collections.abc import Callable, Sequence
from importlib import import_module
from typing import cast

import numpy as np

from designer.app.costs import Costs, better_build, cost_fold, cost_words, costs_of, verdict
from designer.app.measuring import measure_blocks, photo_blocks
from designer.app.stands import stand_section, trial_sections
from designer.base.answer import program
from designer.base.codes import CODES, code_positions
from designer.base.units import NO_SKEW, format_skew
from designer.base.words import capital, with_article
from designer.builds.design import Design, maker_of
from designer.builds.pictures import Panels, preview_panels, printed_ink, printed_scene
from designer.builds.slicing import colour_words
from designer.formats.folder import OutputFile
from designer.kinds.layout import opposite_faces
from designer.make.bed import printed_size_mm
from designer.make.pattern import HAIR_MM
from designer.make.printability import PrintCheck, sentence
from designer.page.blocks import (
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
    plates = tuple(f"{job.name}.{plate.name}." for plate in design.plates if plate.name)  # whose pictures say it
    listed = FileList(tuple(
        FileRow(file.name, "" if file.name.startswith(plates) else file.purpose, len(file.content)) for file in files
    ))  # fmt: skip
    graded = job.target.is_graded
    return Page(
        title=job.name,
        kind="Target",
        headline=headline(job.printing, check, costs),
        lead=(
            _view(design, panels), *better_build(costs, job.name), *findings_of(check),
            dimension_facts(design),
        ),
        sections=(
            maker_of(job.printing).making(design, files),
            *((stand_section(design),) if job.printing.stand else ()),
            *(() if others is None else (others,)),
            *(trial_sections(design) if graded else _use_sections(design)),
            Section("Details", (
                *((cost_fold(costs, job.printing),) if costs.is_printed else ()),
                Fold(RULES_TITLE, rule_blocks(check, job.printing)),
                *((Fold("Codes", codes),) if (codes := (*_net(design, panels), *code_blocks(design))) else ()),
                Fold("Files", (listed,)),
            )),
        ),
        made_by=f"design make {job.name}.toml",
        program=program(),
    )  # fmt: skip


def findings_of(check: PrintCheck) -> tuple[Leaf, ...]:
    """What rules say against a print."""
    told = tuple(row for row in check.told().rows if row.level in ("bad", "usable"))
    return (Findings(told),) if told else ()


def rule_blocks(check: PrintCheck, printing: PrintSpec) -> tuple[Leaf, ...]:
    """The rules that hold, and what they were held to."""
    rows = check.told().rows
    is_told = printing.way.is_two_filament  # by the settings
    notes = tuple(row for row in rows if row.level == "note" and not is_told)
    holding = [(row.title, row.measured, row.rule or row.text) for row in rows if row.level == "good"]
    table = text_table("", ("rule", "here", "limit"), holding)
    return (*((Findings(notes),) if notes else ()), *((table,) if holding else ()))


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


def _use_sections(design: Design) -> tuple[Section, ...]:
    """What to do with the print."""
    return (
        Section(
            "Photos and the camera", photo_blocks(design), "Photos go into the folder photos; commands are typed here."
        ),
        Section("Measure the print", measure_blocks(design)),
    )


def headline(printing: PrintSpec, check: PrintCheck, costs: Costs | None = None) -> Headline:
    """Whether a target can be made, whether it should be, and why."""
    if check.violations:
        return Headline("bad", "not printable", check.violations[0].text)
    warnings = [finding for finding in check.findings if finding.level == "warning"]
    warned = sum(len(finding.rules) for finding in warnings)
    count = len(check.holding) + warned
    how = maker_of(printing).machine_words(printing)
    which = ", ".join(check.title_of(rule).lower() for finding in warnings for rule in finding.rules)
    rules = f"All {count} design rules hold on {how}."
    if warnings:
        rules = f"{warned} of {count} design rules warn on {how}: {which}."
    if costs is not None and (against := verdict(costs)):
        return Headline("usable", "printable, but not sensible", f"{against} {rules}")
    cost = f"About {cost_words(costs.own.estimate)}. " if costs and costs.is_printed else ""
    if warnings:
        return Headline("usable", "printable with care", f"{cost}{rules}")
    return Headline("good", "printable", f"{cost}{rules}")


def _view(design: Design, panels: Panels | None) -> View3d:
    """The target in 3D."""
    what, target = design.job.target.words, design.target
    dots = int(target.is_dot.sum())
    shown = f"{target.ring_count - dots} rings and {dots} dots"
    if target.marks is not None:
        shown = f"{target.ring_count} {target.feature_word}"
    return View3d(
        "As designed",
        printed_scene(design),
        f"{capital(with_article(what))} with {shown} in "
        f"{colour_words(design.job.printing.ink_colour)} on {colour_words(design.job.printing.body_colour)}.",
        caption=sentence(printed_ink(design).lettering.remark),
        poster=None if panels is None else panels.target,
    )


def _net(design: Design, panels: Panels | None) -> tuple[Leaf, ...]:
    """All faces unfolded, from the preview."""
    if panels is None or panels.net is None:
        return ()
    links = (Link(f"{design.job.name}.png", f"{design.job.name}.png"),)
    if design.target.is_plate:
        alt = f"The back of the board with its own three dots among {design.target.ring_count // 2} rings."
        if design.target.marks is not None:
            alt = f"The back of the board: {design.target.marks[1].words}."
        return (Figure("The back", panels.net, alt, "Face 1, as seen from behind.", links),)
    alt = f"The net of the target: all {design.target.face_count} faces side by side with their numbers and codes."
    sight = "as cameras see them" if design.target.faces_up else "from outside"
    return (Figure(f"All faces unfolded, {sight}", panels.net, alt, "", links, is_wide=True),)


def dimension_facts(design: Design) -> Facts:
    """What a drawing would say."""
    spec, target = design.job.target, design.target
    if target.marks is not None:
        hair = f"black squares and cells that touch are {1000 * HAIR_MM:g} µm apart, to be solids; no corner moves"
        edges = (("edges", hair),) if target.marks[0].polygons_mm else ()
        rows = (*spec.facts(), (target.feature_word, str(target.ring_count)), *edges, *_print_rows(design))
        return Facts((*rows, ("target id", target.geometry_id)))
    rings = f"{target.ring_count} with {int(target.is_dot.sum())} dots"
    counts = np.bincount(target.ring_face, minlength=target.face_count)
    if not target.is_planar and counts.min() == counts.max():
        rings = f"{rings}, {counts[0]} a face"
    centre_mm = spec.ring_diameter_mm * spec.ring_ratio
    return Facts((
        *spec.facts(),
        ("rings", rings),
        ("ring", f"{spec.ring_diameter_mm:g} mm, white centre {centre_mm:.4g} mm, pitch {spec.pitch_mm:g} mm"),
        *((("border", f"{spec.border_mm:g} mm"),) if spec.border_mm else ()),
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
    rows = [] if design.target.is_plate and design.scale == 1 else [("on the bed", f"{size} mm")]
    if printing.way.is_two_filament:
        offset = f", grown by {printing.ink_offset_mm:+g} mm a side" if printing.ink_offset_mm else ""
        level = {"flush": "deep", "raised": "high", "recessed": "deep, grooves"}[printing.way.ink]
        rows.append(("ink", f"{printing.inlay_mm:g} mm {level}{offset}"))
    if printing.shrink_compensation_percent:
        rows.append(("shrinkage", f"files are {printing.shrink_compensation_percent:+g} % against the design"))
    if printing.skew_compensation_rad != NO_SKEW:
        rows.append(("skew", f"files are sheared against {format_skew(printing.skew_compensation_rad)}"))
    if printing.way.has_stickers:
        lip = ", and has a lip around it" * printing.lip
        rows.append(("sticker", f"{printing.sticker_thickness_mm:g} mm thick; the body is lower by it{lip}"))
    return rows


def code_blocks(design: Design) -> tuple[Leaf, ...]:
    """How faces are told apart."""
    target, shown = design.target, Shown[int]
    if not target.has_codes:
        return ()
    opposite = {a: b for pair in opposite_faces(target) for a, b in (pair, pair[::-1])}
    codes = target.face_code.tolist()
    note = f"{len(code_positions(codes[0]))} positions, row by row from a face's code corner: the face and its turn."
    table = table_of(
        range(target.face_count),
        shown("face", lambda face: face),
        shown("marks", lambda face: _code_marks(codes[face])),
        shown("opposite", lambda face: opposite.get(face, "")),
        title="Codes of the faces", note=note, visible_rows=20,
    )  # fmt: skip
    return (table,)


def _code_marks(code: int) -> str:
    """`●/○○/●○●`: the corner block, row by row from the code corner."""
    dots, place = CODES[code], code_positions(code)
    rows = sorted({i + j for i, j in place})
    return "/".join("".join(DOT if at in dots else RING for at in place if sum(at) == row) for row in rows)
