"""How commands end: 0 fine, 1 ran but the answer is negative, 2 bad input, 130 stopped; in JSON too."""

import json
import shlex
import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import click
import pytest
import typer
from typer.core import TyperGroup

from calib.cli import app as calib_app
from calib.observe.calibration_file import read_calibration
from designer.cli import app as design_app
from designer.spec.kind import KINDS
from tests.support.command_line import LENIENT, Answer, calib, design, summary_of
from tests.support.programs import PYTHON, run, start
from tests.support.waiting import WITHIN_S

ROOT = Path(__file__).parents[2]
DOCUMENTED = (ROOT / "docs/json.md").read_text()
SMALL = ("--columns", "6", "--rows", "5", "--pitch", "9mm")
TAKEN = ("--target", "board.target.json", "--detections", "detections.csv")
BOOTSTRAP = ("study", "bootstrap", *TAKEN, "--sizes", "6", "--samples", "4", "--jobs", "1", "-o", "out")
TOLERANCE = ("tolerance", "board.target.json", "--views", "8", "--distance", "200mm", "--linear", "-o", "out")
OF_A_RIG = ("--errors", "fdm-board", "--rig", "pair.rig.json", "--frames", "8", "--distance", "150mm..250mm")
CHOOSE = ("choose", "--field", "60deg", "--volume", "8x8x4cm", "--image-size", "640x400")
SOLVE = ("solve", "--target", "board.target.json", "--model", "pinhole", "-o", "out")
RUN = ("run", "board.target.json", "photos", "--model", "opencv", "-o", "out")
FOR_POSES = ("pose", "board.target.json", "camera.json")


@dataclass(frozen=True)
class Case:
    """A command line and how it ends."""

    words: tuple[str, ...]
    code: int
    before: tuple[str, ...] = ()  # a command line that makes what it takes


