"""`calib` and `design` run in this process as a user runs them, and files to run them on."""

import base64
import csv
import io
import json
import sys
from collections.abc import Callable, Iterable, Mapping
from contextlib import redirect_stderr, redirect_stdout
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from calib.cli import main
from calib.core.types import Detections, Observations
from calib.observe.dataset import write_detections
from designer.base.arrays import Rows
from designer.target import TargetGeometry, target_to_json

SIGMA_PX = 0.02
LENIENT = ("--criteria", str(Path(__file__).with_name("lenient.toml")), "--no-page")
"""For `calib run` and `solve` where the verdict is not the subject: any camera that is determined ends with 0, and no
page is drawn, which takes seconds."""
PICTURE = base64.b64decode(
    "iVBORw0KGgoAAAANSUhEUgAAAAEAAAABCAAAAAA6fptVAAAACklEQVR4nGNoAAAAggCBd81ytgAAAABJRU5ErkJggg=="
)
"""Stands for one that is not drawn."""
BLOCKS = {"index.html", "page.json"}
JUDGED = {"verdict.json", "next_views.json"}
"""What the verdict leaves in a folder; `target.json` comes with a target file."""


@dataclass(frozen=True)
class Answer:
    """What a command left on the screen."""

    code: int
    out: str
    err: str


def instead(line: Iterable[object], more: Iterable[object]) -> list[object]:
    """A line with more words, whose options stand in the place of its own."""
    words, added = list(line), list(more)
    for option in (one for one in added if isinstance(one, str) and one.startswith("-") and one in words):
        place = words.index(option)
        takes_word = place + 1 < len(words) and not str(words[place + 1]).startswith("-")
        del words[place : place + 1 + takes_word]
    return [*words, *added]


def calib(*arguments: object) -> Answer:
    """Run a command; what leaves it but an exit code is a defect, and raised."""
    return program("calib", main, *arguments)


def design(*arguments: object) -> Answer:
    """The same of the other program."""
    from designer.cli import main as design_main

    return program("design", design_main, *arguments)


def program(name: str, start: Callable[[], None], *arguments: object) -> Answer:
    """Run a program by its entry point."""
    out, err = io.StringIO(), io.StringIO()
    with pytest.MonkeyPatch.context() as patch, redirect_stdout(out), redirect_stderr(err):
        patch.setattr(sys, "argv", [name, *map(str, arguments)])
        with pytest.raises(SystemExit) as end:
            start()
    assert isinstance(end.value.code, int)
    return Answer(end.value.code, out.getvalue(), err.getvalue())


ENVELOPE = (
    "format", "version", "command", "line", "program", "exit_code", "wrote", "next", "remarks", "error", "answer"
)  # fmt: skip


def summary_of(answer: Answer) -> dict[str, Any]:
    """The one JSON document on standard output, held to the rules that all have in common."""

    def refuse(constant: str) -> float:
        raise AssertionError(f"{constant} is no JSON")

    assert answer.out.endswith("}\n")
    document = json.loads(answer.out, parse_constant=refuse)
    assert tuple(document) == ENVELOPE
    assert (document["format"], document["version"]) == ("ringsolid.summary", 1)
    assert document["program"].startswith("ringsolid ")
    assert document["line"].startswith(document["command"])
    assert document["exit_code"] == answer.code
    assert (document["error"] is None) == (answer.code in (0, 1))
    assert isinstance(document["answer"], dict)
    assert all(Path(path).is_file() for path in document["wrote"]), document["wrote"]
    assert all(isinstance(one, str) for one in (*document["next"], *document["remarks"]))
    return document  # type: ignore[no-any-return]


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
        path.relative_to(folder).as_posix() for path in folder.rglob("*") if path.is_file() or not any(path.iterdir())
    }


def detections_of(seen: Observations, target: TargetGeometry) -> list[Detections]:
    """Observations of a target's rings as the detector would have returned them."""
    return [
        _detections(seen, target, name, np.flatnonzero(seen.view == view)) for view, name in enumerate(seen.view_names)
    ]


def _detections(seen: Observations, target: TargetGeometry, name: str, row: Rows) -> Detections:
    covariance = np.tile(SIGMA_PX**2 * np.eye(2), (len(row), 1, 1))
    return Detections(
        name, seen.image_size, target.layout_id, target.geometry_id, seen.point[row],
        target.center_mm[seen.point[row]], seen.center_px[row], covariance, np.zeros((len(row), 5)), (),
    )  # fmt: skip


def detector_of(found: Mapping[str, Detections], why: str = "nothing here") -> Callable[..., Detections]:
    """A detector that knows by a photo's name what it shows; others show nothing, and why."""

    def detect(pixels: NDArray[np.generic], _: TargetGeometry, *, name: str, **__: object) -> Detections:
        size, some = (pixels.shape[1], pixels.shape[0]), next(iter(found.values()))
        none = replace(some.keep(slice(0)), image_size=size, faces=(), remarks=(why,))
        return replace(found.get(Path(name).name, none), image=name)

    return detect


def write_inputs(seen: Observations, target: TargetGeometry) -> None:
    """`board.target.json` and `detections.csv` in the current folder."""
    Path("board.target.json").write_text(target_to_json(target))
    write_detections(Path("detections.csv"), detections_of(seen, target), target)


def write_correspondences(path: Path, seen: Observations, *, has_size: bool = True) -> list[str]:
    """A CSV with image,u,v,X,Y,Z as other programs write it; its lines."""
    lines = ["# image_size {} x {}".format(*seen.image_size)] if has_size else []
    lines.append("image,u,v,X,Y,Z")
    for view, point, pixel in zip(seen.view, seen.point, seen.center_px, strict=True):
        numbers = (*pixel.tolist(), *seen.points.position_mm[point].tolist())
        lines.append(",".join([seen.view_names[view], *map(repr, numbers)]))
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return lines


def rows_of_csv(path: Path) -> list[dict[str, str]]:
    """The rows of a table, without its comments."""
    with path.open(newline="") as stream:
        return list(csv.DictReader(line for line in stream if not line.startswith("#")))
