"""A command from a function: its arguments and options from the signature, its words from the docstring.

    @capability
    def budget(rig: Annotated["Rig | Place", argument("the rig's file")], *, ...) -> Budget: ...

is `calib.budget(...)` in Python, and `calib budget` in a shell, where it reads texts, shows how far it is, and tells
the result that the function gives.
"""

import inspect
import re
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Annotated, Any, ParamSpec, TypeVar, cast

from designer.base.answer import Summary
from designer.base.options import Option, Parameter, checked, parameters_of
from designer.page.result import Result

P = ParamSpec("P")
R = TypeVar("R", bound=Result)
NEGATIVE = 1
OUTPUT = "Output"
PROGRESS = "progress"
"""The parameter that is told how far the work is; a shell shows it."""


def capability(function: Callable[P, R]) -> Callable[P, R]:
    """Decorate a function as a command, and so that Python is refused what is beyond its options' limits."""
    offered = checked(function)
    setattr(offered, "as_command", lambda: command_of(function))  # noqa: B010  # what `Later` looks for
    return offered


def command_of(function: Callable[..., Result]) -> Callable[..., Summary]:
    """The function that a shell's command calls, with the texts that were given."""
    parameters, made = parameters_of(function), _result_of(function)
    own_out = "out" in parameters

    def run(**given: object) -> Summary:
        from designer.base.command import command_line
        from designer.page.progress import progress_bars, waiting

        place, verbose, has_page = (given.pop(name, None) for name in ("out", "verbose", "page"))
        values = {name: _read(parameters[name], value) for name, value in given.items() if value is not None}
        if own_out:
            values["out"] = place
        else:
            made.check(cast(Path, place))
        if PROGRESS in inspect.signature(function).parameters:
            with progress_bars() as progress:
                result = function(**values, progress=progress)
        else:
            with waiting(made.doing):
                result = function(**values)
        return told(result, cast(Path, place), command_line(), verbose=bool(verbose), has_page=bool(has_page))

    run.__name__, run.__doc__ = function.__name__, prose(function)
    run.__signature__ = inspect.Signature([  # type: ignore[attr-defined]  # what inspect reads
        *(_typed(one) for one in parameters.values()), *_of_output(made, has_out=not own_out),
    ])  # fmt: skip
    return run


def told(result: Result, folder: Path, command: str, *, verbose: bool, has_page: bool) -> Summary:
    """Save a result, say it on the screen, and sum it up for programs.

    Args:
        result: of a command.
        folder: to write into.
        command: line that made it.
        verbose: say its tables too.
        has_page: whether to write the page.
    """
    from designer.base.answer import Value
    from designer.page.page_file import PAGE_FILE
    from designer.page.progress import waiting
    from designer.page.terminal import say_line, say_page, say_written, shown

    page, remark = result.page(), ""
    files = result.save(folder, has_page=False)
    if has_page:
        with waiting("drawing the page"):
            drawn, remark = result.write_page(folder, command)
        files = (*files, *drawn)
    say_page(page, verbose=verbose)
    say_written(folder, files)
    if remark:
        print(remark)
    steps = tuple(step.line for step in page.next_steps)
    look = (f"open {shown(folder / PAGE_FILE)} in a browser",) if folder / PAGE_FILE in files else ()
    for number, step in enumerate((*look, *steps)):
        say_line("" if number else "next", step)
    remarks = (*result.remarks, *((remark,) if remark else ()))
    answer = cast("Mapping[str, Value]", result.answer())
    return Summary(answer, files, steps, remarks, NEGATIVE if result.is_negative else 0)


def prose(function: Callable[..., object]) -> str:
    """What a docstring says to a person: without example, arguments and errors, nor the place where it is called."""
    text = re.split(r"\n\s*(?:Args:|Raises:|Returns:)\s*\n", inspect.getdoc(function) or "")[0]
    kept = [part for part in text.split("\n\n") if not part.lstrip().startswith(">>>")]
    return re.sub(r": `[^`\n]+`(?:, `[^`\n]+`)*\.", ".", "\n\n".join(kept), count=1)


def _result_of(function: Callable[..., Result]) -> type[Result]:
    found = inspect.signature(function).return_annotation
    return cast("type[Result]", function.__globals__[found] if isinstance(found, str) else found)


def _read(parameter: Parameter, given: object) -> object:
    """What Python is given for what a shell was."""
    if isinstance(given, list | tuple):
        return tuple(parameter.read(str(text)) for text in given)
    return parameter.read(given) if isinstance(given, str) else given


def _typed(parameter: Parameter) -> inspect.Parameter:
    """A parameter as the command line's library takes it: a text, a path, a switch, or several."""
    import typer

    said, empty = parameter.option, inspect.Parameter.empty
    kind: object = parameter.kind if parameter.kind in (bool, Path) else str
    if said.is_many:
        kind = list[str]
    is_needed = parameter.default is empty
    default = parameter.default if kind is bool else empty if is_needed else None
    shown: dict[str, Any] = {"help": said.help, "metavar": said.metavar or _metavar(parameter)}
    if said.names is not None or said.complete is not None:
        names = said.names
        shown["autocompletion"] = said.complete or (lambda: list(names()) if names else [])
    if not is_needed and parameter.default not in (None, (), False) and kind is not bool:
        shown["help"] += f" [default: {parameter.text_of(parameter.default)}]"
    if said.is_argument:
        mark = typer.Argument(**shown)
    else:
        flags = [parameter.flag, *([said.short] if said.short else [])]
        if kind is bool:
            flags[0] += f"/{said.off or f'--no-{flags[0][2:]}'}" if parameter.default else ""
            shown["metavar"] = None
        mark = typer.Option(*flags, rich_help_panel=said.group, **shown)
    optional = kind if kind is bool or is_needed else kind | None  # type: ignore[operator]  # types, put together
    return inspect.Parameter(
        parameter.name, inspect.Parameter.KEYWORD_ONLY, default=default, annotation=Annotated[optional, mark]
    )


def _metavar(parameter: Parameter) -> str | None:
    """What stands for the value in a line of help."""
    if parameter.kind is Path or parameter.option.is_many:
        return None
    if parameter.kind is int:
        return "N"
    return parameter.unit.name.upper() if parameter.unit.name.isalpha() else None


def _of_output(made: type[Result], *, has_out: bool) -> list[inspect.Parameter]:
    """What each command takes besides: where to write, whether with a page, and how much to say."""
    import typer

    files = ", ".join(["the page", f"{made.kind}.json", *made.files])
    out = Option(f"folder for {files}", short="-o", group=OUTPUT)
    page = Option("write the folder's index.html, or save the seconds that takes", group=OUTPUT)
    verbose = typer.Option("--verbose", "-v", help="say all tables", rich_help_panel=OUTPUT)
    place = Parameter("out", out, Path, Path("exports") / made.kind.replace("_", "-"))
    typed = [_typed(place).replace(default=place.default)] if has_out else []
    return [
        *typed, _typed(Parameter("page", page, bool, True)),
        inspect.Parameter(
            "verbose", inspect.Parameter.KEYWORD_ONLY, default=False, annotation=Annotated[bool, verbose]
        ),
    ]  # fmt: skip
