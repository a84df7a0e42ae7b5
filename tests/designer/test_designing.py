"""Designing from Python: the same as the command line."""

import math
import signal
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from threading import Event

import numpy as np
import pytest

import designer
from designer.app.design import LENGTHS
from designer.builds import design as making
from designer.builds.design import Design, make_files
from designer.spec.kind import KINDS, kind_named
from designer.spec.options import options_of
from tests.support.command_line import design
from tests.support.programs import PYTHON, run

COARSE = {"formats": ("stl",), "chord_error": "0.1mm"}
SMALL = {
    "ico": {"edge_mm": 20}, "board": {"size_mm": (60, 40)}, "cube": {"edge_mm": 28}, "octahedron": {"edge_mm": 24},
    "tetrahedron": {"edge_mm": 36}, "dodecahedron": {"edge_mm": 20}, "dome": {"edge_mm": 20},
    "corner": {"edge_mm": 30},
    "coupon": {},
}  # fmt: skip


@pytest.mark.parametrize("kind", [kind for kind in KINDS if not kind_named(kind).asked.read_into])
def test_a_function_makes_the_files_of_the_command(kind: str, tmp_path: Path) -> None:
    """Byte for byte, with lengths as numbers and the unit in their names."""
    target = getattr(designer, kind)(**SMALL[kind], **COARSE)
    written = target.save(tmp_path / "python")
    words = [f"--{key.removesuffix('_mm')}={'x'.join(map(str, v)) if isinstance(v, tuple) else v}mm"
             for key, v in SMALL[kind].items()]  # fmt: skip
    assert design(kind, *words, "--formats", "stl", "--chord-error", "0.1mm", "-o", tmp_path / "command").code == 0
    files = {file.name for file in written.files}
    assert files == {path.name for path in (tmp_path / "command").iterdir()}
    for name in files:
        assert (tmp_path / "python" / name).read_bytes() == (tmp_path / "command" / name).read_bytes(), name
    assert target.geometry == designer.load_target(str(tmp_path / "python" / f"{target.name}.target.json"))


def test_templates_and_files_load_with_wishes_in_their_place(tmp_path: Path) -> None:
    """A name or a path; what is asked for replaces the file's value."""
    plain, other = designer.load("3d-board"), designer.load("3d-board", ring_diameter_mm=6)
    assert plain.geometry.geometry_id != other.geometry.geometry_id
    files = {file.name: file.content for file in designer.load("3d-board", **COARSE).files()}
    spec = tmp_path / "mine.toml"
    spec.write_bytes(files["3d-board.toml"])
    assert designer.load(spec).geometry == plain.geometry


@pytest.mark.parametrize(
    ("wishes", "rule"),
    [
        ({"edge_mm": -1}, "edge"),
        ({"edge_mm": "2cm"}, "give a number of millimetres"),
        ({"edge": "2 parsecs"}, "edge"),
        ({"edge_mm": 20, "colour_of_the_sky": "blue"}, "colour_of_the_sky"),
        ({"edge_mm": 1}, "edge"),
    ],
)
def test_bad_wishes_are_one_line(wishes: dict[str, object], rule: str) -> None:
    """The same exception that the command line prints; nothing is printed here."""
    with pytest.raises(designer.InputError, match=rule) as error:
        designer.ico(**wishes)
    assert "\n" not in str(error.value)
    with pytest.raises(designer.InputError, match="there are ico"):
        designer.design("tesseract")
    with pytest.raises(AttributeError):
        designer.tesseract  # noqa: B018 - looked up


NO_NUMBERS = [
    [1], (1,), [], {1: 2}, {1}, np.array(1.0), np.array([1.0]), np.array([[1.0, 2.0]]), [[1]], range(3), iter([1]),
    True, "?", b"1", 1j, math.nan, math.inf, 10**400, object(),
]  # fmt: skip


