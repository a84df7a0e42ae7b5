"""What tests of `calib study` share: a small set of photos, runs, and what they leave."""

import csv
import io
import sqlite3
import subprocess
from collections.abc import Collection
from pathlib import Path

import cv2
import numpy as np
import pytest

from calib.renderer.job import RenderJob, truth_text
from calib.renderer.options import RenderOptions
from tests.support import programs
from tests.support.calibrations import board, example
from tests.support.command_line import Answer, calib, files_in, write_inputs
from tests.support.programs import PYTHON
from tests.support.waiting import wait_until

BOARD = board()
TRUE = example(BOARD, np.random.default_rng(8), views=14, noise_px=0.05)
SEEN = TRUE.observations
TABLES = ("table.csv", "bootstrap.json", "table.md")
TAKEN = ("study", "bootstrap", "--target", "board.target.json", "--detections", "detections.csv")
COLUMN = {"reprojection": 4, "intersection": 5, "reconstruction": 6, "pose": 7}
PARAMS = 8
"""Places in a row of a study file."""


def work_in(folder: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Make it the folder to work in, with a target, detections and their truth."""
    monkeypatch.chdir(folder)
    write_inputs(SEEN, BOARD)
    Path("truth.json").write_text(truth_text(RenderJob(BOARD, TRUE.camera, TRUE.cam_from_target, RenderOptions(), 0)))
    return folder


def without_pictures(monkeypatch: pytest.MonkeyPatch) -> None:
    """Name pictures, but do not draw them, which takes longer than all else."""
    monkeypatch.setattr("calib.draw.style.sheet_files", nothing_drawn)


def nothing_drawn(name: str, height_px: int, draw: object, suffixes: Collection[str]) -> dict[str, bytes]:
    """The formats of a figure, of a few pixels each."""
    dot = np.zeros((2, 2), np.uint8)
    svg = b'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 9 9"><path d="M0 0h9"/></svg>'
    drawn = {"png": cv2.imencode(".png", dot)[1].tobytes(), "pdf": b"%PDF-1.4 nothing\n", "svg": svg}
    return {suffix: content for suffix, content in drawn.items() if suffix in {"png", *suffixes}}


def bootstrap(*options: object, out: str = "out", sizes: str = "6", samples: int = 8) -> Answer:
    """Run a bootstrap that must go well."""
    answer = calib(*TAKEN, "--sizes", sizes, "--samples", samples, "--jobs", 1, "-o", out, *options)
    assert (answer.code, answer.err) == (0, ""), answer
    return answer


def rows_of(path: str | Path = "out/study.sqlite") -> list[tuple[object, ...]]:
    """All samples of a study file, by case and number."""
    connection = sqlite3.connect(path)
    rows = connection.execute('SELECT * FROM sample ORDER BY "case", number').fetchall()
    connection.close()
    return rows


def edit(statement: str, *values: object, path: str = "out/study.sqlite") -> None:
    """Change a study file by hand."""
    connection = sqlite3.connect(path)
    connection.execute(statement, values)
    connection.commit()
    connection.close()


def contents(place: str | Path) -> dict[str, bytes]:
    """All files of a folder, but for the two that SQLite may keep beside its own."""
    return {
        name: Path(place, name).read_bytes()
        for name in sorted(files_in(Path(place)))
        if Path(place, name).is_file() and not name.endswith(("-wal", "-shm"))
    }


def tables(place: str = "out") -> dict[str, bytes]:
    """The tables of a study."""
    return {name: Path(place, name).read_bytes() for name in TABLES}


def table_lines(place: str = "out") -> list[dict[str, str]]:
    """The lines of the table for other programs."""
    return list(csv.DictReader(io.StringIO(Path(place, "table.csv").read_text())))


def start(*options: object) -> subprocess.Popen[str]:
    """A bootstrap in a program of its own."""
    return programs.start(PYTHON, "-m", "calib.cli", *TAKEN, "--jobs", 1, "-o", "out", *options)


def wait_for_samples(process: subprocess.Popen[str], least: int) -> None:
    """Wait until a running study has kept some samples."""

    def kept() -> int:
        try:
            connection = sqlite3.connect("file:out/study.sqlite?mode=ro", uri=True)
            (count,) = connection.execute("SELECT count(*) FROM sample").fetchone()
            connection.close()
        except sqlite3.Error:
            return 0
        return int(count)

    wait_until(lambda: process.poll() is not None or kept() >= least)
    assert process.poll() is None, process.communicate()
