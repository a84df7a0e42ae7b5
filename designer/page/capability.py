"""A command from a function: its arguments and options from the signature, its words from the docstring.

    @capability
    def budget(rig: Annotated["Rig | Place", argument("the rig's file")], *, ...) -> Budget: ...

is `calib.budget(...)` in Python, and `calib budget` in a shell, where it reads texts, shows how far it is, and tells
the result that the function gives. A function with a parameter `out` writes by itself, as it goes: a command hands it
an `Output`, so that what is finished can be told if a person stops it, or if its answer is no.
"""

import inspect
import re
from collections import defaultdict
from collections.abc import Callable, Collection, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import replace
from functools import partial, wraps
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Annotated, Any, Literal, ParamSpec, TypeAlias, TypeVar, cast, get_origin, overload

from designer.base.answer import NegativeError, StoppedError, Summary
from designer.base.errors import InputError, NoAnswerError
from designer.base.options import PLAIN, CommandOption, Parameter, checked, packed, parameters_of
from designer.base.units import NO_SKEW
from designer.base.words import printable
from designer.page.output import Output
from designer.page.result import Result

if TYPE_CHECKING:
    from designer.base.answer import Value

P = ParamSpec("P")
R = TypeVar("R", bound=Result)
Folder: TypeAlias = Callable[[Mapping[str, object]], Path]
"""Where a command writes unless it is told, from what else it is given."""
NEGATIVE = 1
OUTPUT = "Output"
written_to = partial(CommandOption, short="-o", group=OUTPUT)
"""The option that says where: `out: Annotated["Output | Place | None", written_to("folder")] = None`."""
PROGRESS, HEARD, OUT, RESUME = "progress", "heard", "out", "resume"
"""The parameters that are told how far the work is and what happens, which a shell shows, where to write, and to go on
there."""
IN_PYTHON = {
    PROGRESS: "is told what is being done.",
    OUT: "where to write, as it goes; None: nothing is written, `save` does.",
}
LONGEST_LINE = 400
"""Of a command that is said again; of thousands of file names nobody reads more."""


@overload
def capability(function: Callable[P, R]) -> Callable[P, R]: ...


@overload
def capability(*, folder: Folder, draws: bool = False) -> Callable[[Callable[P, R]], Callable[P, R]]: ...


def capability(
    function: Callable[P, R] | None = None, *, folder: Folder | None = None, draws: bool = False
) -> Callable[P, R] | Callable[[Callable[P, R]], Callable[P, R]]:
    """Decorate a function as a command, and so that Python is refused what is beyond its options' limits.

    Args:
        function: the capability.
        folder: where its command writes unless it is told; None: `exports/KIND`.
        draws: it writes its page by itself, which nobody can leave away.
    """

    def decorated(function: Callable[P, R]) -> Callable[P, R]:
        offered = checked(function)
        offered.__doc__ = python_docstring(function)
        made = partial(command_of, function, folder, draws=draws)
        setattr(offered, "as_command", made)  # noqa: B010  # what `Later` looks for
        return offered

    return decorated if function is None else decorated(function)


def instead(**others: Callable[..., Result]) -> Callable[[Callable[P, R]], Callable[P, R]]:
    """Decorate a capability that is another one where an option is given: `@instead(rig=rig_tolerance)`.

    Where it has the option itself, its command is the other where that is given more than once. The command has the
    options of both; what does not go with the one that is carried out is refused.
    """

    def decorate(offered: Callable[P, R]) -> Callable[P, R]:
        functions = {name: inspect.unwrap(other) for name, other in others.items()}
        own, takes = partial(getattr(offered, "as_command"), others=functions), inspect.signature(offered).parameters  # noqa: B009

        @wraps(offered)
        def either(*args: P.args, **given: P.kwargs) -> R:
            asked = (name for name in others if name not in takes and given.get(name) is not None)
            chosen = next((others[name] for name in asked), offered)
            return cast(R, chosen(*args, **given))

        setattr(either, "as_command", own)  # noqa: B010
        return either

    return decorate


