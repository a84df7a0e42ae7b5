"""The command `design`, run as a user runs it."""

import json
import subprocess
import tomllib
from contextlib import chdir
from pathlib import Path

import pytest

from designer.cli import main
from designer.designing import load
from designer.produce import make_files
from tests.support.command_line import calib, program, refused
from tests.support.programs import PYTHON, modules_loaded_by, run

DEFAULT_FILES = {
    "t.target.json", "t.toml", "t.prusa.3mf", "t.bambu.3mf", "t.body.stl", "t.pattern.stl", "t.png", "index.html",
}  # fmt: skip


def design(*arguments: str | Path, cwd: Path) -> subprocess.CompletedProcess[str]:
    """Run `design` in a folder, in this process: the packages that it uses are loaded once for all tests."""
    with chdir(cwd), pytest.MonkeyPatch.context() as patch:
        patch.setenv("COLUMNS", "200")
        answer = program("design", main, *arguments)
    return subprocess.CompletedProcess(arguments, answer.code, answer.out, answer.err)


def design_anew(*arguments: str, cwd: Path) -> subprocess.CompletedProcess[str]:
    """Run `design` in a folder, in a process of its own."""
    return run(PYTHON, "-m", "designer.cli", *arguments, cwd=cwd, check=False, COLUMNS="200")


def contents(folder: Path) -> dict[str, bytes]:
    """Every file of a folder by name."""
    return {path.name: path.read_bytes() for path in folder.iterdir()}


def test_one_size_makes_all_default_files_in_the_exports_folder(tmp_path: Path) -> None:
    """`design ico --edge 20mm` writes exports/ico-20mm/ with the default set, and says so."""
    run = design_anew("ico", "--edge", "20mm", cwd=tmp_path)
    assert run.returncode == 0, run.stderr
    folder = tmp_path / "exports" / "ico-20mm"
    assert {name.replace("ico-20mm", "t") for name in contents(folder)} == DEFAULT_FILES
    for said in (
        "15 on each of 20 faces, 300 in all",
        "on the bed",
        "design rules warn",
        "auto: 5 rings a side",
        "next",
        "open exports/ico-20mm/ico-20mm.bambu.3mf in",
        "or exports/ico-20mm/ico-20mm.prusa.3mf in",
        "calib run exports/ico-20mm/ico-20mm.target.json photos -o camera",
    ):
        assert said in run.stdout
    assert "replaces" not in run.stdout


def test_replacing_another_target_is_said(tmp_path: Path) -> None:
    """A design of the same name with another target says what it replaces; a damaged file, no one's any more, stays."""
    board = ("board", "--columns", "5", "--rows", "4", "--pitch", "8mm", "-o", "out", "--name", "t", "--json")
    file = tmp_path / "out" / "t.target.json"
    first = json.loads(design(*board, cwd=tmp_path).stdout)["answer"]["target_id"]
    again = design(*board, "--inlay-depth", "0.2mm", cwd=tmp_path)
    assert "replaces" not in again.stdout + again.stderr
    changed = design(*board, "--border", "0.6mm", cwd=tmp_path)
    summary = json.loads(changed.stdout)
    line = f"replaces target {first} by {summary['answer']['target_id']} in out: prints and photos of the earlier one"
    assert summary["answer"]["target_id"] != first
    assert len([remark for remark in summary["remarks"] if line in remark]) == 1
    assert line in changed.stderr
    file.write_text("{")
    damaged = design(*board, cwd=tmp_path)
    assert damaged.returncode == 2
    assert "t.target.json: is there already, and not of ringsolid's making" in damaged.stderr
    assert file.read_text() == "{"


def test_help_says_what_to_type_first(tmp_path: Path) -> None:
    """The line that `design` alone shows first is one that works."""
    shown = design(cwd=tmp_path).stdout
    line = shown.split("Begin with: ")[1].splitlines()[0]
    assert shown.index(line) < shown.index("Options")
    assert design(*line.split()[1:], "-o", "out", cwd=tmp_path).returncode == 0


@pytest.mark.parametrize(
    "arguments",
    [
        ["ico", "--edge", "20mm", "--stand", "--formats", "glb,pdf,svg", "--ink-offset", "-20um",
         "--shrink-compensation", "0.3%"],
        ["ico", "--edge", "30mm", "--build", "stickers", "--sticker-thickness", "0.15mm", "--page", "A3"],
        ["board", "--columns", "6", "--rows", "5", "--pitch", "9mm", "--lattice", "triangular", "--border", "3mm",
         "--stand", "--printer", "prusa-mk4", "--body-colour", "#f5f5f0",
         "--skew-compensation", "xy 0.1deg, xz -0.05deg"],
        ["board", "--size", "3x2.5in", "--build", "sheet", "--no-dots", "--no-labels"],
    ],
)  # fmt: skip
def test_the_written_spec_makes_every_file_again(arguments: list[str], tmp_path: Path) -> None:
    """`design make` on the resolved spec reproduces every output byte for byte, in another process too."""
    first = design(*arguments, "--chord-error", "50um", "-o", "a", "--name", "t", cwd=tmp_path)
    assert first.returncode == 0, first.stderr
    again = design_anew("make", "a/t.toml", "-o", "b", cwd=tmp_path)
    assert again.returncode == 0, again.stderr
    one, two = contents(tmp_path / "a"), contents(tmp_path / "b")
    assert "index.html" in one
    assert one.keys() == two.keys()
    assert [name for name in one if one[name] != two[name]] == []


