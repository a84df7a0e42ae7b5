"""The page of a folder of results, built again from what the folder stores: what `calib report` does."""

from collections.abc import Collection
from dataclasses import dataclass
from pathlib import Path

from calib.show.folder import build_page, origin_in, why_no_page, write_page
from designer.base.errors import InputError
from designer.base.files import write_files
from designer.base.words import printable
from designer.page.blocks import Page
from designer.page.page_file import BLOCKS_FILE, PAGE, PAGE_FILE

CALIBRATION, RIG = "calibration", "rig"
VERDICTS = {CALIBRATION: "verdict.json", RIG: "rig_verdict.json"}
"""Kinds of results that are judged, and the file that keeps what came of it."""


@dataclass(frozen=True, eq=False)
class Reported:
    """A folder's page."""

    kind: str  # of the folder's results
    page: Page
    place: Path  # of the page
    verdict: Path | None = None  # that was written, as other limits were asked for
    can_be_judged: bool = False  # a calibration or a rig without a verdict


def report(folder: Path, *, criteria: str | None = None, kinds: Collection[str] = ()) -> Reported:
    """Write a folder's page again: `report(Path("camera")).page.headline`.

    Args:
        folder: of results.
        criteria: to judge a calibration or a rig by other limits: a template, or a file.
        kinds: of results that were drawn again: the page of another kind, and somebody's own, stays as it is; (): any.

    Raises:
        InputError: nothing to report, limits of what is no calibration, or a page that stays; the message says why.
    """
    if (folder / BLOCKS_FILE).is_file():
        return _from_blocks(folder, criteria, kinds)
    origin = origin_in(folder)
    kind = origin.kind if not kinds or origin.kind in kinds else next(iter(kinds))
    if why := why_no_page(folder, kind):
        raise InputError(f"{why}; move it away to have one written")
    if criteria is not None:
        if origin.kind not in VERDICTS:
            what = printable(origin.kind)
            raise InputError(
                f"--criteria: limits are for calibrations and rigs, and {folder} holds another kind: {what}"
            )
        _judge_again(folder, origin.kind, criteria)
    page = build_page(folder, origin)
    place = write_page(folder, origin, page)[1]
    verdict = folder / VERDICTS.get(origin.kind, VERDICTS[CALIBRATION])
    return Reported(
        origin.kind, page, place, None if criteria is None else verdict,
        can_be_judged=origin.kind in VERDICTS and not verdict.exists(),
    )  # fmt: skip


def _from_blocks(folder: Path, criteria: str | None, kinds: Collection[str]) -> Reported:
    """The page of a folder that holds its blocks."""
    from designer.page.shell import page_html

    stored = PAGE.read(folder / BLOCKS_FILE)
    if criteria is not None or (kinds and stored.kind not in kinds):
        what = printable(stored.kind)
        raise InputError(
            f"--criteria: limits are for calibrations and rigs, and {folder} holds another kind: {what}"
            if criteria is not None
            else f"{folder / PAGE_FILE}: stays as it is, the page of what is in this folder otherwise ({what})"
        )
    write_files({folder / PAGE_FILE: page_html(stored.page)})
    return Reported(stored.kind, stored.page, folder / PAGE_FILE)


def _judge_again(folder: Path, kind: str, criteria: str) -> None:
    """Judge what a folder holds by other limits."""
    from calib.records.rig_folder import judge_rig_again
    from calib.records.run_folder import judge_again
    from calib.verdict.criteria import read_criteria, read_rig_criteria

    if kind == RIG:
        judge_rig_again(folder, read_rig_criteria(criteria))
    else:
        judge_again(folder, read_criteria(criteria))