DESIGN = (
    Case(("ico", "--edge", "20mm", "--build", "stickers", "-o", "out"), 0),
    Case(("cube", "--edge", "24mm", "--build", "stickers", "-o", "out"), 0),
    Case(("octahedron", "--edge", "24mm", "--build", "stickers", "-o", "out"), 0),
    Case(("tetrahedron", "--edge", "36mm", "--build", "stickers", "-o", "out"), 0),
    Case(("ico", "--edge", "1mm"), 2),
    Case(("dodecahedron", "--edge", "14mm", "--build", "stickers", "-o", "out"), 0),
    Case(("dodecahedron", "--edge", "2mm"), 2),
    Case(("dome", "--edge", "20mm", "--build", "stickers", "-o", "out"), 0),
    Case(("dome", "--edge", "60mm", "--build", "tiles"), 2),
    Case(("corner", "--edge", "30mm", "--build", "stickers", "-o", "out"), 0),
    Case(("corner", "--edge", "60mm", "--build", "tiles"), 2),
    Case(("solid", "none.stl", "--unit", "mm"), 2),
    Case(("board", *SMALL, "--build", "sheet", "-o", "out"), 0),
    Case(("board", "--columns", "many"), 2),
    Case(("board", "--marks", "charuco", "--squares", "5x4", "--square", "16mm", "--build", "sheet", "-o", "out"), 0),
    Case(("board", "--marks", "rings"), 2),
    Case(("coupon", "--build", "sheet", "-o", "out"), 0),
    Case(("coupon", "--pitch", "20mm"), 2),
    Case(("make", "alu-board", "--size", "60x60mm", "-o", "out"), 0),
    Case(("make", "no-board"), 2),
    Case(("templates",), 0),
    Case(("templates", "more"), 2),
    Case(("check", "3d-board", "--printer", "prusa-xl"), 0),
    Case(("check", "3d-board", "--printer", "bambu-a1-mini"), 1),
    Case(("check", "none.toml"), 2),
    Case(("convert", "board.target.json", "--to", "csv", "-o", "points.csv"), 0),
    Case(("convert", "board.target.json", "--to", "foo"), 2),
    Case((*TOLERANCE, "--errors", "fdm-board"), 0),
    Case((*TOLERANCE, "--errors", "fdm-board", "--require", "intersection=1mm"), 0),
    Case((*TOLERANCE, "--errors", "fdm-board", "--require", "intersection=1um"), 1),
    Case((*TOLERANCE, "--errors", "fdm"), 2),
    Case((*TOLERANCE[:2], *OF_A_RIG, "--linear", "-o", "out"), 0),
    Case(("ways", *TOLERANCE[1:-3], *TOLERANCE[-2:]), 0),
    Case(("ways", "board.target.json", "--by", "beauty", "-o", "out"), 2),
    Case((*CHOOSE, "-o", "out"), 0),
    Case((*CHOOSE, "--goal", "0.001px", "-o", "out"), 1),
    Case((*CHOOSE, "--cameras", "0"), 2),
    Case(("no-command",), 2),
)
RENDER_RIG = ("render", "board.target.json", "--rig", "pair.rig.json", "--frames", "1", "--jobs", "1", "-o", "o")
PLAN = ("plan", "board.target.json", "--camera", "camera.json")
CALIB = (
    Case(("target", "board.target.json"), 0),
    Case(("target", "camera.json"), 2),
    Case(("target", "--marks", "chessboard", "--squares", "9x6", "--square", "25mm", "-o", "chess.target.json"), 0),
    Case(("target", "--marks", "chess", "--squares", "9x6", "-o", "chess.target.json"), 2),
    Case(
        ("render", "board.target.json", "--views", "1", "--camera", "camera.json", "--distance", "150mm", "-o", "o"), 0
    ),
    Case(("render", "board.target.json", "--views", "none", "-o", "o"), 2),
    Case((*RENDER_RIG, "--distance", "15cm"), 0),
    Case(("detect", "board.target.json", "photos", "-o", "out.csv", "--overlay", "seen"), 0),
    Case(("detect", "board.target.json", "blank", "-o", "out.csv"), 1),
    Case(("detect", "board.target.json", "none.png", "-o", "out.csv"), 2),
    Case((*RUN, *LENIENT), 0),
    Case((*RUN, "--criteria", "metrology", "--no-page"), 1),  # of a camera that is not to be used
    Case(("run", "board.target.json", "blank", "-o", "out"), 1),
    Case(("run", "board.target.json", "photos", "--model", "periscope", "-o", "out"), 2),
    Case((*RUN, "--criteria", "none"), 2),
    Case(("run", "board.target.json", "none.mcap"), 2),
    Case(("hand-eye", "board.target.json", "none.bag", "--tf", "base_link", "tool0"), 2),
    Case((*SOLVE, "detections.csv", *LENIENT), 0),
    Case((*SOLVE, "detections.csv", "--criteria", "metrology", "--no-page"), 1),  # of a camera that is not to be used
    Case((*SOLVE, "frontal.csv", *LENIENT), 1),  # of one that is not determined, whatever the limits
    Case((*SOLVE, "detections.csv", "--criteria", "none.toml"), 2),
    Case((*SOLVE, "camera.json"), 2),
    Case(("evaluate", "solved", "--truth", "truth.json"), 0),
    Case(("evaluate", "lost", "--no-figures"), 1),
    Case(("evaluate", "photos"), 2),
    Case(("convert", "camera.json", "--to", "opencv", "-o", "new.yml"), 0),
    Case(("convert", "camera.json", "--to", "lut", "-o", "new.lut", "--accept", "1px"), 0),
    Case(("convert", "camera.json", "--to", "nothing", "-o", "new.yml"), 2),
    Case(("convert", "pair.rig.json", "--to", "lut", "-o", "new.lut"), 2),
    Case(("convert", "pair.rig.json", "--to", "kalibr", "-o", "chain.yaml"), 0),
    Case(("convert", "pair.rig.json", "--to", "basalt", "-o", "chain.yaml"), 2),
    Case(("markers", "board.target.json", "detections.csv", "--to", "colmap", "-o", "markers"), 0),
    Case(("markers", "board.target.json", "detections.csv", "--to", "odd", "-o", "markers"), 2),
    Case(("undistort", "camera.json", "photos/view_0000.png", "-o", "out"), 0),
    Case(("undistort", "camera.json", "none.png", "-o", "out"), 2),
    Case((*FOR_POSES, "photos", "-o", "poses.json", "--overlay", "seen"), 0),
    Case((*FOR_POSES, "blank"), 1),
    Case((*FOR_POSES, "none.png"), 2),
    Case(("pose", "--rig", "pair.rig.json", "board.target.json", "photos", "blank"), 2),
    Case(("check", "camera.json", "board.target.json", "photos", "--focal", "1%", "-o", "out"), 0),
    Case(("check", "camera.json", "board.target.json", "photos", "--focal", "0.0001%", "-o", "out"), 1),
    Case(("check", "camera.json", "board.target.json", "none.png", "-o", "out"), 2),
    Case(("diff", "camera.json", "other.json", "--picture", "map.png"), 0),
    Case(("diff", "camera.json", "no-camera.json"), 2),
    Case(("measure", "board.target.json", "squarely.csv", "--rings", "rigid", "--flat", "-o", "m.target.json"), 1),
    Case(("measure", "board.target.json", "--measured-length", "ring 0 to ring 6:72.1mm", "-o", "m.target.json"), 0),
    Case(("measure", "board.target.json", "-o", "m.target.json"), 2),
    Case(("coupon", "none.png"), 2),
    Case(("triangulate", "pair.rig.json", "sightings.csv", "-o", "out"), 0),
    Case(("triangulate", "pair.rig.json", "alone.csv", "-o", "out"), 1),
    Case(("triangulate", "pair.rig.json", "detections.csv", "-o", "out"), 2),
    Case(("budget", "pair.rig.json", "--distance", "15cm..40cm", "-o", "out"), 0),
    Case(("budget", "pair.rig.json", "--volume", "0..1,0..1mm", "-o", "out"), 2),
    Case((*PLAN, "--made", "exact", "--within", "2px", "-o", "out"), 0),
    Case((*PLAN, "--made", "exact", "--within", "0.001px", "--most", "6", "-o", "out"), 1),
    Case((*PLAN, "--within", "0px", "-o", "out"), 2),
    Case(("rig", "--table", "rig.csv", "--model", "opencv", "-o", "out", "--no-page"), 0),
    Case(("rig", "board.target.json", "photos", "blank", "-o", "out"), 2),
    Case(("rig", "board.target.json", "--table", "blind.csv", "-o", "out", "--no-page"), 1),
    Case(("hand-eye", "board.target.json", "photos", "--robot", "rig.csv", "-o", "out"), 2),
    Case(("turntable", "board.target.json", "photos", "--step", "0deg", "-o", "out"), 2),
    Case(("live", "board.target.json", "--watch", "none", "-o", "out"), 2),
    Case(("report", "solved"), 0),
    Case(("report", "solved", "--criteria", "metrology"), 1),
    Case(("report", "photos"), 2),
    Case(("warm-up", "detect"), 0),
    Case(("warm-up", "nothing"), 2),
    Case(BOOTSTRAP, 0),
    Case((*BOOTSTRAP, "--sizes", "none"), 2),
    Case(("study", "plot", "out", "-o", "again"), 0, before=BOOTSTRAP),
    Case(("study", "plot", "photos"), 2),
    Case(("study", "paper", "-o", "camera.json"), 2),
    Case(("study", "compare", "--prints", "0", "-o", "out"), 2),
    Case(("study", "cost", "--sets", "0", "-o", "out"), 2),
    Case(("study", "no-command"), 2),
)
CASES = [pytest.param(design, case, id=f"design {' '.join(case.words[:2])} {case.code}") for case in DESIGN]
CASES += [pytest.param(calib, case, id=f"calib {' '.join(case.words[:2])} {case.code}") for case in CALIB]


