"""What a capability gives: a result that tells itself once, for the screen, the page, files and programs alike.

    @dataclass(frozen=True, eq=False)
    class Budget(Result, kind="budget", title="Budget", files={"grid.csv": "each point with its covariance"}): ...

Every number that is told is a field. `page()` says how, in blocks; `tables()` gives what is too much for a page.
"""

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import replace
from html import escape
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar, Self, cast

from designer.base.codec import encode_written
from designer.base.errors import InputError, NotWrittenError
from designer.base.file_kind import laid_out
from designer.base.files import check_folder, place_of, write_files
from designer.base.own_files import require_ours
from designer.base.words import NAME, printable
from designer.page.output import Output, output_of
from designer.page.progress import Progress

if TYPE_CHECKING:
    from designer.base.answer import Value
    from designer.base.files import JsonValue
    from designer.page.blocks import Page


class Result(ABC):
    """What came of a capability; a notebook shows its page.

    A field marked NOT_IN_FILE is Python's and the page's alone; what is large goes into `tables()`.
    """

    kind: ClassVar[str]
    """In files' formats and of the folder that a command writes unless it is told another."""
    title: ClassVar[str]
    """Of its pages."""
    doing: ClassVar[str]
    """What a command says meanwhile."""
    sought: ClassVar[str]
    """What there is none of, in a line such as "no camera is determined: ...", if there is no result."""
    files: ClassVar[Mapping[str, str]]
    """The tables, and what they are for."""
    alone: ClassVar[str]
    """The table that is written by itself where a path ends as its name does; "": none is."""
    is_written: ClassVar[bool]
    """Whether a command writes it into a folder, with its page; else a screen tells all, and files are by `out`."""
    replaces: ClassVar[tuple[str, ...]]
    """Kinds of pages that give way to its own."""
    remarks: tuple[str, ...]

    def __init_subclass__(
        cls, *, kind: str, title: str, doing: str = "", sought: str = "", files: Mapping[str, str] | None = None,
        alone: str = "", is_written: bool = True, replaces: tuple[str, ...] = (),
    ) -> None:  # fmt: skip
        super().__init_subclass__()
        cls.kind, cls.title, cls.doing, cls.sought, cls.files = kind, title, doing, sought, files or {}
        cls.alone, cls.is_written, cls.replaces = alone, is_written, replaces

    @abstractmethod
    def page(self) -> "Page":
        """All that is told, in blocks; what is known of the folder alone is added where it is written."""

    def page_beside(self, folder: Path) -> "Page":
        """The page with what it shows of the folder's other files, such as pictures."""
        return self.page()

    def words(self, page: "Page | None" = None) -> "Page":
        """What a screen says of it; overridden where that is another choice, and comes sooner than all figures.

        Args:
            page: as it was drawn; None: it was not.
        """
        return page or self.page()

    def tables(self) -> Mapping[str, bytes]:
        """Files beside `KIND.json`, by their names in `files`."""
        return {}

    @property
    def is_negative(self) -> bool:
        """Whether the answer is no: exit code 1."""
        return False

    @property
    def remedy(self) -> str:
        """What to do before the same command is given again, as in "take more photos"; "" if nothing is wrong."""
        return ""

    def document(self) -> dict[str, "JsonValue"]:
        """Its fields, for programs: what `KIND.json` and `--json` hold."""
        return encode_written(self)

    def answer(self) -> "dict[str, Value]":
        """As `document`, for `--json`."""
        return cast("dict[str, Value]", self.document())

    def purposes(self, folder: Path) -> tuple[tuple[str, str], ...]:
        """Files that the page lists, by their paths from its folder, and what they are for."""
        return (*self.files.items(), (f"{self.kind}.json", "the numbers, for programs"))

    @classmethod
    def check(cls, folder: Path) -> None:
        """Refuse a folder, or the place of a table, that takes no such result, before any work is done.

        Raises:
            InputError: the message names it.
        """
        if cls.is_table(folder):
            check_folder(folder.parent)
            require_ours(folder)
            return
        check_folder(folder)
        require_ours(folder / f"{cls.kind}.json", kind=f"{NAME}.{cls.kind}")
        for name in cls.files:
            if not name.endswith(".sqlite"):  # the samples of a study are asked where they are opened
                require_ours(folder / name)

    @classmethod
    def begun(cls, out: Output | str | PathLike[str] | None) -> Output | None:
        """The folder that it is written to as it is made; None: none is. InputError: it takes no such result."""
        output = None if out is None else output_of(out)
        if output is not None:
            cls.check(output.place)
        return output

    def saved(self, output: Output | None, progress: Progress) -> Self:
        """This, written where it was begun; a command draws the page."""
        if output is not None:
            progress("drawing", 0, 0)
            output.files += self.save(output.place, has_page=False)
        return self

    def save(self, folder: str | PathLike[str], *, command: str = "", has_page: bool = True) -> tuple[Path, ...]:
        """Write `KIND.json`, its tables and its page into a folder; return the files.

        Args:
            folder: is made if it is not there; or a name that ends as that of the table that can stand alone.
            command: line that made the result, for the page.
            has_page: whether to write `index.html`, and `page.json`, of which `calib report` makes it again.

        Raises:
            InputError: the folder takes no files, or holds somebody else's.
        """
        place = place_of(folder, "a folder, such as '.'")
        if self.is_table(place):
            write_files({place: self.tables()[self.alone]})
            return (place,)
        files = {place / f"{self.kind}.json": self._text(), **{place / k: v for k, v in self.tables().items()}}
        write_files(files)
        return (*files, *self.draw_page(place, command)[1]) if has_page else tuple(files)

    def draw_page(self, folder: Path, command: str = "") -> "tuple[Page | None, tuple[Path, ...], str]":
        """Write the page of a folder that holds the result; the page and its files, or why there is none, in a line.

        Raises:
            NotWrittenError: the disk is full.
        """
        from designer.page.page_file import why_no_page, write_page

        if remark := why_no_page(folder, self.kind, *self.replaces):
            return None, (), remark
        try:
            page = self.page_in(folder, command)
            return page, write_page(folder, self.kind, page), ""
        except NotWrittenError:
            raise
        except InputError as error:
            return None, (), f"no page: {printable(str(error))}"

    def drawn_in(self, folder: Path, command: str = "") -> tuple[Path, ...]:
        """Write the page of a folder that holds the result, and return its files; InputError: why there is none."""
        _, files, remark = self.draw_page(folder, command)
        if remark:
            raise InputError(remark)
        return files

    def page_in(self, folder: Path, command: str = "") -> "Page":
        """The page with what a folder adds: its name, its files, and the command that made it."""
        from designer.base.answer import program
        from designer.page.blocks import Command, Section
        from designer.page.folders import file_list, title_of

        again = Command("calib report .", "in this folder: makes this page again")
        files = Section("Files", (file_list(folder, self.purposes(folder)), again))
        page = self.page_beside(folder)
        steps = (Section("Next", page.next_steps),) if page.next_steps else ()
        return replace(
            page, title=page.title or title_of(folder), kind=self.title, sections=(*page.sections, *steps, files),
            made_by=command, program=program(), is_negative=self.is_negative,
        )  # fmt: skip

    @classmethod
    def is_table(cls, place: Path) -> bool:
        """Whether a path is that of the table alone."""
        return bool(cls.alone) and place.suffix.lower() == Path(cls.alone).suffix

    def _text(self) -> bytes:
        head: dict[str, JsonValue] = {"format": f"{NAME}.{self.kind}", "version": 1}
        return (laid_out({**head, **self.document()}) + "\n").encode()

    def _repr_html_(self) -> str:
        from designer.page.shell import page_html

        page = self.page()
        text = page_html(replace(page, title=page.title or self.title, kind=self.title)).decode()
        return f'<iframe srcdoc="{escape(text)}" width="100%" height="800" style="border:0"></iframe>'