def command_of(
    function: Callable[..., Result],
    folder: Folder | None = None,
    others: Mapping[str, Callable[..., Result]] = MappingProxyType({}),
    *,
    draws: bool = False,
) -> Callable[..., Summary]:
    """The function that a shell's command calls, with the texts that were given.

    Args:
        function: a capability's.
        folder: where it writes unless it is told; None: `exports/KIND`.
        others: functions that are called instead where the option of a name is given.
        draws: it writes its page by itself.
    """
    own = {one: parameters_of(one) for one in (function, *others.values())}
    parameters, made = own[function], _result_of(function)

    def run(**given: object) -> Summary:
        from designer.base.answer import command_line

        place = given.pop(OUT, None)
        verbose, has_page = (None if name in parameters else given.pop(name, None) for name in ("verbose", "page"))
        texts = {name: value for name, value in given.items() if value is not None and value != []}
        several = {name for name, value in texts.items() if isinstance(value, list) and len(value) > 1}
        option = next((name for name in others if name in (several if name in parameters else texts)), "")
        chosen = others.get(option, function)
        made, takes = _result_of(chosen), inspect.signature(chosen).parameters
        values = packed(own[chosen], dict(_chosen_values(texts, own, others, chosen, option)))
        where = cast(Path, place or (folder(values) if folder and not option else _folder_of(made)))
        is_asked = bool(place or folder or made.is_written)
        page = where if made.is_written and not made.is_table(where) else None
        output = Output(where, page, is_asked=is_asked)
        if OUT in takes:
            values[OUT] = output
        elif made.is_written:
            made.check(where)
        line, goes_on = command_line(), RESUME in takes
        again = f"{line} --resume".strip() if goes_on and "--resume" not in line.split() else line
        tell = partial(told, command=line, again=again, verbose=bool(verbose), has_page=has_page is not False)
        try:
            with _heard(made, takes) as heard:
                result = chosen(**values, **heard)
            if OUT not in takes and made.is_written:
                output.files += result.save(where, has_page=False)
                output.finished.append(where)
            return tell(result, output)
        except KeyboardInterrupt:
            raise _stopped(output, output.again or (f"go on with {again}" if goes_on else "")) from None
        except NoAnswerError as error:
            if isinstance(error.result, Result):
                return tell(error.result, output, answer=output.answer)
            said = f"no {made.sought}: {error}" if made.sought else str(error)
            raise NegativeError(said, Summary(output.answer, tuple(output.files), remarks=(str(error),))) from None

    run.__name__, run.__doc__ = function.__name__, prose(function)
    has_own_out = OUT in inspect.signature(function).parameters
    shown = [one for one in _merged(own, others) if one.name != OUT]
    run.__signature__ = inspect.Signature([  # type: ignore[attr-defined]  # what inspect reads
        *map(_typed, shown),
        *([_typed(replace(parameters[OUT], default=None) if folder else parameters[OUT])] if OUT in parameters else []),
        *(_of_output(made, folder, has_out=not has_own_out,
                     has_page=not draws and (not has_own_out or OUT in parameters)) if made.is_written else ()),
    ])  # fmt: skip
    return run


def _chosen_values(
    texts: Mapping[str, object], own: Mapping[Callable[..., Result], Mapping[str, Parameter]],
    others: Mapping[str, Callable[..., Result]], chosen: Callable[..., Result], option: str,
) -> Iterator[tuple[str, object]]:  # fmt: skip
    """What the function that is carried out is given, under its names; what is not of it is refused."""
    flags = {name: parameter for each in own.values() for name, parameter in each.items()}
    for name, value in texts.items():
        if name in own[chosen]:
            yield name, _read(own[chosen][name], value)
        elif value != flags[name].default:
            needed = " or ".join(flags[one].flag for one, function in others.items() if name in own[function])
            gone = f"does not go with {flags[option].flag}" if option else f"goes with {needed} only"
            raise InputError(f"{flags[name].label}: {gone}; leave it out")
    for name, parameter in own[chosen].items():
        if parameter.default is inspect.Parameter.empty and name not in (*texts, OUT):
            raise InputError(f"{parameter.label}: is missing: {parameter.option.help}")


