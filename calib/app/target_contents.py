"""What a target file holds, and how one is written that `design` did not make."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from designer.base.errors import InputError
from designer.base.marks import NOT_IN_FILE, Key
from designer.base.own_files import require_ours
from designer.base.words import printable
from designer.page.output import Output, asked_output
from designer.page.result import Result

if TYPE_CHECKING:
    from calib.app.inputs import Place
    from designer.marks.face_marks import FaceMarks
    from designer.page.blocks import Page
    from designer.target import TargetGeometry

SUFFIX = ".target.json"
MOST_TOLD = 6
ORIGINS = {
    "center": "in the middle of the marks; x right, y up, z towards who looks",
    "opencv": "as OpenCV's object points: upper left; x right, y down, z away from who looks",
    "kalibr": "as Kalibr's: lower left; x right, y up, z towards who looks",
}


@dataclass(frozen=True, eq=False)
class TargetContents(Result, kind="target", title="Target", doing="reading the target", is_written=False):
    """What a target holds: `target("board.target.json").rings`."""

    geometry: Annotated["TargetGeometry", NOT_IN_FILE]
    file: Annotated[str, NOT_IN_FILE]
    next_line: Annotated[tuple[str, str], NOT_IN_FILE]  # what to do with it, and a word on that; "": nothing is said
    target_id: str
    layout_id: str
    kind_of_target: Annotated[str | None, Key("kind")]  # None: made elsewhere
    source: str
    faces: int
    rings: int
    dots: int  # and points without marks
    marks: tuple[str, ...]  # of other makers' boards, a face each
    corners: int  # and circles of theirs
    farthest_corner_mm: float
    remarks: tuple[str, ...] = ()  # on the table of points, or on what marks leave open

    def page(self) -> "Page":
        """Marks, sizes and ids."""
        from designer.page.blocks import Command, Facts, Finding, Findings, Headline, Page, Section

        geometry = self.geometry
        if geometry.marks is not None:
            marks = f"other detectors' marks{'' if geometry.is_planar else f' on {self.faces} faces'}"
        elif not geometry.has_marks:
            marks = f"points without marks on {self.faces} plane{'s' if not geometry.is_planar else ''}"
        elif not geometry.is_planar:
            marks = f"{self.faces} faces {'with' if (geometry.face_code >= 0).all() else 'without'} codes"
        else:
            marks = "one face with an origin mark" if self.dots else "one face without marks, its orientation ambiguous"
        counts = f"rings {self.rings}, {'dots' if geometry.has_marks else 'points'} {self.dots}"
        facts = (
            *((("marks", counts),) if geometry.marks is None else _facts_of(geometry.marks, self.corners)),
            *_origin_of(geometry),
            ("size", f"farthest corner {self.farthest_corner_mm:.3f} mm from the origin"),
            ("ids", f"layout id {self.layout_id}, geometry id {self.target_id}"),
        )
        told = f"{self.kind_of_target or 'made elsewhere'}, {self.source} geometry, {marks}"
        steps = (Command(*self.next_line),) if self.next_line[0] else ()
        said = Findings(tuple(Finding("note", "", printable(line)) for line in self.remarks))
        parts = (Section("", (said,)),) if self.remarks else ()
        return Page("", "", Headline("note", printable(self.file), told), parts, lead=(Facts(facts),), next_steps=steps)

    def save(self, place: "Place", *, command: str = "", has_page: bool = False) -> tuple[Path, ...]:
        """Write the target file; InputError: it cannot be written, ends otherwise, or is somebody else's."""
        from designer.target import target_to_json

        output = asked_place(place, "a target")
        output.write({output.place: target_to_json(self.geometry).encode()})
        return tuple(output.files)


def _facts_of(marks: "tuple[FaceMarks, ...]", corners: int) -> tuple[tuple[str, str], ...]:
    """Of each face its marks, and how they are numbered."""
    few = marks[:MOST_TOLD]
    rest = (("", f"and {len(marks) - len(few)} faces more"),) if len(marks) > len(few) else ()
    what = "circles" if all(one.radius_mm for one in marks) else "corners"
    return (
        *((f"face {number}" if len(marks) > 1 else "marks", one.words) for number, one in enumerate(few)),
        *rest,
        ("numbered", f"{corners} {what}: {'; '.join(dict.fromkeys(one.order for one in few))}"),
    )


