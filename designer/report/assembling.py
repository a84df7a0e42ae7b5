"""The page's section on a solid in parts: its plates, its pieces, and the steps from printer to measured target."""

from collections.abc import Sequence

from designer.formats.folder import OutputFile
from designer.make.assembly import Assembly
from designer.page.blocks import Section, Steps
from designer.produce import Design


def assembling_section(design: Design, assembly: Assembly, files: Sequence[OutputFile]) -> Section:
    """How to print and assemble it."""
    return Section("Making it", (Steps(("Print all plates.",)),), "Flat tiles, glued to a core.")