def test_only_numbers_are_numbers() -> None:
    """Of every option of every kind, what is nearly a number is refused in a line, with the unit in its name or not."""
    numeric = (*LENGTHS, "percent", "count", "ratio", "price", "skew")
    options = {name: (kind, one) for kind in KINDS for name, one in options_of(kind_named(kind).asked).items()}
    for name, (kind, option) in options.items():
        for wish in NO_NUMBERS:
            with pytest.raises(designer.InputError, match=name.replace("_", "[ _]")) as error:
                designer.design(kind, **{f"{name}_mm": wish})
            assert "\n" not in str(error.value)
        for wish in ([1], {1: 2}, np.array(1.0), True) if option.value in numeric else ():
            with pytest.raises(designer.InputError):
                designer.design(kind, **{name: wish})


@pytest.mark.parametrize("wish", [(60, 40), [60.0, 40.0], np.array([60.0, 40.0]), (np.float64(60), np.int64(40))])
def test_the_numbers_of_a_size_come_in_what_keeps_their_order(wish: object) -> None:
    """Tuples, lists and arrays."""
    assert designer.board(size_mm=wish).geometry == designer.board(size="60x40mm").geometry


def test_the_import_loads_next_to_nothing() -> None:
    """Until a name is used; all are listed."""
    code = "import sys, designer; print(*sys.modules); print(*dir(designer))"
    loaded, listed = (set(line.split()) for line in run(PYTHON, "-c", code).stdout.splitlines())
    assert not {"numpy", "pydantic", "typer", "designer.target", "designer.spec.kind"} & loaded
    assert {*designer.__all__, *KINDS} <= listed


def test_a_process_that_makes_a_file_ends_with_ctrl_c(monkeypatch: pytest.MonkeyPatch) -> None:
    """Stopped while the CAD kernel is at work: it is ended, and the person does not wait for it."""
    begun = Event()
    process: list[subprocess.Popen[bytes]] = []

    def slow(design: Design) -> Iterator[tuple[str, bytes, str]]:
        process.append(subprocess.Popen([sys.executable, "-c", "input()"], stdin=subprocess.PIPE))
        making._PROCESSES.add(process[0])
        begun.set()
        process[0].wait()
        yield "step", b"", ""

    def interrupt(stage: str) -> None:
        assert begun.wait(60)
        raise KeyboardInterrupt

    monkeypatch.setattr(making, "EXPORTERS", {**making.EXPORTERS, "step": slow})
    made = designer.board(size_mm=(60, 60)).design
    with pytest.raises(KeyboardInterrupt):
        make_files(replace(made, job=replace(made.job, formats=("step",))), interrupt)
    assert process[0].wait() == -signal.SIGTERM


def test_who_waits_for_a_process_that_was_stopped_is_stopped_too(monkeypatch: pytest.MonkeyPatch) -> None:
    """And does not work out by itself what it was to tell."""
    monkeypatch.setattr(making, "_PROCESSES", set())
    told = making.apart("designer.builds.design:step_from_spec", designer.board(size_mm=(60, 60)).design.job)
    (process,) = making._PROCESSES
    process.terminate()
    with pytest.raises(KeyboardInterrupt):
        told()
    assert not making._PROCESSES


@pytest.mark.parametrize("printer", ["bambu-p1s", "bambu-a1"])
def test_what_does_not_fit_ends_as_the_check_of_it(printer: str, tmp_path: Path) -> None:
    """`design` writes a part that the printer cannot make and says so, with the exit code of `check`; or refuses it."""
    options = ("--size", "240x240mm", "--printer", printer, "--chord-error", "0.1mm", "--formats", "stl")
    made = design("board", *options, "-o", tmp_path / "b")
    checked = design("check", tmp_path / "b" / "board-240x240mm.toml")
    assert made.code == checked.code == (1 if printer == "bambu-p1s" else 0)
    refused = design("board", *options, "--must-fit", "-o", tmp_path / "c")
    assert refused.code == (2 if made.code else 0)
    assert (tmp_path / "c").exists() == (not made.code)


def test_parts_that_fit_no_bed_are_refused_by_the_check_too(tmp_path: Path) -> None:
    """Pieces too large for the bed: the same line from `design` and from `check` of the same spec."""
    spec = tmp_path / "long.toml"
    spec.write_text('kind = "board"\nsize = "60x60mm"\nbuild = "tiles"\n')
    made, checked = design("make", spec, "-o", tmp_path / "b"), design("check", spec)
    assert made.code == checked.code == 2
    assert made.err == checked.err
