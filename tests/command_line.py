"""`calib` run in this process as a user runs it, and files to run it on."""

import io
import sys
from contextlib import redirect_stderr, redirect_stdout
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from calib.cli import main
from calib.inputs.dataset import write_detections
from calib.types import Detections, Observations
from designer.target import TargetGeometry, target_to_json

SIGMA_PX = 0.02


@dataclass(frozen=True)
class Answer:
    """What a command left on the screen."""

    code: int
    out: str
    err: str


def calib(*arguments: object) -> Answer:
    """Run a command; what leaves it but an exit code is a defect, and raised."""
    out, err = io.StringIO(), io.StringIO()
    with pytest.MonkeyPatch.context() as patch, redirect_stdout(out), redirect_stderr(err):
        patch.setattr(sys, "argv", ["calib", *map(str, arguments)])
        with pytest.raises(SystemExit) as end:
            main()
    assert isinstance(end.value.code, int)
    return Answer(end.value.code, out.getvalue(), err.getvalue())


def refused(*arguments: object) -> str:
    """Run a command that must end in one line on standard error and exit code 2; return that line."""
    answer = calib(*arguments)
    assert answer.code == 2, answer
    assert answer.err.startswith("error: ")
    assert answer.err.count("\n") == 1
    return answer.err


def files_in(folder: Path) -> set[str]:
    """All files and empty folders below a folder, hidden ones too."""
    return {
        path.relative_to(folder).as_posix()
        for path in folder.rglob("*")
        if path.is_file() or not any(path.iterdir())
    }  # fmt: skip


def detections_of(seen: Observations, target: TargetGeometry) -> list[Detections]:
    """Observations of a target's rings as the detector would have returned them."""
    return [
        _detections(seen, target, name, np.flatnonzero(seen.view == view)) for view, name in enumerate(seen.view_names)
    ]


def _detections(seen: Observations, target: TargetGeometry, name: str, row: NDArray[np.int64]) -> Detections:
    covariance = np.tile(SIGMA_PX**2 * np.eye(2), (len(row), 1, 1))
    return Detections(
        name, seen.image_size, target.layout_id, target.geometry_id, seen.point[row], seen.center_px[row], covariance,
        np.zeros((len(row), 5)), (),
    )  # fmt: skip


def write_inputs(seen: Observations, target: TargetGeometry) -> None:
    """`board.target.json` and `detections.csv` in the current folder."""
    Path("board.target.json").write_text(target_to_json(target))
    write_detections(Path("detections.csv"), detections_of(seen, target), target, detector="test")
