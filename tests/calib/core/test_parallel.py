import subprocess
from collections.abc import Iterator
from pathlib import Path

import pytest

from designer.kinds.board import BoardSpec
from designer.kinds.layout import lay_out
from designer.target import target_to_json
from tests.support.programs import PYTHON, group_is_alive, start
from tests.support.waiting import wait_until

BOARD = BoardSpec(
    size_mm=(60, 60), thickness_mm=5, columns=5, rows=5, lattice="square", ring_diameter_mm=7, ring_ratio=0.45,
    pitch_mm=10, border_mm=0, margin_mm=1, dots=True,
)  # fmt: skip


@pytest.fixture
def rendering(tmp_path: Path) -> Iterator[subprocess.Popen[str]]:
    """A program that renders with two processes, in a group of its own."""
    (tmp_path / "t.target.json").write_text(target_to_json(lay_out(BOARD)))
    words = ("render", "t.target.json", "-o", "p", "--views", 2000, "--jobs", 2, "--camera", "wide-webcam")
    program = start(
        PYTHON, "-m", "calib.cli", *words, cwd=tmp_path, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
    )
    wait_until(lambda: program.poll() is not None or any((tmp_path / "p").glob("*.png")))
    assert program.poll() is None
    yield program
    program.kill()
    program.wait()


def test_children_leave_with_their_parent(rendering: subprocess.Popen[str]) -> None:
    """Where a program is killed, the processes that it started leave soon after, and do not linger for ever."""
    rendering.kill()
    rendering.wait()
    wait_until(lambda: not group_is_alive(rendering.pid))
