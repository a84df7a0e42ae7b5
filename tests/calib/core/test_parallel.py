import os
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from designer.kinds.board import BoardSpec
from designer.kinds.layout import lay_out
from designer.target import target_to_json

BOARD = BoardSpec(
    size_mm=(60, 60), thickness_mm=5, columns=5, rows=5, lattice="square", ring_diameter_mm=7, ring_ratio=0.45,
    pitch_mm=10, border_mm=0, margin_mm=1, dots=True,
)  # fmt: skip


@pytest.fixture
def rendering(tmp_path: Path) -> Iterator[subprocess.Popen[bytes]]:
    """A program that renders with two processes, in a group of its own."""
    (tmp_path / "t.target.json").write_text(target_to_json(lay_out(BOARD)))
    command = [sys.executable, "-m", "calib.cli", "render", str(tmp_path / "t.target.json"), "-o", str(tmp_path / "p"),
               "--views", "2000", "--jobs", "2", "--camera", "wide-webcam"]  # fmt: skip
    program = subprocess.Popen(command, start_new_session=True, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    end = time.monotonic() + 60
    while not any((tmp_path / "p").glob("*.png")):
        assert program.poll() is None
        assert time.monotonic() < end
        time.sleep(0.02)
    yield program
    program.kill()
    program.wait()


def test_children_leave_with_their_parent(rendering: subprocess.Popen[bytes]) -> None:
    """Where a program is killed, the processes that it started leave soon after, and do not linger for ever."""
    rendering.kill()
    rendering.wait()
    end = time.monotonic() + 30
    while True:
        try:
            os.killpg(rendering.pid, 0)
        except ProcessLookupError:
            return
        assert time.monotonic() < end
        time.sleep(0.05)
