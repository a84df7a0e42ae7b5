"""The page of a folder of results, written again from what the folder stores: `calib report`."""

from collections.abc import Collection
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from designer.base.errors import InputError
from designer.base.options import argument, option
from designer.base.words import printable
from designer.kinds.presets import criteria_templates
from designer.page.capability import capability
from designer.page.result import Result
from designer.page.terminal import quoted

if TYPE_CHECKING:
    from designer.base.answer import Value
    from designer.page.blocks import Page
    from designer.page.output import Output


@dataclass(frozen=True, eq=False)
class Report(Result, kind="report", title="Report", doing="drawing"):
    """A folder's page: `report(Path("camera")).drawn.headline`."""

    of: str  # kind of the folder's results
    drawn: "Page"
    place: Path  # of the page
    verdict: Path | None = None  # that was written, as other limits were asked for
    can_be_judged: bool = False  # a calibration or a rig without a verdict
    remarks: tuple[str, ...] = ()

    def page(self) -> "Page":
        """Its headline, and how to have it judged."""
        from designer.page.blocks import Command, Page

        judge = Command(f"calib report {quoted(self.place.parent)} --criteria standard", "says whether it is good")
        return Page("", "", self.drawn.headline, (), next_steps=(judge,) if self.can_be_judged else ())

    def draw_page(self, folder: Path, command: str = "") -> "tuple[Page | None, tuple[Path, ...], str]":
        """Nothing more: it is drawn."""
        return None, (), ""

    @property
    def is_negative(self) -> bool:
        """What the page says."""
        return self.drawn.is_negative or (self.drawn.headline is not None and self.drawn.headline.level == "bad")

    def answer(self) -> "dict[str, Value]":
        """The page's headline and sections."""
        headline = self.drawn.headline
        return {
            "kind": self.of, "title": self.drawn.title, "level": None if headline is None else headline.level,
            "word": None if headline is None else headline.word,
            "sentence": None if headline is None else headline.sentence,
            "sections": [section.title for section in self.drawn.sections],
        }  # fmt: skip


@capability
def report(
    folder: Annotated[
        Path, argument("folder of calib run, rig, solve, measure or study, or of design tolerance", metavar="DIR")
    ],
    *,
    criteria: Annotated[
        str | None,
        option(
            "judge a calibration or a rig by other limits: a template (standard, metrology, robotics) or a TOML file "
            "of one's own",
            metavar="NAME|FILE",
            complete=criteria_templates,
        ),
    ] = None,
    kinds: Collection[str] = (),
    out: "Output | None" = None,
) -> Report:
    """Write a folder's page, index.html, again from the results it stores: `report(Path("camera"))`.

    A calibration or a rig keeps its verdict, unless other limits are given. The exit code is 1 if the page's answer is
    negative, such as: do not use.

    Args:
        kinds: of results that were drawn again: the page of another kind, and somebody's own, stays as it is; (): any.
        out: is told what is written.

    Raises:
        InputError: nothing to report, limits of what is no calibration, or a page that stays; the message says why.
    """
    from calib.judge.folders import kind_in
    from designer.page.page_file import BLOCKS_FILE, PAGE, why_no_page

    folder = Path(folder)
    has_blocks = (folder / BLOCKS_FILE).is_file()
    kind = kind_in(folder)
    why = why_no_page(folder, kind, *(("detections",) if kind == "calibration" else ())) if kind else ""
    if kind and not why:
        _require_kind(folder, kind, kinds)
        before = PAGE.keys(folder / BLOCKS_FILE).get("page") if has_blocks else None
        done = _judged(folder, kind, criteria, str(before.get("made_by", "")) if isinstance(before, dict) else "")
    elif has_blocks:
        stored = PAGE.read(folder / BLOCKS_FILE)
        done = _from_blocks(folder, stored.kind, stored.page, criteria, kinds)
    elif why:
        raise InputError(f"{why}; move it away to have one written")
    else:
        raise _nothing_in(folder)
    if out is not None:
        out.place, out.page = folder, folder
        out.files += [*(() if done.verdict is None else (done.verdict,)), done.place]
    return done


def _judged(folder: Path, kind: str, criteria: str | None, command: str) -> Report:
    """Of cameras, which are read again: what lies beside them may have changed."""
    from calib.app.calibration import Run
    from calib.app.solved_rig import SolvedRig
    from calib.judge.checks import read_criteria
    from calib.judge.folders import RigRun, judge_again, read_solved
    from calib.judge.judge import VERDICT_FILE

    if criteria is not None:
        judge_again(folder, read_criteria(criteria))
    run = read_solved(folder)
    found = SolvedRig(run) if isinstance(run, RigRun) else Run(run, place=folder)
    page, files, remark = found.draw_page(folder, command)
    if page is None:
        raise InputError(remark)
    return Report(kind, page, files[-1], None if criteria is None else folder / VERDICT_FILE, run.judged is None)


def _from_blocks(folder: Path, kind: str, page: "Page", criteria: str | None, kinds: Collection[str]) -> Report:
    """Of a folder that holds the page's blocks."""
    from designer.base.files import write_files
    from designer.page.page_file import PAGE_FILE
    from designer.page.shell import page_html

    if criteria is not None:
        raise InputError(
            f"--criteria: limits are for calibrations and rigs, and {folder} holds another kind: {printable(kind)}"
        )
    _require_kind(folder, kind, kinds)
    write_files({folder / PAGE_FILE: page_html(page)})
    return Report(kind, page, folder / PAGE_FILE)


def _nothing_in(folder: Path) -> InputError:
    """Why there is no page of a folder, and what to do."""
    from calib.draw.gallery import OVERLAYS
    from calib.renderer.options import TRUTH_FILE
    from designer.page.page_file import BLOCKS_FILE

    wrote = "give a folder that calib run, calib measure, calib study or design tolerance wrote"
    if not folder.is_dir():
        return InputError(f"{folder}: {'is a file, not a folder' if folder.exists() else 'no such folder'}; {wrote}")
    if any(folder.glob("*.target.json")):
        name = next((path.name for path in sorted(folder.glob("*.toml"))), "NAME.toml")
        return InputError(f"{folder}: is a design's folder: design make {name} -o {folder} writes its page")
    if (folder / TRUTH_FILE).is_file():
        return InputError(f"{folder}: holds rendered photos without a page: the same calib render again writes it")
    if (folder / OVERLAYS / BLOCKS_FILE).is_file():
        return InputError(
            f"{folder}: holds no camera, only what was found in photos: calib report {folder / OVERLAYS} writes "
            "its page"
        )
    return InputError(f"{folder}: holds nothing to report; {wrote}")


def _require_kind(folder: Path, kind: str, kinds: Collection[str]) -> None:
    """Refuse to draw the page of another kind than those that were asked for; of (), any is."""
    from designer.page.page_file import PAGE_FILE

    if kinds and kind not in kinds:
        what = printable(kind)
        raise InputError(f"{folder / PAGE_FILE}: stays as it is, the page of what is in this folder otherwise ({what})")
