"""What is told of a camera or a rig that was written for another tool."""

import shlex
from pathlib import Path
from typing import TYPE_CHECKING, cast

from calib.app.cameras_told import camera_words, refit_words
from calib.cameras.formats import ACCEPTED_PX
from designer.base.words import printable
from designer.page.blocks import Command, Facts, Finding, Findings, Headline, Page, Section
from designer.page.terminal import quoted

if TYPE_CHECKING:
    from calib.app.convert import Conversion
    from calib.cameras.formats.rig_format import RigFormat


def conversion_page(made: "Conversion") -> Page:
    """What was read and written, what it cost, and how the files are opened."""
    from calib.cameras.formats.holding import LARGE_PX

    out, target, held, is_rig = made.place or Path(made.format.file_name), made.format, made.held[0], bool(made.unit)
    url = "" if is_rig else out.absolute().as_uri()
    read = f"{len(made.held)} cameras" if is_rig else camera_words(made.each[0][1])
    written = f"lengths in {made.unit}" if is_rig else camera_words(held.camera, held.called)
    others = ", ".join(f"{lens.name} {fit.rms_px:.4f}" for lens, fit in held.tried)
    facts = Facts((
        ("read", f"{printable(made.named)}: {made.opened.format.title}, {read}"),
        *((printable(name) or "fit", refit_words(what, fit)) for name, what, fit in made.named_fits),
        ("written", f"{printable(str(out))}: {target.title}, {written}"),
        *((printable(name), camera_words(one.camera, one.called)) for name, _, _, one in made.each if name),
        *((("chosen", f"{held.lens.name}, the closest of (RMS in px) {others}; another with --lens"),)
          if len(held.tried) > 1 and not is_rig else ()),
        ("open", target.opens_with.format(file=printable(str(out)), url=url)),
    ))  # fmt: skip
    headline = Headline("good", "exact", "no fit was needed")
    if made.named_fits:
        fitted = f"lenses were fitted, which leaves {made.rms_px:.4f} px RMS and {made.max_px:.4f} px at most"
        headline = Headline("usable" if made.is_far else "note", "fitted", fitted)
    if getattr(target, "files", None) is not None:
        headline = Headline("good", "written", f"off by {made.max_px:.2g} px at most, {made.rms_px:.2g} px RMS")
    findings = [Finding("note", "", printable(line)) for line in made.remarks]
    findings += [Finding("note", "Lost", printable(line)) for line in made.lost]
    is_readable = all(read is None or read.max_px <= ACCEPTED_PX for _, _, read, _ in made.each)  # by other commands
    if made.is_far:
        where = "a camera differs" if is_rig else "the two cameras differ"
        hint = "; see where with calib diff, and --lens for another" if is_readable else ""
        findings.append(Finding("usable", "Far", f"{where} by more than {LARGE_PX:g} px somewhere{hint}"))
    names = tuple(name for name, *_ in made.each)
    can_be_compared = is_readable and (not is_rig or cast("RigFormat", target).words(names) == names)
    again = f"calib diff {shlex.quote(printable(made.named))} {quoted(out)}"
    steps = (Command(again),) if made.is_far and can_be_compared else ()
    sections = (Section("Conversion", (Findings(tuple(findings)),)),) if findings else ()
    return Page("", "", headline, sections, lead=(facts,), next_steps=steps)