def _merged(
    own: Mapping[Callable[..., Result], Mapping[str, Parameter]], others: Mapping[str, Callable[..., Result]]
) -> Iterator[Parameter]:
    """The options of a command of several functions, each once; what only one of them needs may be left out."""
    merged = {name: parameter for each in own.values() for name, parameter in each.items()}
    first, *rest = own.values()
    for name in dict.fromkeys((*first, *(name for each in rest for name in each))):
        parameter = first.get(name, merged[name])
        is_of_all = all(name in each for each in own.values())
        if name in others or (not is_of_all and parameter.default is inspect.Parameter.empty):
            parameter = replace(parameter, default=None)
        for option, function in others.items():
            there = own[function].get(name)
            if there is not None and name in first and there.default not in (None, (), parameter.default):
                help_text = f"{parameter.option.help} [with --{option} {there.text_of(there.default)}]"
                parameter = replace(parameter, option=replace(parameter.option, help=help_text))
        yield parameter


@contextmanager
def _heard(made: type[Result], takes: Collection[str]) -> Iterator[dict[str, object]]:
    """A sign of life while a function works, or what it tells its progress to, or what happens, a line each."""
    from designer.page.progress import progress_bars, waiting

    if HEARD in takes:  # at once: who waits for a line may be a program
        yield {HEARD: lambda line: print(printable(line), flush=True)}
    elif PROGRESS in takes:
        with progress_bars() as progress:
            yield {PROGRESS: progress}
    else:
        with waiting(made.doing):
            yield {}


def told(
    result: Result, output: Output, command: str, again: str, *, verbose: bool, has_page: bool,
    answer: "Mapping[str, Value] | None" = None,
) -> Summary:  # fmt: skip
    """Say a result that is written on the screen, write its page, and sum it up for programs.

    Args:
        result: of a command.
        output: where it is written.
        command: line that made it.
        again: line that makes it once more.
        verbose: say its tables too.
        has_page: whether to write the page.
        answer: for programs; None: the result's.
    """
    from designer.page.page_file import PAGE_FILE
    from designer.page.progress import waiting
    from designer.page.terminal import say_line, say_page, say_written, shown

    page, remark = None, ""
    if output.page is not None:
        at = output.page / PAGE_FILE
        if has_page and at not in output.files:
            with waiting("drawing the page"):
                page, files, remark = result.draw_page(output.page, command)
            output.files += files
        elif at.exists() and at not in output.files:
            remark = f"{at}: is of earlier results; calib report {output.page} draws it again"
    page = result.words(page)
    say_page(page, verbose=verbose or not result.is_written)
    places = (output.folder, *(() if output.page is None or output.folder in output.page.parents else (output.page,)))
    for folder in dict.fromkeys(places):
        if any(folder in path.parents for path in output.files):
            say_written(folder, output.files)
    if remark:
        print(remark)
    again = again if result.remedy else ""
    steps = tuple(f"{step.line}{step.purpose and f'   # {step.purpose}'}" for step in page.next_steps)
    look = (f"open {shown(at)} in a browser",) if output.page is not None and at in output.files else ()
    do = (f"{result.remedy}; then run the same command again",) if result.remedy else ()
    repeated = (again,) if 0 < len(again) <= LONGEST_LINE else ()
    for number, step in enumerate((*look, *do, *repeated, *steps)):
        say_line("" if number else "next", step)
    remarks = (*result.remarks, *((remark,) if remark else ()))
    return Summary(
        answer or result.answer(), tuple(output.files), (*((again,) if again else ()), *steps), remarks,
        NEGATIVE if result.is_negative else 0,
    )  # fmt: skip


def _stopped(output: Output, again: str) -> StoppedError:
    """After Ctrl-C, with a word on what is finished and stays."""
    from designer.base.command import NOTHING_WRITTEN
    from designer.page.terminal import shown

    places = ", ".join(shown(path) for path in dict.fromkeys(output.finished) if path.exists())
    said = f"stopped; finished and kept: {places}{again and f'; {again}'}" if places else NOTHING_WRITTEN
    return StoppedError(said, Summary(output.answer, tuple(output.files)))


def _folder_of(made: type[Result]) -> Path:
    """Where results go unless a command is told, or says otherwise."""
    return Path("exports") / made.kind.replace("_", "-")


