"""What studies give: tables to paste into a text, every number as CSV, and figures in files, beside the page."""

import csv
import io
from abc import abstractmethod
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import cached_property
from os import PathLike
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, ClassVar, TypeVar, cast

from designer.base.codec import encode
from designer.base.errors import InputError
from designer.base.files import check_folder, place_of, write_files
from designer.base.options import option
from designer.base.own_files import require_ours
from designer.base.words import NAME
from designer.page.capability import OUTPUT
from designer.page.output import Output
from designer.page.progress import Progress
from designer.page.result import Result

if TYPE_CHECKING:
    from calib.draw.style import FigureSheet
    from calib.studies.identity import StudyIdentity
    from calib.studies.runner import DrawCount, Sampling
    from calib.studies.samples import Samples
    from calib.studies.workers import CaseSpec
    from designer.base.files import JsonValue
    from designer.page.blocks import Figure

Row = TypeVar("Row")
FORMATS = ("pdf", "svg")
COMPUTED = "computed"
STUDY_OUT = option("folder for the study, its tables, figures and page", short="-o", group=OUTPUT)
MARKDOWN_FILE, CSV_FILE = "table.md", "table.csv"
TABLES = {MARKDOWN_FILE: "the tables, to paste into a text", CSV_FILE: "every number, a line each"}


@contextmanager
def sampling_in(
    output: Output | None, jobs: int | None, dask: str | None, *, resume: bool, progress: Progress
) -> "Iterator[Sampling]":
    """Where samples are kept, and who computes them: in the folder that was asked for, else where nobody looks."""
    if dask is not None and jobs is not None:
        raise InputError("--jobs: is of processes on this machine; --dask has the cluster do it, leave one out")
    from calib.renderer.quantities import processes_of
    from calib.studies.runner import Sampling

    with TemporaryDirectory() as aside:
        yield Sampling(Path(aside) if output is None else output.place, processes_of(jobs), dask, resume, progress)


def kept_samples(
    case: "CaseSpec", identity: "StudyIdentity", output: Output | None, jobs: int | None, dask: str | None, *,
    resume: bool, progress: Progress, doing: str = "sampling",
) -> "Samples":  # fmt: skip
    """The samples of a study of one case, those that are not there yet computed."""
    with sampling_in(output, jobs, dask, resume=resume, progress=progress) as sampling:
        sampling.check(identity)
        if output is not None:
            output.finished.append(sampling.path)
        samples, _ = sampling.run_one(identity, case, tell=lambda done: progress(doing, done, case.samples))
    return samples


class StudyResult(Result, kind="study", title="Study"):
    """A result with figures."""

    formats: Sequence[str]
    """Of the figures, besides PNG."""
    columns: ClassVar[str]
    """The first two of `table.csv`, by which it is known."""

    @classmethod
    def check(cls, folder: Path) -> None:
        """As every result; a study's own file is asked where it is opened."""
        check_folder(folder)
        kinds = {f"{cls.kind}.json": f"{NAME}.{cls.kind}", MARKDOWN_FILE: "", CSV_FILE: cls.columns}
        for name, kind in kinds.items():
            require_ours(folder / name, kind=kind)

    @abstractmethod
    def sheets(self) -> "tuple[FigureSheet, ...]":
        """Its figures."""

    @abstractmethod
    def csv(self) -> bytes:
        """`table.csv`."""

    def tables(self) -> Mapping[str, bytes]:
        """`table.md`, `table.csv` and the figures."""
        from designer.page.blocks import Facts, Section
        from designer.page.markdown import markdown

        page = self.page()
        lead = (  # without how long it took: the same study has the same tables
            Facts(tuple(row for row in one.rows if row[0] != COMPUTED)) if isinstance(one, Facts) else one
            for one in page.lead
        )
        answer = "" if page.headline is None else page.headline.sentence
        text = markdown(page.title or self.title, (Section("Question", tuple(lead)), *page.sections), answer)
        drawn = (self._drawn[sheet.stem] for sheet in self._sheets)
        return {
            MARKDOWN_FILE: text.encode("utf-8", "surrogatepass"),
            CSV_FILE: self.csv(),
            **{path: content for files in drawn for path, content in files.items()},
        }

    def figures(self, *stems: str, start: str = "/") -> "tuple[Figure, ...]":
        """Of these names on a page, or of all that start so."""
        chosen = (one for one in self._sheets if one.stem in stems or one.stem.startswith(start))
        return tuple(one.block(self._drawn[one.stem]) for one in chosen)

    def save(self, folder: str | PathLike[str], *, command: str = "", has_page: bool = True) -> tuple[Path, ...]:
        """As every result; figures that lie there in other formats are drawn again in these, too."""
        place = place_of(folder, "a folder, such as '.'")
        files = super().save(place, command=command, has_page=has_page)
        left = [suffix for suffix in FORMATS if suffix not in self.formats]
        again = {
            place / path: content
            for sheet in self._sheets
            for suffix in left
            if (place / sheet.path(suffix)).exists()
            for path, content in sheet.drawn((suffix,)).items()
            if path.endswith(suffix)
        }
        write_files(again)
        kept = (place / name for name in self.files if (place / name).exists())
        return tuple(dict.fromkeys((*files, *again, *kept)))

    @cached_property
    def _sheets(self) -> "tuple[FigureSheet, ...]":
        return self.sheets()

    @cached_property
    def _drawn(self) -> dict[str, dict[str, bytes]]:
        return {sheet.stem: sheet.drawn(self.formats) for sheet in self._sheets}


def figure_formats(text: str) -> tuple[str, ...]:
    """The formats of an option, each once; ValueError: another."""
    names = tuple(dict.fromkeys(name.strip().lower() for name in text.split(",")))
    if not set(names) <= set(FORMATS):
        raise ValueError(f"there are {' and '.join(FORMATS)}, besides PNG")
    return names


def rows_to_csv(kind: type[Row], rows: Sequence[Row], heads: "Sequence[Mapping[str, JsonValue]]" = ()) -> bytes:
    """A line a row, its fields as columns; a head, if there are any, stands before each."""
    values = [encode(kind, row) for row in rows]
    lines = [
        {**head, **cast("dict[str, JsonValue]", row)}
        for head, row in zip(heads or [{}] * len(rows), values, strict=True)
    ]
    stream = io.StringIO()
    writer = csv.DictWriter(stream, list(lines[0]) if lines else ["none"], lineterminator="\n")
    writer.writeheader()
    for line in lines:
        writer.writerow({name: "" if value is None else value for name, value in line.items()})
    return stream.getvalue().encode("utf-8", "surrogatepass")


def computed(count: "DrawCount", what: str) -> tuple[tuple[str, str], ...]:
    """How many samples were computed, and how long that took, as a fact; nothing where all were there."""
    if not count.new:
        return ()
    there = f", {count.before} were there" if count.before else ""
    return ((COMPUTED, f"{count.new} {what} in {count.seconds:.1f} s{there}"),)
