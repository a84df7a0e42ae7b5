"""What board a photo shows, and its target file once a ruler has told its lengths: `calib target --from-photo`."""

from dataclasses import MISSING, dataclass, fields, replace
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from calib.app.target_contents import asked_place, contents_of
from calib.app.target_of_marks import GROUP, SAID_OTHERWISE, BoardOptions
from designer.base.errors import InputError, NoAnswerError
from designer.base.marks import NOT_IN_FILE
from designer.base.options import option, parameters_of
from designer.base.words import printable
from designer.page.capability import capability, written_to
from designer.page.result import Result

if TYPE_CHECKING:
    from calib.app.inputs import Place
    from calib.detector.board_in_photo import BoardInPhoto
    from designer.marks.face_marks import FaceMarks
    from designer.page.blocks import Page
    from designer.page.output import Output
    from designer.target import TargetGeometry

SCALES = ("square_mm", "tag_mm", "pitch_mm")
RULER = (*SCALES, "spacing")
"""What a photo cannot tell as well as it is needed; a marker's side and circles' diameters matter to no point."""
LENGTHS = (*RULER, "marker_mm", "gap_mm", "diameter_mm")


@dataclass(frozen=True)
class ProposedBoard:
    """A board that a photo may show."""

    line: str  # of the command that makes its target file
    seen: int  # markers, corners or circles
    sure: tuple[str, ...]
    unsure: tuple[str, ...]
    missing: tuple[str, ...]  # options with lengths that a ruler has to tell


@dataclass(frozen=True, eq=False)
class BoardsInPhoto(Result, kind="boards", title="Boards in a photo", doing="looking at the photo", is_written=False):
    """The boards that explain a photo, the best first."""

    photo: str
    boards: tuple[ProposedBoard, ...]
    target_id: str | None  # of the target file, if all lengths of the one board are known
    geometry: Annotated["TargetGeometry | None", NOT_IN_FILE] = None
    file: Annotated[Path | None, NOT_IN_FILE] = None  # that was written
    remarks: tuple[str, ...] = ()

    def page(self) -> "Page":
        """What is sure, what is not, and the line that makes the target file."""
        from designer.page.blocks import Command, Facts, Finding, Findings, Headline, Page, Section
        from designer.page.terminal import quoted

        rows = [
            row
            for number, one in enumerate(self.boards, 1)
            for row in (
                ("shows" if len(self.boards) == 1 else f"may show {number}", f"{one.seen} marks of it"),
                *(("sure", each) for each in one.sure),
                *(("not sure", each) for each in one.unsure),
                *(("ruler", f"{each}, over as much of the board as it reaches") for each in one.missing),
                ("target", one.line),
            )
        ]
        several = "" if len(self.boards) == 1 else f"; {len(self.boards)} boards explain it"
        said = Findings(tuple(Finding("note", "", printable(line)) for line in self.remarks))
        steps = (Command(f"calib run {quoted(self.file)} photos", "photos of it"),) if self.file else ()
        kind = self.boards[0].line.split()[3]
        head = Headline("note", printable(self.photo), f"shows {kind}{several}")
        parts = (Section("", (said,)),) if self.remarks else ()
        return Page("", "", head, parts, lead=(Facts(tuple(rows)),), next_steps=steps)

    def save(self, place: str | PathLike[str], *, command: str = "", has_page: bool = False) -> tuple[Path, ...]:
        """Write the target file.

        Raises:
            InputError: it is not known which board that is, or how large; or the place holds something else.
        """
        if self.geometry is None:
            one = self.boards[0]
            why = f"give {' and '.join(one.missing)}" if len(self.boards) == 1 else f"use one of the lines: {one.line}"
            raise InputError(f"-o {place}: {self.photo} does not tell all of the board; {why}")
        return contents_of(self.geometry, str(place)).save(place)


