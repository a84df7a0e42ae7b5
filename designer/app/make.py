"""Make a template, a TOML file, or a target of a kind: `design make matt-ico`, `design ico --edge 100mm`.

In Python these are `designer.load` and the functions of the kinds, whose target is saved when that is asked for.
"""

import inspect
from collections.abc import Callable, Collection
from dataclasses import asdict, dataclass, replace
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, TypeVar, get_args

from designer.base.options import CommandOption, argument, option
from designer.kinds.presets import one_of, printer_templates, target_templates
from designer.page.capability import capability
from designer.page.output import Output
from designer.page.progress import Progress, unheard
from designer.page.result import Result
from designer.spec.build import BUILDS, builds_of
from designer.spec.kind import KINDS, kind_named, kinds
from designer.spec.options import Asked, AskedPrinting, options_of
from designer.spec.spec import Lattice

if TYPE_CHECKING:
    from designer.app.design import DesignedTarget, Written
    from designer.base.answer import Value
    from designer.make.printability import PrintCheck
    from designer.page.blocks import Finding, Page
    from designer.target import TargetGeometry

R = TypeVar("R", bound=Result)
Given = str | bool | None
COMPLETED = {"printer": printer_templates, "build": one_of(tuple(BUILDS)), "lattice": one_of(get_args(Lattice))}
"""What completes the option of a spec's field."""
IN_FILES = ("machine", "mesh", "corners", "polygons")
"""Tables, which files hold; a mesh is the argument of its kind."""
Folder = Annotated[Path | None, option("folder to write into (default: exports/NAME)", short="-o", group="Output")]
MustFit = Annotated[bool, option("write nothing of a part that does not fit the bed")]


@dataclass(frozen=True, eq=False)
class WrittenDesign(Result, kind="design", title="Target", doing="designing", is_written=False):
    """A target, and what was written of it."""

    target: "DesignedTarget"
    written: "Written"

    @property
    def chosen(self) -> tuple[str, ...]:
        """For the person, a line each."""
        from designer.builds.pictures import printed_ink

        return (*self.target.remarks, printed_ink(self.target.design).lettering.remark)

    @property
    def remarks(self) -> tuple[str, ...]:  # type: ignore[override]
        """What was chosen, and which target is replaced."""
        return (*self.chosen, *self.written.replaced)

    @property
    def is_negative(self) -> bool:
        """Whether a design rule is violated."""
        return bool(self.target.check.violations)

    def page(self) -> "Page":
        """The folder's `index.html`."""
        return self.written.page

    def save(self, folder: str | PathLike[str], *, command: str = "", has_page: bool = True) -> tuple[Path, ...]:
        """Write all files again, the page among them."""
        written = self.target.save(folder)
        return tuple(written.folder / file.name for file in written.files)

    def draw_page(self, folder: Path, command: str = "") -> "tuple[Page | None, tuple[Path, ...], str]":
        """It was written with all other files."""
        return self.written.page, (), ""

    def words(self, page: "Page | None" = None) -> "Page":
        """The answer, sizes and costs, what the rules say, what was chosen and written, and what comes next."""
        from dataclasses import replace

        from designer.app.costs import cost_table
        from designer.builds.design import maker_of
        from designer.page.blocks import Command, Facts, Finding, Findings, Page, Section

        design, costs = self.target.design, self.target.costs
        (facts,) = (block for block in self.written.page.lead if isinstance(block, Facts))
        chosen = tuple(("chosen" if not n else "", line) for n, line in enumerate(self.chosen))
        make = ("make", maker_of(design.job.printing).next_step(design, str(self.written.folder / self.target.name)))
        rows = [*rule_rows(self.target.check), *(Finding("usable", "", line) for line in self.written.replaced)]
        if self.written.left:
            text = f"{', '.join(self.written.left)}; maybe of another target"
            rows.append(Finding("usable", "left from an earlier run", text))
        table = (
            (replace(cost_table(costs, design.job.printing), title="This build and the others"),)
            if costs.is_printed
            else ()
        )
        return Page(
            "", "", self.written.page.headline, (Section("", (*table, Findings(tuple(rows)))),),
            lead=(Facts((*facts.rows, *chosen, make)),), next_steps=(Command(self._run_line),),
        )  # fmt: skip

    @property
    def _run_line(self) -> str:
        """The command that follows when the target is made and photographed."""
        from designer.app.stands import photo_line
        from designer.page.terminal import quoted

        job = self.target.design.job
        if job.target.is_graded:
            return photo_line(job)
        return f"calib run {quoted(self.written.folder / f'{job.name}.target.json')} photos -o camera"

    def answer(self) -> "dict[str, Value]":
        """Ids, sizes, estimates, findings and files."""
        from designer.app.costs import costs_summary
        from designer.make.bed import printed_size_mm
        from designer.spec.kind import spec_to_mapping

        job, geometry, files = self.target.design.job, self.target.geometry, self.written.files
        return {
            "name": job.name, **target_numbers(geometry), "spec": spec_to_mapping(job.target),
            "printing": asdict(job.printing), "estimates": costs_summary(self.target.costs),
            "printed_size_mm": list(printed_size_mm(geometry, job.printing)), **check_numbers(self.target.check),
            "files": [{"name": one.name, "bytes": len(one.content), "purpose": one.purpose} for one in files],
            "left_from_earlier": self.written.left,
        }  # fmt: skip


