"""What a command loads: nothing that it does not use, so that help comes at once and everyday work without a wait."""

import os
import subprocess
import sys
from pathlib import Path

import cv2
import numpy as np
import pytest

from calib.cameras.camera import camera_to_json
from designer.target import target_to_json
from tests.support.programs import modules_loaded_by
from tests.support.ring_views import CAMERA, board, view_of

ROOT = Path(__file__).parents[2]
ASKED = """
import importlib, io, os, sys
from contextlib import redirect_stdout, suppress
import typer
from typer.core import TyperGroup

program, heavy = sys.argv[1], set(sys.argv[3:])
cli = importlib.import_module(sys.argv[2])

def commands(group, words):
    for name, one in group.commands.items():
        yield (*words, name), isinstance(one, TyperGroup)
        if isinstance(one, TyperGroup):
            yield from commands(one, (*words, name))

def told(words, asked):
    sys.argv, heard = [program, *words], io.StringIO()
    os.environ.update(asked)
    with redirect_stdout(heard), suppress(SystemExit):
        cli.main()
    for name in asked:
        del os.environ[name]
    assert not heavy & set(sys.modules), (words, asked, heavy & set(sys.modules))
    return heard.getvalue()

for words, is_group in [((), True), *commands(typer.main.get_command(cli.app()), ())]:
    pressed = {"COMP_WORDS": " ".join([program, *words, "--"]), "COMP_CWORD": str(len(words) + 1)}
    for said in told((*words, "--help"), {}), told((), {f"_{program.upper()}_COMPLETE": "complete_bash", **pressed}):
        assert "--help" in said and (is_group or "--json" in said), (words, said)
"""
RUN = """
import shlex, sys
from calib import cli

heavy = set(sys.argv[1].split(","))
for line in sys.argv[2:]:
    sys.argv, code = ["calib", *shlex.split(line)], None
    try:
        cli.main()
    except SystemExit as end:
        code = end.code
    assert code in (0, 1), (line, code)
    assert not heavy & set(sys.modules), (line, heavy & set(sys.modules))
"""


def python(code: str, *words: object, folder: Path = ROOT) -> None:
    """Run a program that ends well."""
    run = subprocess.run(
        [sys.executable, "-c", code, *map(str, words)], capture_output=True, text=True, check=False, timeout=300,
        cwd=folder, env={**os.environ, "PYTHONPATH": str(ROOT)},
    )  # fmt: skip
    assert run.returncode == 0, run.stderr


@pytest.mark.parametrize(("program", "module"), [("design", "designer.cli"), ("calib", "calib.cli")])
def test_help_and_completion_load_no_numbers(program: str, module: str) -> None:
    """Of every command: it is told by its function's signature, and what that does is loaded when it is called."""
    python(ASKED, program, module, "numpy", "numba", "scipy", "cv2", "matplotlib", "build123d", "rosbags")


PICTURES = "scipy.spatial,scipy.sparse,scipy.optimize,scipy.stats,matplotlib,sklearn,joblib,pandas,jinja2,rosbags"


def test_everyday_commands_load_what_they_use(scene: Path, tmp_path: Path) -> None:
    """What reads photos, solves, converts or triangulates waits for no rigs, pictures, tables or trees of points."""
    (tmp_path / "target.json").write_text(target_to_json(board()))
    (tmp_path / "camera.json").write_text(camera_to_json(CAMERA))
    cv2.imwrite(str(tmp_path / "photo.png"), np.asarray(view_of(board(), 1).image))
    python(
        RUN, f"calib.rigs,calib.solver.solve_virtual,{PICTURES}",
        "convert camera.json --to opencv -o camera.yaml",
        f"triangulate {scene}/pair.rig.json {scene}/sightings.csv -o points.csv",
        "detect target.json photo.png -o photo.csv", "pose target.json camera.json photo.png -o poses.json",
        f"solve {scene}/detections.csv --target {scene}/board.target.json --model opencv --no-page -o solved",
        folder=tmp_path,
    )  # fmt: skip


def test_predictions_load_no_splines() -> None:
    """What is foretold of prints and cameras waits for no interpolation, which only moving targets and cells take."""
    loaded = modules_loaded_by("import calib.studies.tolerance.explore, calib.studies.tolerance.forecast")
    assert not {"scipy.interpolate", "scipy.stats", "matplotlib"} & loaded
