"""The checks of cameras over days: a table in a folder, and how it is drawn."""

import contextlib
import os
import time
from collections.abc import Iterator
from dataclasses import dataclass
from datetime import UTC, datetime
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from calib.core.csv_table import column_fault, csv_bytes, csv_cell, read_table, read_text, require_version
from designer.base.errors import InputError
from designer.base.files import check_folder, write_files
from designer.base.own_files import require_ours
from designer.base.words import NAME, printable

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from calib.app.check import CameraCheck
    from designer.page.blocks import Figure

HISTORY_FILE, LOCK_FILE = "history.csv", ".history-is-written"
FIRST_LINE = "# ringsolid check-history, version 1"
NUMBERS = ("focal_percent", "turn_deg", "shift_mm", "center_px")
WHAT = ("focal length", "turn", "shift", "principal point")
COLUMNS = ("time", "checked", "verdict", "p", "photos", "camera", *(f"{s}{one}" for one in NUMBERS for s in ("", "s")))
KIND = "a table of checks"
LONGEST_WAIT_S, STEP_S = 10.0, 0.05
"""For another check that writes into the same table; then it is taken to have died."""


@dataclass(frozen=True)
class PastCheck:
    """What one check said of one camera."""

    time: str  # UTC
    checked: str
    verdict: str
    p: float
    photos: int
    camera: str
    changes: tuple[float, ...]  # in the order of `NUMBERS`, each with its standard deviation; nan: not told


def history_in(folder: Path) -> tuple[PastCheck, ...]:
    """The checks of a folder; none of one that has none yet.

    Raises:
        InputError: the folder takes no files, or its table is somebody else's, or damaged.
    """
    check_folder(folder)
    path = folder / HISTORY_FILE
    require_ours(path, kind=f"{NAME}.check-history")
    if not path.exists():
        return ()
    text = read_text(path, KIND)
    require_version(path, text.split("\n", 1)[0], FIRST_LINE, "keep it under another name, and begin anew")
    table = read_table(path, text, lambda names: column_fault(names, COLUMNS, f"the columns are {','.join(COLUMNS)}"))
    texts = [table.cells[name] for name in COLUMNS]
    try:
        for when in texts[0]:
            datetime.fromisoformat(when)
        return tuple(
            PastCheck(row[0], row[1], row[2], float(row[3] or "nan"), int(row[4]), row[5],
                      tuple(float(cell or "nan") for cell in row[6:]))
            for row in zip(*texts, strict=True)
        )  # fmt: skip
    except ValueError:
        raise InputError(
            f"{path}: a cell is no number or no time (2026-01-31T12:00:00Z); mend it, or keep it under another name"
        ) from None


def added(folder: Path, found: "CameraCheck") -> tuple[PastCheck, ...]:
    """Add a check to the table of a folder, which is replaced as a whole; all of the same file, this one too."""
    head = (datetime.now(UTC).strftime("%Y-%m-%dT%H:%M:%SZ"), found.checked, found.verdict, found.p, len(found.photos))
    of = {(one.camera, one.what): (one.size, one.size_sigma) for one in found.changes}
    unknown = (float("nan"), float("nan"))
    new = [
        PastCheck(*head, name, tuple(number for what in WHAT for number in of.get((name, what), unknown)))
        for name in dict.fromkeys(one.camera for one in found.changes) or ("",)
    ]
    folder.mkdir(parents=True, exist_ok=True)
    with _alone(folder):
        every = (*history_in(folder), *new)
        rows = (
            (one.time, csv_cell(one.checked), one.verdict, _number(one.p), str(one.photos), csv_cell(one.camera),
             *map(_number, one.changes))
            for one in every
        )  # fmt: skip
        write_files({folder / HISTORY_FILE: csv_bytes((FIRST_LINE,), COLUMNS, rows)})
    return tuple(one for one in every if one.checked == found.checked)


def _number(value: float) -> str:
    return repr(float(value)) if np.isfinite(value) else ""


@contextlib.contextmanager
def _alone(folder: Path) -> Iterator[None]:
    """Hold the table against another check that ends at the same moment."""
    lock, end = folder / LOCK_FILE, time.monotonic() + LONGEST_WAIT_S
    while True:
        try:
            os.close(os.open(lock, os.O_CREAT | os.O_EXCL | os.O_WRONLY))
            break
        except FileExistsError:
            if time.monotonic() > end:
                break
            time.sleep(STEP_S)
        except OSError as error:
            raise InputError(f"{folder}: cannot be written: {error.strerror}; choose another with --history") from None
    try:
        yield
    finally:
        lock.unlink(missing_ok=True)


def history_figures(history: tuple[PastCheck, ...]) -> "list[Figure]":
    """How focal lengths and turns went over days; none of less than two checks."""
    from calib.draw.style import AxesDrawing, figure_of

    figures = list["Figure"]()
    for column, unit in ((0, "%"), (1, "deg")):
        shown = [one for one in history if np.isfinite(one.changes[2 * column])]
        if (count := len({one.time for one in shown})) < 2:
            continue
        last = [
            f"{printable(one.camera)} {one.changes[2 * column]:+.2g} {unit}"
            for one in shown
            if one.time == shown[-1].time
        ]
        title = f"{WHAT[column].capitalize()} over time, change in {unit}"
        drawing = AxesDrawing(
            title,
            f"{count} checks, the last: {', '.join(last)}; bars of 2 sigma, crosses: no",
            partial(_draw, shown, column),
        )
        figures.append(figure_of(drawing))
    return figures


def _draw(history: list[PastCheck], column: int, axes: "Axes") -> None:
    """A line a camera, with bars of two standard deviations; crosses where the answer was no."""
    from matplotlib.dates import AutoDateLocator, ConciseDateFormatter, date2num

    from calib.draw.style import BLUE, GREEN, ORANGE, VERMILION, open_axes

    open_axes(axes, "time (UTC)", "")
    for k, camera in enumerate(dict.fromkeys(one.camera for one in history)):
        own = sorted((one for one in history if one.camera == camera), key=lambda one: one.time)  # a clock may go back
        when = np.array([date2num(datetime.fromisoformat(one.time)) for one in own])  # type: ignore[no-untyped-call]
        values, sigma = np.array([one.changes[2 * column : 2 * column + 2] for one in own]).T
        axes.errorbar(when, values, 2 * sigma, fmt="o-", color=(BLUE, ORANGE, GREEN)[k % 3], capsize=3, label=camera)
        is_no = np.array([one.verdict == "no" for one in own])
        axes.plot(when[is_no], values[is_no], "x", color=VERMILION, markersize=10, markeredgewidth=2)
    locator = AutoDateLocator()  # type: ignore[no-untyped-call]
    axes.xaxis.set_major_locator(locator)
    axes.xaxis.set_major_formatter(ConciseDateFormatter(locator))  # type: ignore[no-untyped-call]
    axes.axhline(0, color="0.6", linewidth=0.8)
    if len(axes.get_legend_handles_labels()[0]) > 1:
        axes.legend(loc="best")