def prose(function: Callable[..., object]) -> str:
    """What a docstring says to a person: without example, arguments and errors, nor the place where it is called."""
    text = re.split(r"\n\s*(?:Args:|Raises:|Returns:)\s*\n", inspect.getdoc(function) or "")[0]
    kept = [part for part in text.split("\n\n") if not part.lstrip().startswith(">>>")]
    return re.sub(r": `[^`\n]+`(?:, `[^`\n]+`)*\.", ".", "\n\n".join(kept), count=1)


def python_docstring(function: Callable[..., object]) -> str:
    """A docstring with an argument a line: what it says of the argument itself, or else what a shell is told of it."""
    text, _, errors = (inspect.getdoc(function) or "").partition("\n\nRaises:")
    text, _, told = text.partition("\n\nArgs:\n")
    options = {name: f"{one.option.help.removesuffix('.')}." for name, one in parameters_of(function).items()}
    told_of = options | IN_PYTHON | dict(re.findall(r"^    (\w+): (.+(?:\n {8}.+)*)", told, re.MULTILINE))
    named = [name for name in inspect.signature(function).parameters if name in told_of]
    arguments = "".join(f"\n    {name}: {told_of[name]}" for name in named)
    return f"{text}\n\nArgs:{arguments}" + (f"\n\nRaises:{errors}" if errors else "")


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
    kind: object = parameter.kind if parameter.kind in (bool, Path) and said.parse is None else str
    if said.is_many:
        kind = list[str]
    elif parameter.kind == tuple[str, str]:
        kind = parameter.kind
    is_needed = parameter.default is empty or said.is_needed
    default = parameter.default if kind is bool else empty if is_needed else None
    shown: dict[str, Any] = {
        "help": said.help, "metavar": said.metavar or _metavar(parameter), "show_default": kind is bool,
    }  # fmt: skip
    if said.complete is not None or said.names is not None or get_origin(parameter.kind) is Literal:
        shown["autocompletion"] = said.complete or (lambda: [str(one) for one in parameter.known])
    if not is_needed and parameter.default not in (None, (), False, NO_SKEW) and kind is not bool:
        shown["help"] += f" [default: {parameter.text_of(parameter.default)}]"
    if said.is_argument:
        mark = typer.Argument(**shown)
    else:
        flags = [parameter.flag, *([said.short] if said.short else [])]
        if kind is bool:
            flags[0] += f"/{said.off or f'--no-{flags[0][2:]}'}" if parameter.default or said.off else ""
            shown["metavar"] = None
        mark = typer.Option(*flags, rich_help_panel=said.group, **shown)
    is_told = is_needed or (kind is bool and parameter.default is not None)
    optional = kind if is_told else kind | None  # type: ignore[operator]  # types, put together
    return inspect.Parameter(
        parameter.name, inspect.Parameter.KEYWORD_ONLY, default=default, annotation=Annotated[optional, mark]
    )


def _metavar(parameter: Parameter) -> str | None:
    """What stands for the value in a line of help."""
    if parameter.kind is Path or parameter.option.is_many:
        return None
    if parameter.kind is int:
        return "N"
    if parameter.kind is float and parameter.unit is PLAIN:
        return "NUMBER"
    return parameter.unit.name.upper() if parameter.unit.name.isalpha() else None


def _of_output(made: type[Result], folder: Folder | None, *, has_out: bool, has_page: bool) -> list[inspect.Parameter]:
    """What each command takes besides: where to write, whether with a page, and how much to say."""
    import typer

    files = ", ".join(["the page", f"{made.kind}.json", *made.files])
    table = f"; or a {Path(made.alone).suffix}, for {made.alone} alone" if made.alone else ""
    out = written_to(f"folder for {files}{table}")
    page = CommandOption("write the folder's index.html, or save the seconds that takes", group=OUTPUT)
    verbose = typer.Option("--verbose", "-v", help="say all tables", rich_help_panel=OUTPUT)
    # Of a command that writes where its target's results go, as in exports/NAME/plan.
    usual = folder(defaultdict(lambda: Path("NAME"))) if folder else _folder_of(made)
    place = Parameter(OUT, out, Path, usual)
    return [
        *([_typed(place)] if has_out else []),
        *([_typed(Parameter("page", page, bool, True))] if has_page else []),
        inspect.Parameter(
            "verbose", inspect.Parameter.KEYWORD_ONLY, default=False, annotation=Annotated[bool, verbose]
        ),
    ]