@capability
def photo_target(
    from_photo: Annotated[
        "Place",
        option("propose what board a photo shows; with its lengths (--square, ...) and -o, make its file", group=GROUP),
    ],
    *,
    board: BoardOptions,
    out: Annotated["Output | Place | None", written_to("the target file to make: NAME.target.json")] = None,
) -> BoardsInPhoto:
    """Say what board a photo shows: its marks, dictionary, ids and layout, but no lengths.

    Raises:
        InputError: a photo that cannot be read, or an option that says more than a length.
        NoAnswerError: it shows no board.
    """  # fmt: skip
    import numpy as np

    from calib.detector.board_in_photo import boards_in, loose_markers
    from calib.images.photo import read_image
    from designer.base.files import place_of
    from designer.page.output import asked_output
    from designer.target import target_of_marks

    flags = {name: one.flag for name, one in parameters_of(BoardOptions).items()}
    if odd := [flags[name] for name in board.given() if name not in LENGTHS]:
        raise InputError(f"{odd[0]}: --from-photo tells that itself; leave it out, or give all with --marks")
    output = None if asked_output(out) is None else asked_place(out, "--from-photo")
    place = place_of(from_photo, "a photo")
    pixels = read_image(place).pixels
    found = boards_in(pixels)
    if not found:
        if loose := loose_markers(pixels):
            raise NoAnswerError(
                f"{place}: shows {loose[0]} markers of {loose[1]}, but no one board explains them: are there several "
                "boards (cover all but one), or markers on their own? A target needs a grid of tags or a ChArUco board"
            )
        raise NoAnswerError(
            f"{place}: shows no chessboard, ChArUco board, grid of tags or grid of circles that is found; take it from "
            "in front, sharp, with white all around it (a target of `design` has its file with it)"
        )
    proposed = tuple(_proposed(one, board) for one in found)
    geometry = None
    if len(found) == 1 and not proposed[0].missing:
        face = _with_lengths(found[0].marks, board)
        geometry = target_of_marks([face], np.eye(4)[None])
    made = BoardsInPhoto(
        str(place), proposed, None if geometry is None else geometry.geometry_id, geometry,
        None if output is None else output.place,
    )  # fmt: skip
    if output is not None:
        output.files += made.save(output.place)
    return made


def _with_lengths(marks: "FaceMarks", board: BoardOptions) -> "FaceMarks":
    """The marks as large as the ruler says, what it does not say in proportion; InputError: against a rule."""
    scale = board.square_mm or board.tag_mm or board.pitch_mm or 1.0
    names = {one.name for one in fields(marks)}
    given = {name: value for name, value in board.given().items() if name in names}
    if board.gap_mm is not None and board.tag_mm is not None:
        given["spacing"] = board.gap_mm / board.tag_mm
    measured = {name: scale * getattr(marks, name) for name in names if name.endswith("_mm")}
    try:
        return replace(marks, **(measured | given))
    except ValueError as error:
        raise InputError(f"lengths of the board: {error}") from None


def _proposed(found: "BoardInPhoto", board: BoardOptions) -> ProposedBoard:
    """The line of `calib target --marks` that makes the board."""
    marks, given = found.marks, board.given()
    flags = {name: one.flag for name, one in parameters_of(BoardOptions).items()}
    own = {one.name for one in fields(marks)}
    odd = [flags[name] for name in given if SAID_OTHERWISE.get(name, name) not in own]
    if odd:
        raise InputError(f"{odd[0]}: the photo shows {marks.kind}, which has no such length; leave it out")
    known = {SAID_OTHERWISE.get(name, name) for name in given}
    missing = [name for name in RULER if name in own and name not in known]
    is_scaled = not known.isdisjoint(SCALES)
    sized = _with_lengths(marks, board) if is_scaled else marks
    words = ["calib", "target", "--marks", marks.kind]
    for one in fields(sized):
        value = getattr(sized, one.name)
        if one.name in missing or (one.name.endswith("_mm") and not is_scaled):
            words += [flags[one.name], "...mm" if one.name.endswith("_mm") else "..."]
        elif isinstance(value, bool):
            words += [(flags[one.name] if value else f"--no-{flags[one.name][2:]}")] if value != one.default else []
        elif one.default is MISSING or value != one.default:
            is_tuple, form = isinstance(value, tuple), "" if isinstance(value, str) else "g"
            text = "x".join(map(str, value)) if is_tuple else format(value, form)
            words += [flags[one.name], f"{text}mm" if one.name.endswith("_mm") else text]
    told = tuple(flags[name] if name != "spacing" else f"{flags['gap_mm']} or {flags['spacing']}" for name in missing)
    return ProposedBoard(" ".join([*words, "-o", "board.target.json"]), found.seen, found.sure, found.unsure, told)