SAME_WAY = {*KINDS, "make", "tolerance", "ways"} - {"board"}
"""Commands that write as another one does: `board` and the studies stand for them."""
OF_COMMAND = {(one.values[0], one.values[1].words[:2]): one for one in CASES[::-1] if one.values[1].code != 2}
WRITING = [
    one
    for one in OF_COMMAND.values()
    if one.values[1].words[0] not in SAME_WAY
    and ("-o" in one.values[1].words or one.values[1].words[0] in ("evaluate", "diff"))
]
"""These run again over their own files (`test_own_files`)."""


@pytest.fixture(autouse=True)
def folder(scene_copy: Path) -> Path:
    """Where the commands work."""
    return scene_copy


def require_promised(answer: Answer, case: Case) -> None:
    """How a command must end."""
    assert answer.code == case.code, answer
    summary = summary_of(answer)
    if case.code == 2:
        assert answer.err == f"error: {summary['error']}\n"
        assert (summary["answer"], summary["wrote"]) == ({}, [])
    else:
        assert answer.err.strip()  # what a person reads
        assert summary["answer"]
        undocumented = [key for key in summary["answer"] if f"`{key}`" not in DOCUMENTED]
        assert not undocumented


@pytest.mark.parametrize(("program", "case"), [one for one in CASES if one.values[1].code == 2])
def test_bad_input_is_one_line_on_standard_error(program: Callable[..., Answer], case: Case) -> None:
    """And nothing else: no traceback, nothing on standard output but with `--json`, no file."""
    before = sorted(Path().rglob("*"))
    answer = program(*case.words)
    assert (answer.code, answer.out) == (2, "")
    assert answer.err.startswith("error: ")
    assert answer.err.count("\n") == 1
    require_promised(program(*case.words, "--json"), case)
    assert sorted(Path().rglob("*")) == before


