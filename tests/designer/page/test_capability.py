"""Commands that write as they go: whatever ends them, what is finished stays and is told."""

import inspect
import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal, get_args

import pytest

from designer.base.answer import NegativeError, StoppedError, Summary
from designer.base.errors import InputError, NoAnswerError
from designer.base.options import option
from designer.page.blocks import Cell, Column, Finding, Findings, Headline, Page, Section, Steps, Table
from designer.page.capability import capability, command_of
from designer.page.output import Output, asked_output, output_of
from designer.page.result import Result


@dataclass(frozen=True, eq=False)
class Copies(Result, kind="copies", title="Copies", sought="copy is there"):
    """What the capability below gives."""

    count: int
    remarks: tuple[str, ...] = ()

    def page(self) -> Page:
        """A good and a bad finding, a table, and a step."""
        rows = (Finding("good", "Paper", "white"), Finding("bad", "Ink", "pale"), Finding("bad", "Said", ""))
        table = Table("All", (Column("no"),), ((Cell("1"),),))
        blocks = (Findings(rows), Steps(("fill in ink",)), table)
        return Page("", "", Headline("bad", "pale", "Copies are pale."), (Section("Checks", blocks),))

    @property
    def is_negative(self) -> bool:
        """Always."""
        return True

    @property
    def remedy(self) -> str:
        """What to do."""
        return "fill in ink"


def _folder(given: Mapping[str, object]) -> Path:
    return Path(f"{given.get('word', 'ink')}-copies")


def copy(
    *,
    count: Annotated[int, option("of copies", 0, 9)] = 2,
    word: Annotated[str, option("in each")] = "ink",
    fault: Annotated[str, option("that ends it")] = "",
    out: Annotated["Output | Path | None", option("folder", short="-o")] = None,
) -> Copies:
    """Copy a word."""
    to = None if out is None else output_of(out)
    for number in range(count):
        if to is not None:
            to.write({to.place / f"{number}.txt": word.encode()})
            to.finished.append(to.place / f"{number}.txt")
            to.answer = {"count": number + 1}
    if fault == "stop":
        raise KeyboardInterrupt
    if fault:
        raise NoAnswerError(fault, Copies(0) if fault == "told" else None)
    return Copies(count)


COMMAND = command_of(copy, _folder)


def carried_out(folder: Path, monkeypatch: pytest.MonkeyPatch, **given: object) -> Summary:
    """The command, in a folder."""
    monkeypatch.chdir(folder)
    monkeypatch.setattr("designer.base.answer.command_line", lambda: "copy it")
    return COMMAND(**{"page": True, "verbose": False, **given})


