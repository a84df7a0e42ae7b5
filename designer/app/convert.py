"""A target's points as files of other tools: `design convert ico.target.json --to csv`."""

from dataclasses import dataclass
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from designer.base.marks import NOT_IN_FILE
from designer.base.options import argument, option
from designer.formats.point_lists import POINT_FORMATS, PointFormat
from designer.kinds.presets import one_of
from designer.page.capability import capability, written_to
from designer.page.result import Result

if TYPE_CHECKING:
    from designer.page.blocks import Page
    from designer.page.output import Output


@dataclass(frozen=True, eq=False)
class TargetPoints(Result, kind="points", title="Points of a target", doing="converting", is_written=False):
    """The points of a target as a file of another tool: `convert("ico.target.json", "csv").text`."""

    file: Annotated[str, NOT_IN_FILE]
    form: Annotated[PointFormat, NOT_IN_FILE]
    text: Annotated[str, NOT_IN_FILE]  # of the file
    to: str  # which format
    target_id: str
    points: int
    place: str  # of the file that was written; "": none
    remarks: tuple[str, ...] = ()

    def page(self) -> "Page":
        """What it holds, and what to do with it."""
        from designer.page.blocks import Facts, Headline, Page

        facts = Facts((("format", self.form.title), ("use", self.form.use), ("target id", self.target_id)))
        return Page("", "", Headline("note", f"{self.points} points", f"of {self.file}"), (), lead=(facts,))

    def save(self, place: str | PathLike[str], *, command: str = "", has_page: bool = False) -> tuple[Path, ...]:
        """Write the file.

        Raises:
            InputError: it cannot be written, or is somebody else's.
        """
        from designer.page.output import output_of

        output = output_of(place)
        output.write({output.place: self.text.encode()})
        return (output.place,)


@capability
def convert(
    target: Annotated[Path, argument("a target file (NAME.target.json)")],
    *,
    to: Annotated[str, option(f"whose file: {', '.join(POINT_FORMATS)}; metashape is RealityCapture's too",
                              complete=one_of(tuple(POINT_FORMATS)))],
    out: Annotated["Output | Path | None", written_to("the file (default: NAME beside the target)")] = None,
) -> TargetPoints:  # fmt: skip
    """Write a target's points for another tool: `convert("ico.target.json", to="csv")`.

    Raises:
        InputError: a target or a format that is none, or a target that the format cannot hold.
    """
    from designer.base.errors import InputError
    from designer.base.words import shown, suggestion_or_all
    from designer.page.output import output_of
    from designer.target import load_target

    if to not in POINT_FORMATS:
        hint = suggestion_or_all(to, POINT_FORMATS)
        raise InputError(f"--to {shown(to)}: no such format{hint}")
    form, geometry = POINT_FORMATS[to], load_target(target)
    output = None if out is None else output_of(out)
    text, place = form.write(geometry), ""
    if output is not None:
        name = target.name.removesuffix(".json").removesuffix(".target")
        output.place = output.place if output.is_asked else target.with_name(name + form.file_name)
        output.page = None
        output.write({output.place: text.encode()})
        place = str(output.place)
    return TargetPoints(str(target), form, text, to, geometry.geometry_id, geometry.ring_count, place)