def commands_of(app: typer.Typer) -> Iterator[tuple[str, click.Command]]:
    """All commands of a program, those of groups by both words."""
    root = typer.main.get_command(app)
    assert isinstance(root, TyperGroup)
    for name, one in root.commands.items():
        if isinstance(one, TyperGroup):
            yield from ((f"{name} {inner}", command) for inner, command in one.commands.items())
        else:
            yield name, one


@pytest.mark.parametrize(("program", "app", "cases"), [(design, design_app(), DESIGN), (calib, calib_app(), CALIB)])
def test_the_table_is_of_all_commands_and_each_has_the_option(
    program: Callable[..., Answer], app: typer.Typer, cases: tuple[Case, ...]
) -> None:
    """A command that is added must be in the table, and its help must tell of --json."""
    lines = [" ".join(case.words) for case in cases]
    for name, _ in commands_of(app):
        assert any(line.startswith(name) for line in lines), name
        assert "--json" in program(*name.split(), "--help").out, name


@pytest.mark.parametrize(("program", "app"), [(design, design_app()), (calib, calib_app())])
def test_an_empty_word_is_no_folder(program: Callable[..., Answer], app: typer.Typer) -> None:
    """`-o ""`, as of a shell's variable that is not set, fills no current folder: every command refuses it."""
    before = sorted(Path().rglob("*"))
    for name, _ in commands_of(app):
        if "-o, --out" in program(*name.split(), "--help").out:
            answer = program(*name.split(), "-o", "")
            said = "error: --out '': names no file and no folder; give its name, or leave it out\n"
            assert (answer.code, answer.err) == (2, said), name
    assert sorted(Path().rglob("*")) == before