def test_printing_options_never_change_the_target_file(tmp_path: Path) -> None:
    """Ink offset, shrinkage, inlay, printer and colours leave target.json as it is, and change what is printed."""
    board = ["board", "--size", "60x50mm", "--ring-diameter", "7mm", "--pitch", "10mm"]
    design(*board, "-o", "plain", "--name", "t", cwd=tmp_path)
    options = ["--ink-offset", "0.05mm", "--shrink-compensation", "0.5%", "--inlay-depth", "0.8mm",
               "--printer", "prusa-xl", "--body-colour", "#ffff00"]  # fmt: skip
    run = design(*board, *options, "-o", "compensated", "--name", "t", cwd=tmp_path)
    assert run.returncode == 0, run.stderr
    plain, compensated = contents(tmp_path / "plain"), contents(tmp_path / "compensated")
    assert plain["t.target.json"] == compensated["t.target.json"]
    assert plain["t.body.stl"] != compensated["t.body.stl"]


BAD_INPUT = {
    "zero": (["ico", "--edge", "0mm"], "more than zero"),
    "negative": (["ico", "--edge", "-5mm"], "more than zero"),
    "nan": (["ico", "--edge", "nan"], "not a finite number"),
    "unknown unit": (["ico", "--edge", "20mn"], "unknown unit"),
    "no number": (["ico", "--edge", "mm"], "expected a length"),
    "touching rings": (["ico", "--edge", "100mm", "--ring-diameter", "7mm", "--pitch", "6mm"], "at least 7.9mm"),
    "small board": (["board", "--size", "25x25mm", "--ring-diameter", "7mm", "--pitch", "10mm"], "3 x 3"),
    "small edge": (["ico", "--edge", "10mm"], "use at least 14.4mm"),
    "large ring": (["ico", "--edge", "100mm", "--ring-diameter", "20mm"], "at most 10.41mm"),
    "thin stroke": (
        ["board", "--size", "90x90mm", "--ring-diameter", "1mm", "--pitch", "3mm"],
        "thinner than a 0.4mm nozzle",
    ),
    "bed": (["ico", "--edge", "200mm", "--must-fit"], "larger printer"),
    "template": (["make", "mat-ico"], "did you mean 'matt-ico'"),
    "printer": (["ico", "--edge", "20mm", "--printer", "bambu-p1"], "bambu-p1s"),
    "nozzle": (["ico", "--edge", "20mm", "--nozzle", "0.5mm"], "0.2mm, 0.4mm"),
    "name": (["ico", "--edge", "20mm", "--name", "../up"], "letters"),
    "format": (["ico", "--edge", "20mm", "--formats", "dwg"], "unknown format"),
    "page": (["ico", "--edge", "30mm", "--build", "stickers", "--page", "A9"], "A9"),
    "option": (["ico", "--egde", "20mm"], "--edge"),
    "nothing": (["ico"], "edge is missing"),
    "no file": (["make", "none.toml"], "no such file"),
    "a file of another kind": (["make", __file__], "is no TOML file"),
    "no target": (["check", "none.target.json"], "cannot be read"),
    "count": (["board", "--columns", "0", "--rows", "5", "--pitch", "9mm"], "above zero"),
    "deep inlay": (["board", "--size", "60x60mm", "--thickness", "2mm", "--inlay-depth", "3mm"], "at most 1mm"),
    "undercut": (["ico", "--edge", "20mm", "--inlay-depth", "3mm"], "wider border"),
    "offset": (["ico", "--edge", "20mm", "--ink-offset", "2mm"], "closes"),
}


@pytest.mark.parametrize(("arguments", "said"), BAD_INPUT.values(), ids=BAD_INPUT)
def test_bad_input_ends_in_one_line(arguments: list[str], said: str, tmp_path: Path) -> None:
    """Bad input: one line with the rule and the remedy, exit code 2, no traceback, nothing written."""
    run = design(*arguments, cwd=tmp_path)
    assert run.returncode == 2, run.stdout + run.stderr
    assert run.stdout == ""
    assert run.stderr.startswith("error: ")
    assert run.stderr.count("\n") == 1
    assert said in run.stderr
    assert list(tmp_path.iterdir()) == []