def test_what_is_written_is_told_once_the_work_is_done(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Where it is told, or by default; what is good is left to the page, and what is negative has a remedy."""
    summary = carried_out(tmp_path, monkeypatch, word="dog")
    assert [str(path) for path in summary.wrote] == [
        f"dog-copies/{name}" for name in ("0.txt", "1.txt", "page.json", "index.html")
    ]
    assert summary.exit_code == 1
    assert summary.next_steps == ("copy it",)
    said = capsys.readouterr().out
    assert said.startswith("pale: Copies are pale.\nbad      Ink: pale\nbetter   fill in ink\n")
    assert "white" not in said
    assert "fill in ink; then run the same command again\n         copy it\n" in said
    carried_out(tmp_path, monkeypatch, verbose=True)
    said = capsys.readouterr().out
    assert "white" in said
    assert "All" in said


def test_without_a_page_an_earlier_one_is_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """It shows other results than those beside it."""
    assert carried_out(tmp_path, monkeypatch, page=False).remarks == ()
    carried_out(tmp_path, monkeypatch)
    (remark,) = carried_out(tmp_path, monkeypatch, page=False).remarks
    assert remark.startswith("ink-copies/index.html: is of earlier results")
    assert remark in capsys.readouterr().out


def test_what_is_finished_is_kept_and_said_when_a_person_stops(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """With the files and as much of the answer as is known; or nothing was written."""
    with pytest.raises(StoppedError, match=r"stopped; finished and kept: ink-copies/0.txt$") as stopped:
        carried_out(tmp_path, monkeypatch, count="1", fault="stop")
    assert stopped.value.summary.answer == {"count": 1}
    assert stopped.value.summary.wrote == (Path("ink-copies/0.txt"),)
    with pytest.raises(StoppedError, match="stopped; nothing was written"):
        carried_out(tmp_path, monkeypatch, count="0", fault="stop")


def test_an_answer_that_is_no_is_told_with_what_there_is(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """In a line, or as a result with its page; in Python it is an error of input."""
    with pytest.raises(NegativeError, match="no copy is there: no paper") as negative:
        carried_out(tmp_path, monkeypatch, count="1", fault="no paper")
    assert negative.value.summary.answer == {"count": 1}
    assert negative.value.summary.remarks == ("no paper",)
    summary = carried_out(tmp_path, monkeypatch, fault="told")
    assert summary.exit_code == 1
    assert Path("ink-copies/index.html") in summary.wrote
    with pytest.raises(InputError, match="no paper"):
        capability(copy)(fault="no paper")


@dataclass(frozen=True, eq=False)
class Note(Result, kind="note", title="Note", files={"words.csv": "each word"}, alone="words.csv"):
    """Words, which a table can hold alone."""

    noted: tuple[str, ...]
    remarks = ()

    def page(self) -> Page:
        """How many."""
        return Page("", "", Headline("note", str(len(self.noted)), "words"), ())

    def tables(self) -> dict[str, bytes]:
        """A line a word."""
        return {"words.csv": "\n".join(("# ringsolid words, version 1", "word", *self.noted)).encode()}


@dataclass(frozen=True, eq=False)
class Told(Note, kind="told", title="Told", is_written=False):
    """The same, which a screen tells and no folder holds."""


def _note(*, word: Annotated[str, option("that is noted")] = "ink") -> Note:
    return Note((word,))


def _told(
    *, out: Annotated["Output | Path | None", option("words alone", flag="--list", is_needed=False)] = None
) -> Told:
    made, output = Told(("ink",)), asked_output(out)
    if output is not None:
        output.write({output.place: made.tables()["words.csv"]})
    return made


def test_a_command_writes_where_its_results_go(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Into the folder that its input names, unless it is told another; the table alone where a name ends as its own."""
    monkeypatch.chdir(tmp_path)
    noted = command_of(_note, _folder)
    assert noted(word="paper").wrote[0] == Path("paper-copies/note.json")
    (out,) = get_args(inspect.signature(noted).parameters["out"].annotation)[1:]
    assert out.help.endswith("for words.csv alone [default: ink-copies]")
    assert noted(out=Path("mine.csv")).wrote == (Path("mine.csv"),)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["mine.csv", "paper-copies"]


def test_what_a_screen_tells_is_written_where_it_is_asked_for_alone(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """A command without a folder of its own leaves no file, and has no option for one but its function's."""
    monkeypatch.chdir(tmp_path)
    command = command_of(_told)
    assert command().wrote == ()
    assert not list(tmp_path.iterdir())
    assert "wrote" not in capsys.readouterr().out
    assert set(inspect.signature(command).parameters) == {"out"}
    assert command(out=Path("words.csv")).wrote == (Path("words.csv"),)
    assert "wrote    .: words.csv" in capsys.readouterr().out


@dataclass(frozen=True)
class Ink:
    """Options that belong together."""

    colour: Annotated[Literal["black", "blue"], option("of it")] = "black"
    thinned: Annotated[float, option("water in it", 0, 0.5, unit="share")] = 0.1
    bits: Annotated[Literal[8, 16], option("of a scan")] = 8


@capability
def print_sheets(
    *,
    size_mm: Annotated[float, option("of it", 1, 300)] = 20.0,
    ink: Ink | None = None,
    out: Annotated["Output | Path | None", option("folder", short="-o", is_needed=True)] = None,
) -> Copies:
    """Print sheets."""
    if out is not None:
        output_of(out).write({output_of(out).place / "sheet.txt": f"{size_mm:g} {ink}".encode()})
    return Copies(1)


def test_a_parameter_of_options_is_an_option_for_each_field(tmp_path: Path) -> None:
    """Read, checked and named like all others, in a shell and in Python."""
    command = print_sheets.as_command()  # type: ignore[attr-defined]
    assert list(inspect.signature(command).parameters)[:5] == ["size_mm", "colour", "thinned", "bits", "out"]
    given = {"size_mm": "3cm", "colour": "blue", "thinned": "20%", "bits": "16", "out": tmp_path, "page": False}
    command(**given)
    assert (tmp_path / "sheet.txt").read_text().startswith(f"30 {Ink('blue', 0.2, 16)}")
    command(out=tmp_path, page=False)
    assert (tmp_path / "sheet.txt").read_text().startswith("20 None")
    for name, text, message in (
        ("thinned", "60%", "--thinned 60%: must be from 0% to 50%"),
        ("colour", "blak", "--colour 'blak' is unknown; did you mean 'black'"),
        ("bits", "12", "--bits '12' is unknown; use 8, 16"),
    ):
        with pytest.raises(InputError, match=re.escape(message)):
            command(**{**given, name: text})
    for ink in (Ink(thinned=0.6), Ink(bits=12), "blue"):  # type: ignore[arg-type]
        with pytest.raises(InputError):
            print_sheets(ink=ink)  # type: ignore[arg-type]