@pytest.mark.parametrize(
    ("words", "patched"),
    [
        (("detect", "board.target.json", "photos", "-o", "out/d.csv"), "calib.observe.search.write_search"),
        (("run", "board.target.json", "photos", "-o", "out"), "calib.observe.search.write_search"),
        ((*SOLVE, "detections.csv"), "calib.judge.solutions.calibrate"),
        (("study", "paper", "--quick", "-o", "out"), "calib.studies.paper_study.missing_targets"),
        (("study", "compare", "--quick", "-o", "out"), "calib.studies.compare.cases.comparison"),
        (("study", "cost", "--quick", "-o", "out"), "calib.studies.cost.ratios.cases_of"),
        (BOOTSTRAP, "calib.studies.bootstrap.make_pool"),
        (("convert", "camera.json", "--to", "ros", "-o", "c.yaml"), "calib.cameras.formats.holding.fit_to_format"),
    ],
)
def test_a_stopped_command_ends_with_130(words: tuple[str, ...], patched: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Ctrl-C is no error: one line says what stays, in the document too, and nothing half-written does."""
    before = sorted(path for path in Path().rglob("*") if path.is_file())
    monkeypatch.setattr(patched, _interrupted)
    answer = calib(*words, "--json")
    assert answer.code == 130
    summary = summary_of(answer)
    assert answer.err.splitlines()[-1] == summary["error"]
    assert summary["error"].startswith("stopped; ")
    assert sorted(path for path in Path().rglob("*") if path.is_file()) == sorted(
        [*before, *map(Path, summary["wrote"])]
    )


def _interrupted(*_: object, **__: object) -> None:
    raise KeyboardInterrupt


@pytest.mark.skipif(sys.platform == "win32", reason="no signal masks")
@pytest.mark.parametrize("module", ["calib.cli", "designer.cli"])
@pytest.mark.parametrize("option", [[], ["--json"]])
def test_ctrl_c_while_modules_load_ends_in_one_line(module: str, option: list[str]) -> None:
    """Whichever of them it meets: it waits until they are loaded, and nothing is done then."""
    script = (
        "import os, signal, sys\n"
        f"from {module} import main\n"
        "class Pressed:\n"
        "    def find_spec(self, name, *rest):\n"
        "        os.kill(os.getpid(), signal.SIGINT)\n"
        "sys.meta_path.insert(0, Pressed())\n"
        "main()\n"
    )
    done = run(PYTHON, "-c", script, "templates", *option, check=False)
    assert (done.returncode, done.stderr) == (130, "stopped; nothing was written\n")
    assert not option or json.loads(done.stdout)["exit_code"] == 130


def test_a_program_takes_ctrl_c_before_it_loads_anything() -> None:
    """Its entry loads so little that there is hardly a moment before."""
    for module in ("calib.cli", "designer.cli"):
        script = f"import sys; before = set(sys.modules); import {module}; print(*set(sys.modules) - before)"
        loaded = run(PYTHON, "-S", "-c", script).stdout.split()
        assert not {"typer", "typing", "re", "pathlib", "numpy"} & set(loaded), loaded


SOLVE_ALL = ("solve", "detections.csv", "--target", "board.target.json", "-o", "out")


@pytest.mark.parametrize(
    ("words", "kept"),
    [
        (("run", "board.target.json", "photos", "-o", "out"), "out/detections.csv, out/luhmann"),
        (SOLVE_ALL, "out/luhmann"),
    ],
)
def test_a_model_that_was_finished_before_ctrl_c_stays(
    words: tuple[str, ...], kept: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The document of a stopped command holds the answer so far, and its files, which are whole."""
    from calib.judge import solutions as solving

    original = solving.calibrate

    def stop_at_second(seen: object, model: str, *rest: object) -> object:
        if model == "opencv":
            raise KeyboardInterrupt
        return original(seen, model, *rest)  # type: ignore[arg-type]

    monkeypatch.setattr(solving, "calibrate", stop_at_second)
    summary = summary_of(calib(*words, "--json"))
    assert (summary["exit_code"], summary["error"]) == (130, f"stopped; finished and kept: {kept}")
    assert [one["model"] for one in summary["answer"]["models"]] == ["luhmann"]
    assert {str(path) for path in Path("out").rglob("*") if path.is_file()} == set(summary["wrote"])
    assert read_calibration(Path("out/luhmann/calibration.json"))[0].camera.model == "luhmann"


def test_what_a_run_had_before_its_figures_stays_too(monkeypatch: pytest.MonkeyPatch) -> None:
    """Ctrl-C while these are drawn takes no camera away."""
    monkeypatch.setattr("calib.draw.calibration_figures", _interrupted)
    answer = calib(*RUN, *LENIENT)
    assert (answer.code, answer.err) == (130, "stopped; finished and kept: out/detections.csv, out\n")
    assert Path("out/camera.json").exists()


@pytest.mark.parametrize("option", [[], ["--json"]])
def test_a_reader_may_leave(option: list[str], tmp_path: Path) -> None:
    """`calib ... | head -1`: no word of a broken pipe, the work goes on to its end, and its code is the program's."""
    script = (
        "import sys, typer; from pathlib import Path\n"
        "from designer.base.command import command, run; from designer.base.answer import Summary\n"
        "app = typer.Typer(name='toy')\n"
        "@command(app)\n"
        "def toy(word: str) -> Summary:\n"
        "    sys.stdin.readline()\n"
        "    for _ in range(20000): print('a line that nobody reads')\n"
        "    Path('done').touch()\n"
        "    return Summary({'long': 'x' * 200000}, exit_code=1)\n"
        "run(app)\n"
    )
    process = start(PYTHON, "-c", script, "word", *option, cwd=tmp_path)
    assert process.stdout is not None
    process.stdout.close()
    process.stdout = None
    _, said = process.communicate("go\n", timeout=WITHIN_S)
    assert process.returncode == 1
    assert set(said.splitlines()) <= {"a line that nobody reads"}
    assert (tmp_path / "done").exists()


ANSWERED = """
import os, shlex, sys
if sys.argv[1] == "closed":
    os.close(1)
    sys.stdout = sys.__stdout__ = None  # as Python has it then
from calib.cli import main
for line in sys.argv[2:]:
    sys.argv, code = ["calib", *shlex.split(line)], None
    try:
        main()
    except SystemExit as end:
        code = end.code
    assert code == 0, (line, code)
"""


@pytest.mark.parametrize("stdout", ["closed", "C"])
def test_a_command_runs_where_its_words_cannot_be_said(stdout: str) -> None:
    """Without standard output, or in a locale that has no `±` and no `°`, for which others stand: code and files stay.

    No file takes the number of a standard output that is closed: with `--json` it would be written over.
    """
    lines = (
        "triangulate pair.rig.json sightings.csv -o out", "convert camera.json --to opencv -o new.yml --json",
        f"solve detections.csv --target board.target.json --model pinhole -o out {shlex.join(LENIENT)}",
    )  # fmt: skip
    locale = {"LC_ALL": "C", "PYTHONUTF8": "0", "PYTHONCOERCECLOCALE": "0"}
    done = run(PYTHON, "-c", ANSWERED, stdout, *lines, check=False, **(locale if stdout == "C" else {}))
    assert done.returncode == 0, done.stderr
    assert (("+-" in done.stdout) and done.stdout.isascii()) == (stdout == "C")
    assert Path("out/camera.json").exists()
    assert Path("new.yml").exists()
