"""Targets with other makers' marks: `calib target --marks`, and several of them as one, `calib target --join`."""

from collections.abc import Mapping
from dataclasses import MISSING, dataclass, fields
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from calib.app.target_contents import TargetContents, asked_place, made_target
from designer.base.errors import InputError
from designer.base.options import CommandOption, option, parameters_of
from designer.marks import MARKS
from designer.page.capability import capability, written_to

if TYPE_CHECKING:
    from calib.app.inputs import Place
    from designer.marks.face_marks import FaceMarks
    from designer.page.output import Output

GROUP = "Other makers' boards"
Counts = tuple[int, int]
SAID_OTHERWISE = {"corners": "squares", "gap_mm": "spacing"}
"""Options that say what a field of marks says, in other words."""
EXAMPLES: Mapping[str, str] = {
    "squares": "--squares 9x6", "square_mm": "--square 25mm", "marker_mm": "--marker 15mm",
    "dictionary": "--dictionary DICT_5X5_100", "tags": "--tags 6x6", "tag_mm": "--tag 88mm",
    "circles": "--circles 4x11", "pitch_mm": "--pitch 40mm", "diameter_mm": "--diameter 20mm",
}  # fmt: skip


def read_counts(text: str) -> Counts:
    """Columns and rows, `11x8`; ValueError: no such text."""
    parts = [part.strip() for part in text.lower().replace("×", "x").split("x")]
    if len(parts) != 2 or not all(part.isdecimal() and len(part) < 10 for part in parts):
        raise ValueError("must be columns x rows, such as 11x8")
    return int(parts[0]), int(parts[1])


def _dictionaries() -> list[str]:
    from designer.marks.dictionaries import MARKERS

    return list(MARKERS)


def _counts(help_text: str) -> CommandOption:
    return option(help_text, parse=read_counts, metavar="COLUMNSxROWS", group=GROUP)


def _length(help_text: str) -> CommandOption:
    return option(help_text, 0.001, 1e5, group=GROUP)


def _switch(help_text: str, off: str = "") -> CommandOption:
    return option(help_text, off=off, group=GROUP)


@dataclass(frozen=True)
class BoardOptions:
    """What a board is like; each kind of marks has some of it."""

    squares: Annotated[Counts | None, _counts("squares of a chessboard or ChArUco board")] = None
    corners: Annotated[Counts | None, _counts("its inner corners instead, one less each way: 8x5")] = None
    square_mm: Annotated[float | None, _length("side of a square")] = None
    light_first: Annotated[bool, _switch("the chessboard's upper left square is light")] = False
    marker_mm: Annotated[float | None, _length("side of a ChArUco board's marker, its black border included")] = None
    dictionary: Annotated[
        str | None,
        option(
            "of the markers, by OpenCV's name (default of AprilGrids: apriltag_36h11)",
            metavar="NAME",
            complete=_dictionaries,
            group=GROUP,
        ),
    ] = None
    first_id: Annotated[int | None, option("id of the first marker (default: 0)", 0, 10_000, group=GROUP)] = None
    legacy: Annotated[bool, _switch("a ChArUco board as OpenCV drew them before version 4.6")] = False
    tags: Annotated[Counts | None, _counts("tags of an AprilGrid")] = None
    tag_mm: Annotated[float | None, _length("side of a tag, its black border included")] = None
    gap_mm: Annotated[float | None, _length("between two tags (default: .3 sides)")] = None
    spacing: Annotated[float | None, option("the gap in sides of a tag, as Kalibr has it", 0.01, 2, group=GROUP)] = None
    border_bits: Annotated[
        int | None, option("cells of a tag's black border (default: 2, as Kalibr prints; others 1)", 1, 3, group=GROUP)
    ] = None
    corner_squares: Annotated[
        bool, _switch("small black squares between the tags' corners, or none", "--no-corner-squares")
    ] = True
    from_top: Annotated[bool, _switch("the first tag is the upper left one, not the lower left")] = False
    upright: Annotated[bool, _switch("AprilTags stand as OpenCV draws them, half a turn from Kalibr's")] = False
    circles: Annotated[Counts | None, _counts("circles in a row, and rows")] = None
    pitch_mm: Annotated[float | None, _length("from circle to circle in a row")] = None
    diameter_mm: Annotated[float | None, _length("of the circles")] = None
    asymmetric: Annotated[bool, _switch("each second row of circles is shifted by half a step")] = False
    light: Annotated[bool, _switch("light circles on a dark ground")] = False

    def given(self) -> dict[str, object]:
        """What is said, by the names of fields."""
        return {one.name: value for one in fields(self) if (value := getattr(self, one.name)) != one.default}

    def face(self, kind: str) -> "FaceMarks":
        """Marks of a kind.

        Raises:
            InputError: an option that they do not have, one that is missing, or a value against a rule.
        """
        from designer.marks.dictionaries import dictionary_named
        from designer.marks.face_marks import marks_named

        flags = {name: one.flag for name, one in parameters_of(BoardOptions).items()}
        given, made = self.given(), marks_named(kind)
        own = {name: {one.name for one in fields(marks_named(name))} for name in MARKS}
        for name in given:
            owners = [one for one in MARKS if SAID_OTHERWISE.get(name, name) in own[one]]
            if kind not in owners:
                raise InputError(f"{flags[name]}: belongs to --marks {' or '.join(owners)}; leave it out")
        for name, same in SAID_OTHERWISE.items():
            if name in given and same in given:
                raise InputError(f"{flags[name]}: says the same as {flags[same]}; leave one of both out")
        try:
            if self.dictionary is not None:
                given["dictionary"] = dictionary_named(self.dictionary)
            if self.corners is not None:
                del given["corners"]
                given["squares"] = (self.corners[0] + 1, self.corners[1] + 1)
            if self.gap_mm is not None and self.tag_mm is not None:
                del given["gap_mm"]
                given["spacing"] = self.gap_mm / self.tag_mm
            for one in fields(made):
                if one.name not in given and one.default is MISSING:
                    raise InputError(f"--marks {kind}: takes {EXAMPLES[one.name]}, which is missing")
            return made(**given)
        except InputError:
            raise
        except ValueError as error:
            raise InputError(f"--marks {kind}: {error}") from None