def test_toml_errors_name_file_line_and_column(tmp_path: Path) -> None:
    """Malformed TOML is named by file, line and column."""
    (tmp_path / "bad.toml").write_text('kind = "ico"\nedge = = 3\n')
    run = design("make", "bad.toml", cwd=tmp_path)
    assert (run.returncode, run.stderr.count("\n")) == (2, 1)
    assert "bad.toml: line 2, column 8" in run.stderr


def test_a_failed_run_leaves_earlier_outputs_intact(tmp_path: Path) -> None:
    """A run that cannot write all of its files changes none of the earlier ones."""
    board = ("board", "--columns", "5", "--rows", "4", "-o", "out", "--name", "t")
    design(*board, "--pitch", "8mm", cwd=tmp_path)
    out = tmp_path / "out"
    (out / "t.bambu.3mf").unlink()
    (out / "t.bambu.3mf").mkdir()
    before = {path.name: path.read_bytes() for path in out.iterdir() if path.is_file()}
    run = design(*board, "--pitch", "9mm", cwd=tmp_path)
    assert (run.returncode, run.stderr.count("\n")) == (2, 1)
    assert "t.bambu.3mf" in run.stderr
    assert {path.name: path.read_bytes() for path in out.iterdir() if path.is_file()} == before


def test_an_output_folder_that_is_a_file_is_refused(tmp_path: Path) -> None:
    """An output folder that cannot be written: one line, exit code 2."""
    (tmp_path / "out").write_text("mine")
    run = design("ico", "--edge", "20mm", "-o", "out/deeper", cwd=tmp_path)
    assert (run.returncode, run.stderr.count("\n")) == (2, 1)
    assert (tmp_path / "out").read_text() == "mine"


def test_check_finds_violations_and_exits_with_1(tmp_path: Path) -> None:
    """`design check` exits with 0 where all rules hold, with 1 where one is violated, for specs and target files."""
    long = ("--columns", "24", "--rows", "4", "--pitch", "8mm")
    design("board", *long, "-o", "out", "--name", "t", cwd=tmp_path)
    for file in ("out/t.target.json", "out/t.toml"):
        fits = design("check", file, "--printer", "prusa-xl", cwd=tmp_path)
        assert (fits.returncode, "not printable" in fits.stdout) == (0, False), fits.stderr
        too_large = design("check", file, "--printer", "bambu-a1-mini", cwd=tmp_path)
        assert (too_large.returncode, "not printable" in too_large.stdout) == (1, True)


def test_options_replace_a_templates_values(tmp_path: Path) -> None:
    """`design make TEMPLATE --option` overrides the template."""
    run = design("make", "3d-board", "--size", "60x50mm", "--ink-colour", "#112233", "-o", "out", cwd=tmp_path)
    assert run.returncode == 0, run.stderr
    spec = tomllib.loads((tmp_path / "out" / "3d-board.toml").read_text())
    assert (spec["size"], spec["ink_colour"], spec["ring_diameter"]) == ("60x50mm", "#112233", "7mm")


def test_every_template_can_be_made(tmp_path: Path) -> None:
    """The paper's five objects: true sizes, and as many rings as their sizes hold."""
    rings = {"master-ico": 720, "matt-ico": 720, "shiny-ico": 720, "alu-board": 1521, "3d-board": 441}
    listed = design("templates", cwd=tmp_path).stdout
    for name, count in rings.items():
        made = load(name)
        assert made.geometry.ring_count == count
        assert not made.check.violations
        assert make_files(made.design, lambda stage: None)
        assert name in listed


def test_help_loads_nothing_heavy() -> None:
    """`design --help` imports no numpy, pint or CAD, which is what keeps it fast."""
    heavy = {"numpy", "pint", "build123d", "trimesh", "PIL", "scipy"}
    assert not heavy & modules_loaded_by("import designer.cli")


def test_target_module_needs_only_numpy() -> None:
    """`designer.target`, which `calib` loads, imports nothing heavier than numpy."""
    heavy = {"pydantic", "pint", "manifold3d", "build123d", "PIL", "scipy"}
    assert not heavy & modules_loaded_by("import designer.target")


def test_calib_reads_what_design_wrote(tmp_path: Path) -> None:
    """`calib target` reads a target file, and refuses a changed one in one line."""
    design("ico", "--edge", "20mm", "-o", "out", "--name", "t", cwd=tmp_path)
    path = tmp_path / "out" / "t.target.json"
    assert "rings 240, dots 60" in calib("target", path).out
    path.write_text(path.read_text().replace("2.63", "2.64"))
    assert "geometry_id" in refused("target", path)
