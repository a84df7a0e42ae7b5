"""The commands of `design`."""

import inspect
from collections.abc import Callable, Collection
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, get_args

import typer

from designer.base.answer import Summary
from designer.base.command import Later, command, new_app
from designer.kinds.presets import one_of, printer_templates, target_templates
from designer.spec.build import BUILDS, builds_of
from designer.spec.kind import Kind, kinds
from designer.spec.options import Asked, AskedPrinting, options_of
from designer.spec.options import Option as SpecOption
from designer.spec.spec import Lattice

if TYPE_CHECKING:
    from designer.designing import DesignedTarget

app = new_app(
    "design",
    "Design camera-calibration targets: from one size to files that print in two filaments.\n\n"
    "Begin with: design ico --edge 100mm",
    {name: Later(f"calib.app.tolerance:{name}") for name in ("tolerance", "ways")},  # the steps that calibrate
)

Option = str | bool | None
OPTION_VALUES = {"printer": printer_templates, "build": one_of(tuple(BUILDS)), "lattice": one_of(get_args(Lattice))}
"""What completes the option of a spec's field."""
FOLDER_HELP = "folder to write into (default: exports/NAME)"


def _flag(name: str) -> str:
    return f"--{name.replace('_', '-')}"


def _option(name: str, option: SpecOption) -> inspect.Parameter:
    """The command-line option of a spec's field."""
    is_switch = option.value == "switch"
    flags = [f"{_flag(name)}/--no-{name.replace('_', '-')}"] if is_switch else [_flag(name)]
    if "colour" in name:
        flags.append(_flag(name.replace("colour", "color")))
    if is_switch:
        annotation: object = Annotated[bool | None, typer.Option(*flags, help=option.help)]
    else:
        completed = OPTION_VALUES.get(name)
        annotation = Annotated[
            str | None, typer.Option(*flags, help=option.help, metavar="VALUE", autocompletion=completed)
        ]
    return inspect.Parameter(name, inspect.Parameter.KEYWORD_ONLY, default=None, annotation=annotation)


def _takes(
    *asked: type[AskedPrinting], builds: tuple[str, ...] = tuple(BUILDS), idle: Collection[str] = ()
) -> Callable[[Callable[..., Summary]], Callable[..., Summary]]:
    """Give a command the options of kinds, in place of its `**options`; `idle` ones say nothing about these builds."""

    def decorate(function: Callable[..., Summary]) -> Callable[..., Summary]:
        named = [p for p in inspect.signature(function).parameters.values() if p.kind != p.VAR_KEYWORD]
        known = {name: option for one in asked for name, option in options_of(one).items()}
        known["build"] = replace(known["build"], help=f"how it is made: {', '.join(builds)}")
        typed = [name for name, one in known.items() if one.value != "machine" and name not in idle]  # a table: files'
        own_first = sorted(typed, key=lambda name: name in options_of(Asked))
        options = [_option(name, known[name]) for name in own_first]
        function.__signature__ = inspect.Signature(named + options)  # type: ignore[attr-defined]  # what inspect reads
        return function

    return decorate


def _given(options: dict[str, Option]) -> dict[str, str | bool]:
    """The options that were used."""
    return {name: value for name, value in options.items() if value is not None}


Folder = Annotated[Path | None, typer.Option("--out", "-o", help=FOLDER_HELP)]
MustFit = Annotated[bool, typer.Option("--must-fit", help="write nothing of a part that does not fit the bed")]


def _command_of(kind: Kind) -> None:
    """A command for each kind."""

    def design(*, out: Folder = None, must_fit: MustFit = False, **options: Option) -> Summary:
        from designer.designing import design as designed

        return _saved(designed(kind.name, must_fit=must_fit, **_given(options)), out)

    design.__doc__ = f"Design {kind.title}."
    spec = kind.spec
    builds = [BUILDS[name] for name in builds_of(spec.form)]
    ways = [build for build in builds if not (build.is_in_parts and spec.is_graded)]  # a small piece is of one piece
    idle = {name for name in options_of(kind.asked) if all(name in build.idle for build in ways)}
    if spec.form == "plate":
        idle.add("mount")
    command(app, kind.name)(_takes(kind.asked, builds=tuple(build.name for build in ways), idle=idle)(design))


for _kind in kinds():
    _command_of(_kind)


@command(app)
@_takes(*(kind.asked for kind in kinds()))
def make(
    spec: Annotated[
        str,
        typer.Argument(
            help="a template's name (see `design templates`) or a TOML file", autocompletion=target_templates
        ),
    ],
    *,
    out: Folder = None,
    must_fit: MustFit = False,
    **options: Option,
) -> Summary:
    """Make a template or a TOML file.

    Options replace the file's values.
    """
    from designer.designing import load

    return _saved(load(spec, must_fit=must_fit, **_given(options)), out)


def _saved(target: "DesignedTarget", out: Path | None) -> Summary:
    """Write a design, and say what was done."""
    from designer.report.summary import design_summary, progress, say_design

    with progress() as on_stage:
        written = target.save(out, on_stage)
    say_design(target.design, target.remarks, written)
    return design_summary(target.design, target.remarks, target.check, target.costs, written)


@command(app)
def templates() -> Summary:
    """List the templates for targets, printers and manufacturing errors."""
    from designer.base.files import read_spec_file
    from designer.kinds.layout import lay_out
    from designer.kinds.presets import preset_names, preset_or_file
    from designer.kinds.sizing import printer_of, size_job
    from designer.kinds.spec_file import parse_spec
    from designer.report.summary import say_templates, templates_summary
    from designer.tolerance.error_file import error_model

    targets = []
    for name in preset_names("targets"):
        job = size_job(parse_spec(read_spec_file(preset_or_file("targets", name)), name)).job
        targets.append((name, job, lay_out(job.target)))
    printers = [printer_of(AskedPrinting(printer=name)) for name in preset_names("printers")]
    errors = [(name, error_model(name).title) for name in preset_names("errors")]
    say_templates(targets, printers, errors)
    return templates_summary(targets, printers, errors)


@command(app)
@_takes(AskedPrinting)
def check(
    file: Annotated[Path, typer.Argument(help="a spec (TOML) or a target file (NAME.target.json)")], **options: Option
) -> Summary:
    """Check a design against a printer's rules.

    The exit code is 1 if a rule is violated.
    """
    from designer.base.files import read_spec_file
    from designer.kinds.layout import lay_out
    from designer.kinds.presets import preset_or_file
    from designer.kinds.sizing import size_job, size_printing
    from designer.kinds.spec_file import parse_printing, parse_spec, replaced
    from designer.make.printability import check_printability
    from designer.produce import Design, maker_of
    from designer.report.summary import check_summary, say_check
    from designer.target import load_target

    if file.suffix.lower() == ".json":
        target = load_target(file, "marks")
        printing = size_printing(parse_printing(_given(options)), target)
    else:
        path = preset_or_file("targets", str(file))
        job = size_job(parse_spec(replaced(read_spec_file(path), _given(options)), str(file))).job
        target, printing = lay_out(job.target), job.printing
        if printing.way.is_in_parts:
            maker_of(printing).remarks(Design(job))  # parts that cannot be made or laid on a bed are refused
    result = check_printability(target, printing)
    say_check(str(file), target, printing, result)
    return check_summary(target, printing, result)