@capability
def board_target(
    marks: Annotated[
        str,
        option(
            f"make the target file of a board that others made: {', '.join(MARKS)}", names=lambda: MARKS, group=GROUP
        ),
    ],
    *,
    board: BoardOptions,
    origin: Annotated[
        Literal["center", "opencv", "kalibr"],
        option("whose object points the coordinates are: center (of the marks), opencv, kalibr", group=GROUP),
    ] = "center",
    two_sided: Annotated[bool, _switch("the back has the same marks, with the ids that follow")] = False,
    thickness_mm: Annotated[float | None, _length("of a two-sided plate")] = None,
    out: Annotated["Output | Place | None", written_to("the target file to make: NAME.target.json")] = None,
) -> TargetContents:
    """Make the target file of a board that others made: `board_target("chessboard", board=BoardOptions(...))`.

    Raises:
        InputError: a value against a rule, or one that such marks do not have.
    """
    import numpy as np

    from designer.target import target_of_marks

    output = asked_place(out, "--marks")
    face = board.face(marks)
    if origin == "kalibr" and marks != "aprilgrid":
        raise InputError(f"--origin kalibr: is that of AprilGrids; of {marks} use opencv or center")
    if (thickness_mm is None) == two_sided:
        raise InputError(
            "--two-sided: takes the plate's thickness, such as --thickness 5mm" if two_sided
            else "--thickness: belongs to --two-sided; leave it out"
        )  # fmt: skip
    frames, faces = [face.target_from_face(origin)], [face]
    if thickness_mm is not None:
        try:
            back = face.following
        except ValueError as error:
            raise InputError(f"--two-sided: {error}") from None
        if back is None:
            raise InputError(f"--two-sided: photos cannot tell two sides of {marks} apart; use charuco or aprilgrid")
        turn = np.diag([-1.0, 1.0, -1.0, 1.0])
        turn[2, 3] = -thickness_mm
        frames, faces = [*frames, frames[0] @ turn], [*faces, back]
    geometry = target_of_marks(faces, np.stack(frames))
    return made_target(output, geometry)


@dataclass(frozen=True)
class PlacedBoard:
    """A board of a joined target, as its TOML file says."""

    file: str
    at_mm: tuple[float, float, float] = (0.0, 0.0, 0.0)  # of the file's origin
    turn_deg: tuple[float, float, float] = (0.0, 0.0, 0.0)  # about x, then about y, then about z


@dataclass(frozen=True)
class JoinedBoards:
    """The boards of a joined target."""

    board: tuple[PlacedBoard, ...]


@capability
def joined_target(
    join: Annotated[
        "Place",
        option(
            "make one target of several: a TOML file with [[board]] file, at_mm = [x, y, z], turn_deg = [x, y, z] of "
            "each, turned about x, then y, then z",
            group=GROUP,
        ),
    ],
    *,
    out: Annotated["Output | Place | None", written_to("the target file to make: NAME.target.json")] = None,
) -> TargetContents:
    """Make one target of boards whose poses are known, a box or boards on walls: `joined_target("box.toml")`.

    Poses that are known to some millimetres only are solved by `calib measure`, with photos that show several boards.

    Raises:
        InputError: a file that cannot be read, boards that photos cannot tell apart, or a place that holds others.
    """
    import numpy as np

    from calib.core.se3 import exp_rotation, make_pose
    from designer.base.codec import decode_written
    from designer.base.files import place_of, read_spec_file
    from designer.page.terminal import quoted
    from designer.target import load_target, target_of_marks

    output, place = asked_place(out, "--join"), place_of(join, "a TOML file of boards")
    try:
        asked = decode_written(JoinedBoards, read_spec_file(place), "")
    except InputError:
        raise
    except ValueError as error:
        raise InputError(f"{place}: {error}") from None
    assert isinstance(asked, JoinedBoards)  # noqa: S101
    faces: list[FaceMarks] = []
    frames = []
    for board in asked.board:
        there = load_target(place.parent / board.file)
        if there.marks is None or there.source != "nominal":
            raise InputError(
                f"{place}: {board.file}: holds no boards as they were designed; join files of `calib target --marks`, "
                "and measure what came of it"
            )
        turns = [exp_rotation(np.eye(3)[axis] * np.radians(angle)) for axis, angle in enumerate(board.turn_deg)]
        pose = make_pose(turns[2] @ turns[1] @ turns[0], np.array(board.at_mm))
        faces += there.marks
        frames += [*(pose @ there.target_from_face)]
    try:
        geometry = target_of_marks(faces, np.stack(frames))
    except ValueError as error:
        raise InputError(f"{place}: {error}") from None
    line = f"calib measure {quoted(output.place)} photos -o measured/{quoted(Path(output.place.name))}"
    return made_target(output, geometry, (line, "where the boards stand to each other, if that is not known to a hair"))