def target_numbers(target: "TargetGeometry") -> "dict[str, Value]":
    """Which target it is, for programs."""
    return {
        "target_id": target.geometry_id, "layout_id": target.layout_id, "faces": target.face_count,
        "rings": target.ring_count, "dots": int(target.is_dot.sum()),
    }  # fmt: skip


def check_numbers(check: "PrintCheck") -> "dict[str, Value]":
    """What the design rules say, for programs."""
    return {
        "is_violated": bool(check.violations), "findings": [asdict(finding) for finding in check.findings],
        "rules_that_hold": check.holding,
    }  # fmt: skip


def rule_rows(check: "PrintCheck") -> "list[Finding]":
    """What rules say against a print; of those that hold only which they are."""
    from designer.page.blocks import Finding

    rows = check.told().rows
    holding = ", ".join(row.title for row in rows if row.level == "good")
    return [row for row in rows if row.level != "good"] + ([Finding("good", "", holding)] if holding else [])


def with_options(
    function: Callable[..., R], *asked: type[AskedPrinting], builds: tuple[str, ...] = tuple(BUILDS),
    idle: Collection[str] = (),
) -> Callable[..., R]:  # fmt: skip
    """A capability with the options of kinds in place of its `**options`, but those that are `idle`."""
    said = {name: one for kind in asked for name, one in options_of(kind).items()}
    said["build"] = replace(said["build"], help=f"how it is made: {', '.join(builds)}")
    typed = [name for name, one in said.items() if one.value not in IN_FILES and name not in idle]
    parameters = [one for one in inspect.signature(function).parameters.values() if one.kind != one.VAR_KEYWORD]
    if len(asked) == 1:  # what is not for any kind, but for this one
        first = ((name, Annotated[str | None, argument(one.help)]) for name, one in said.items() if one.value == "mesh")
        place = inspect.Parameter.POSITIONAL_OR_KEYWORD
        parameters[:0] = [inspect.Parameter(name, place, default=None, annotation=kind) for name, kind in first]
    for name in sorted(typed, key=lambda name: name in options_of(Asked)):  # a kind's own first
        is_switch, flag = said[name].value == "switch", name.replace("_", "-")
        mark = CommandOption(
            said[name].help, metavar="" if is_switch else "VALUE", off=f"--no-{flag}" if is_switch else "",
            short=f"--{flag.replace('colour', 'color')}" if "colour" in name else "", complete=COMPLETED.get(name),
        )  # fmt: skip
        kind: object = bool | None if is_switch else str | None
        parameters.append(
            inspect.Parameter(name, inspect.Parameter.KEYWORD_ONLY, default=None, annotation=Annotated[kind, mark])
        )
    signature = inspect.Signature(parameters, return_annotation=inspect.signature(function).return_annotation)
    function.__signature__ = signature  # type: ignore[attr-defined]  # what inspect reads
    return capability(function)


def _of_kind(name: str) -> Callable[..., WrittenDesign]:
    """The command of a kind."""
    kind = kind_named(name)

    def made(
        *, out: Folder = None, must_fit: MustFit = False, progress: Progress = unheard, **options: Given
    ) -> WrittenDesign:
        from designer.app.design import design

        return _saved(design(name, must_fit=must_fit, **options), out, progress)

    made.__name__, made.__doc__ = name, f"Design {kind.title}."
    ways = [BUILDS[way] for way in builds_of(kind.spec.form)]
    ways = [way for way in ways if not (way.is_in_parts and kind.spec.is_graded)]  # a small piece is of one piece
    idle = {option for option in options_of(kind.asked) if all(option in way.idle for way in ways)}
    idle |= {"mount", "jig"} if kind.spec.form == "plate" else set()
    return with_options(made, kind.asked, builds=tuple(way.name for way in ways), idle=idle)


def __getattr__(name: str) -> object:
    """The command of a kind, and `make`, when they are asked for: their options are those of kinds."""
    if name in KINDS or name == "make":
        made = with_options(_make, *(kind.asked for kind in kinds())) if name == "make" else _of_kind(name)
        return globals().setdefault(name, made)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def _make(
    spec: Annotated[
        str, argument("a template's name (see `design templates`) or a TOML file", complete=target_templates)
    ],
    *,
    out: Folder = None,
    must_fit: MustFit = False,
    progress: Progress = unheard,
    **options: Given,
) -> WrittenDesign:
    """Make a template or a TOML file.

    Options replace the file's values.
    """
    from designer.app.design import load

    return _saved(load(spec, must_fit=must_fit, **options), out, progress)


def _saved(target: "DesignedTarget", out: Path | Output | None, progress: Progress) -> WrittenDesign:
    """Write a design where that was asked for, else where its name says."""
    assert isinstance(out, Output)  # noqa: S101 - what a command hands over
    written = target.save(out.place if out.is_asked else None, lambda stage: progress(f"making {stage}", 0, 0))
    out.place = out.page = written.folder
    out.files = [written.folder / file.name for file in written.files]
    return WrittenDesign(target, written)