def _origin_of(geometry: "TargetGeometry") -> tuple[tuple[str, str], ...]:
    """In whose frame the coordinates of other makers' marks are; nothing if it is none of those that are known."""
    import numpy as np

    from designer.marks.face_marks import ORIGINS as NAMES

    if geometry.marks is None:
        return ()
    frame = geometry.target_from_face[0]
    name = next((one for one in NAMES if np.allclose(frame, geometry.marks[0].target_from_face(one))), None)
    return () if name is None else (("origin", ORIGINS[name]),)


def contents_of(
    geometry: "TargetGeometry", name: str, next_line: tuple[str, str] = ("", ""), remarks: tuple[str, ...] = ()
) -> TargetContents:
    """What a target holds.

    Args:
        geometry: of the target.
        name: of its file.
        next_line: what to do with it, and a word on that.
        remarks: on how it was made.
    """
    from designer.target import bounding_radius_mm

    marks = geometry.marks or ()
    dots = 0 if marks else int(geometry.is_dot.sum())
    corners = geometry.ring_count if marks else 0
    return TargetContents(
        geometry=geometry, file=name, next_line=next_line, target_id=geometry.geometry_id,
        layout_id=geometry.layout_id, kind_of_target=None if geometry.spec is None else geometry.spec.kind,
        source=geometry.source, faces=geometry.face_count, rings=geometry.ring_count - dots - corners, dots=dots,
        marks=tuple(one.words for one in marks), corners=corners, farthest_corner_mm=bounding_radius_mm(geometry),
        remarks=(*remarks, *dict.fromkeys(_doubt(one) for one in marks if one.is_ambiguous)),
    )  # fmt: skip


def _doubt(marks: "FaceMarks") -> str:
    """What it costs that marks look the same when they are turned."""
    turn = {2: "half a turn", 4: "a quarter of a turn"}[marks.alike]
    what = "grid of circles" if marks.kind == "circles" else marks.kind
    return (
        f"the {what} looks the same turned by {turn}, so that one photo does not tell which way up it is: one "
        "camera alone loses nothing by that, rigs and robots work it out from their motions or say that they cannot; "
        f"measure and markers refuse it. What tells: {marks.remedy}, or a ChArUco board"
    )


def made_target(
    output: "Output", geometry: "TargetGeometry", next_line: tuple[str, str] = ("", ""), remarks: tuple[str, ...] = ()
) -> TargetContents:
    """Write a target file that `design` did not make; `next_line` is `calib run` unless it is told."""
    from designer.page.terminal import quoted

    run = f"calib run {quoted(output.place)} photos", "photos of it, from many sides and near the image's corners"
    contents = contents_of(geometry, str(output.place), next_line if next_line[0] else run, remarks)
    output.files += contents.save(output.place)
    return contents


def asked_place(out: "Output | Place | None", made_of: str) -> "Output":
    """Where a target that `design` did not make is to be written, before any work is done.

    Raises:
        InputError: nobody said, another ending, or a place that holds something else.
    """
    from designer.target import FORMAT, load_target

    output = asked_output(out)
    if output is None:
        raise InputError(f"{made_of}: makes a file: give -o NAME{SUFFIX}")
    place = output.place
    if not place.name.endswith(SUFFIX) or place.name == SUFFIX:
        name = f"{place.stem.split('.')[0] or 'my'}{SUFFIX}"
        raise InputError(f"-o {place}: target files end in {SUFFIX}; call it {name}")
    require_ours(place, kind=FORMAT)
    if place.exists() and place.stat().st_size:
        there = load_target(place)
        if there.spec or there.source != "nominal":
            raise InputError(f"-o {place}: exists and holds a target that was made otherwise; choose another name")
    return output
