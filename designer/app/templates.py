"""List the templates that travel with the program: `design templates`."""

from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING

from designer.app.make import target_numbers
from designer.page.capability import capability
from designer.page.result import Result

if TYPE_CHECKING:
    from designer.base.answer import Value
    from designer.page.blocks import Page
    from designer.spec.spec import Job, PrinterProfile
    from designer.target import TargetGeometry


@dataclass(frozen=True, eq=False)
class Templates(Result, kind="templates", title="Templates", is_written=False):
    """What `design make`, `--printer` and `--errors` know."""

    targets: "tuple[tuple[str, Job, TargetGeometry], ...]"
    printers: "tuple[PrinterProfile, ...]"
    errors: tuple[tuple[str, str], ...]
    remarks: tuple[str, ...] = ()

    def page(self) -> "Page":
        """A table of each sort."""
        from designer.page.blocks import Headline, Page, Section, text_table

        rows = [
            (name, job.target.size_words, str(target.ring_count // target.face_count), str(target.ring_count),
             f"{job.target.ring_diameter_mm:g}mm", f"{job.target.pitch_mm:g}mm", job.printing.build)
            for name, job, target in self.targets
        ]  # fmt: skip
        machines = [
            (one.name, " x ".join(f"{length:g}" for length in one.bed_mm) + "mm",
             *(f"{width:g}mm" for width in (one.nozzle_mm, one.line_width_mm, one.layer_height_mm)))
            for one in self.printers
        ]  # fmt: skip
        heads = ("name", "size", "rings per face", "in all", "diameter", "pitch", "build")
        tables = (
            text_table("targets: design make NAME", heads, rows),
            text_table("printers: --printer NAME", ("name", "bed", "nozzle", "line", "layer"), machines),
            text_table("errors: design tolerance TARGET.json --errors NAME", ("name", "of"), self.errors),
        )
        count = f"{len(self.targets)} targets"
        others = f"{len(self.printers)} printers and {len(self.errors)} error models"
        headline = Headline("note", count, f"{count}, {others} travel with the program.")
        return Page("", "", headline, (Section("", tables),))

    def answer(self) -> "dict[str, Value]":
        """The same with all sizes."""
        from designer.spec.kind import spec_to_mapping

        return {
            "targets": [
                {"name": name, "build": job.printing.build, "spec": spec_to_mapping(job.target),
                 **target_numbers(target)} for name, job, target in self.targets
            ],
            "printers": [asdict(printer) for printer in self.printers],
            "errors": [{"name": name, "title": title} for name, title in self.errors],
        }  # fmt: skip


@capability
def templates() -> Templates:
    """List the templates for targets, printers and manufacturing errors."""
    from designer.base.files import read_spec_file
    from designer.kinds.layout import lay_out
    from designer.kinds.presets import preset_names, preset_or_file
    from designer.kinds.sizing import printer_of, size_job
    from designer.kinds.spec_file import parse_spec
    from designer.spec.options import AskedPrinting
    from designer.tolerance.error_file import error_model

    targets = []
    for name in preset_names("targets"):
        job = size_job(parse_spec(read_spec_file(preset_or_file("targets", name)), name)).job
        targets.append((name, job, lay_out(job.target)))
    printers = tuple(printer_of(AskedPrinting(printer=name)) for name in preset_names("printers"))
    errors = tuple((name, error_model(name).title) for name in preset_names("errors"))
    return Templates(tuple(targets), printers, errors)
