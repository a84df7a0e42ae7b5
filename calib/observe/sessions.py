"""Which photos are of one session, between which a focal length may change: those of a folder, or as a table says."""

from collections.abc import Mapping
from dataclasses import replace
from os import PathLike
from pathlib import Path

from calib.core.csv_table import column_fault, read_table, read_text
from calib.solver.plan import SolvePlan
from designer.base.errors import InputError
from designer.base.words import shown

COLUMNS = ("file", "session")
FEWEST = 2


def with_sessions(
    plan: SolvePlan, told: Mapping[str, str] | str | PathLike[str] | None, folder: Mapping[str, str]
) -> SolvePlan:
    """The plan with the session of each photo, if something varies between sessions.

    Args:
        plan: what to solve, and how.
        told: sessions by the photos' names, or a table; None: photos of a folder are of one.
        folder: of each photo, by its name.

    Raises:
        InputError: a photo of no session, fewer than two sessions, or sessions between which nothing varies.
    """
    if not plan.options.vary:
        if told is not None:
            raise InputError("--sessions: say with --vary what differs between them, as in --vary focal")
        return plan
    if told is None:
        short = {name: Path(one).name for name, one in folder.items()}
        of = short if len(set(short.values())) == len(set(folder.values())) else folder
    else:
        of = told if isinstance(told, Mapping) else _read(Path(told))
    found = []
    for name in folder:
        session = of.get(name, of.get(Path(name).name))
        if session is None:
            raise InputError(f"--sessions: says no session of {shown(name)}; add a line for it, or leave the photo out")
        found.append((name, session))
    if len({session for _, session in found}) < FEWEST:
        raise InputError(
            f"--vary: all photos are of session {shown(found[0][1])}; give folders of {FEWEST} or more, or a table "
            "file,session with --sessions"
        )
    return replace(plan, options=replace(plan.options, sessions=tuple(found)))


def _read(path: Path) -> dict[str, str]:
    wanted = f"the columns must be {','.join(COLUMNS)}"
    table = read_table(
        path, read_text(path, "a table of sessions"), lambda names: column_fault(names, COLUMNS, wanted), holds="photos"
    )
    table.require_filled(*COLUMNS)
    return dict(zip(table.cells["file"], table.cells["session"], strict=True))
