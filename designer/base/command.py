"""How a command line begins and ends: its options, its streams, and its exit code."""

import atexit
import codecs
import gc
import inspect
import io
import os
import re
import shlex
import signal
import sys
import unicodedata
import warnings
from collections import UserDict
from collections.abc import Callable, Iterator, Mapping, MutableMapping, Sequence
from contextlib import contextmanager, redirect_stdout, suppress
from dataclasses import dataclass, replace
from functools import cache, wraps
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, TextIO, TypeVar, cast

import typer
from typer.core import TyperCommand, TyperGroup

from designer.base.answer import LINE, NegativeError, StoppedError, Summary, document, program
from designer.base.errors import InputError
from designer.base.interrupts import STOPS, heed_interrupts, hold_interrupts
from designer.base.words import printable

if TYPE_CHECKING:
    from typer._click import Command, Context, HelpFormatter

NEGATIVE, BAD_INPUT, STOPPED = 1, 2, 130
JSON = "--json"
SHORT_HELP = 90
"""Characters of a command's first line in the list of all."""
NOTHING_WRITTEN = "stopped; nothing was written"
OBJECTS_BETWEEN_SEARCHES = 20_000
"""Python itself takes 700; the modules of a command alone make a hundred thousand objects, all of which stay."""

Function = TypeVar("Function", bound=Callable[..., Summary])
OUT, ERR = 1, 2
"""What the operating system calls them."""
PLAIN = {
    "±": "+-", "×": "x", "·": "*", "°": "deg", "⁻": "^-", "σ": "sigma", "µ": "u", "μ": "u", "≤": "<=", "≥": ">=",
    "●": "*", "○": "o",
}  # fmt: skip
"""What stands in for a character where there is none, as in the locale C, beside its nearest letter or digit."""


@dataclass(frozen=True)
class Later:
    """A command whose module is loaded when it is used."""

    place: str  # "module:name" of a capability
    task: str | None = None  # under which the program's help lists it
    help: str = ""  # its line in that list; "": it is loaded to be asked

    def loaded(self, name: str) -> "Command":
        """The command, under its name on the command line."""
        return _command_of_place(self.place, name, self.task)


@cache
def _command_of_place(place: str, name: str, task: str | None) -> "Command":
    """Made once, however many lines a process runs."""
    module, _, word = place.partition(":")
    alone = typer.Typer(add_completion=False, rich_markup_mode=None, pretty_exceptions_enable=False)
    command(alone, name, task)(getattr(import_module(module), word).as_command())
    return typer.main.get_command(alone)


@dataclass(frozen=True)
class LaterGroup:
    """Commands under a name of their own, as in `calib study plot`."""

    commands: "Mapping[str, Later]"
    help: str
    task: str | None = None

    def loaded(self, name: str) -> "Command":
        """The group, under its name on the command line."""

        class GroupByTask(_ByTask):
            later = self.commands

        app = typer.Typer(help=self.help, cls=GroupByTask, rich_markup_mode=None, pretty_exceptions_enable=False)

        @app.callback(invoke_without_command=True, help=self.help)
        def commands(context: typer.Context) -> None:
            if context.invoked_subcommand is None:
                print(context.get_help())

        group = typer.main.get_group(app)
        group.name, group.rich_help_panel = name, self.task
        return group


class _Commands(UserDict[str, "Command | Later | LaterGroup"]):
    """Commands by their names; one that is loaded later is when it is looked up."""

    def __getitem__(self, name: str) -> "Command | Later | LaterGroup":
        made = super().__getitem__(name)
        if isinstance(made, Later | LaterGroup):
            self[name] = made = made.loaded(name)
        return made


class _ByTask(TyperGroup):
    """Lists commands under what they are for, in the order in which they were made."""

    later: Mapping[str, Later | LaterGroup] = {}

    def __init__(self, **given: Any) -> None:  # noqa: ANN401  # whatever typer's own takes
        super().__init__(**given)
        self.commands = cast("MutableMapping[str, Command]", _Commands({**self.commands, **self.later}))

    def list_commands(self, ctx: "Context") -> list[str]:
        """Names, without a look at what they stand for."""
        return list(self.commands)

    def format_commands(self, ctx: "Context", formatter: "HelpFormatter") -> None:
        """Write a section for each task."""
        tasks: dict[str, list[tuple[str, str]]] = {}
        for name in self.list_commands(ctx):
            later = self.later.get(name)
            if later is not None and later.help:
                tasks.setdefault(later.task or "Commands", []).append((name, later.help))
                continue
            one = self.get_command(ctx, name)
            if one is not None and not one.hidden:
                task = getattr(one, "rich_help_panel", None)
                line = (name, one.get_short_help_str(SHORT_HELP))
                tasks.setdefault(task if isinstance(task, str) else "Commands", []).append(line)
        for task, rows in tasks.items():
            with formatter.section(task):
                formatter.write_dl(rows)


class _Command(TyperCommand):
    """Refuses an empty word for a file, the folder one is in else, and an option twice; lists options in groups."""

    def format_options(self, ctx: "Context", formatter: "HelpFormatter") -> None:
        """Write a section for each group."""
        groups: dict[str, list[tuple[str, str]]] = {}
        for one in self.get_params(ctx):
            row = one.get_help_record(ctx)
            if row is not None:
                panel = getattr(one, "rich_help_panel", None)
                usual = "Arguments" if one.param_type_name == "argument" else "Options"
                groups.setdefault(panel if isinstance(panel, str) else usual, []).append(row)
        for title, rows in groups.items():
            with formatter.section(title):
                formatter.write_dl(rows)

    def parse_args(self, ctx: "Context", args: list[str]) -> list[str]:
        """Look at the words before they are paths."""
        given, _, order = self.make_parser(ctx).parse_args(list(args))
        parameters = inspect.signature(cast("Callable[..., Summary]", self.callback)).parameters
        for one in self.params:
            is_several = getattr(one, "multiple", False) or getattr(one, "is_flag", False)
            takes_one = one.param_type_name == "option" and not is_several
            if takes_one and (times := order.count(one)) > 1:
                raise InputError(
                    f"{one.opts[0]}: given {times} times, and takes one; leave out all but that which is meant"
                )
            words = given.get(one.name or "")
            is_empty = "" in (words if isinstance(words, list | tuple) else (words,))
            if is_empty and "Path" in str(parameters[str(one.name)].annotation):
                raise InputError(f"{one.opts[0]} '': names no file and no folder; give its name, or leave it out")
        return super().parse_args(ctx, args)


def new_app(name: str, about: str, commands: Mapping[str, Later | LaterGroup]) -> typer.Typer:
    """A program with `-h`, `--version`, and its commands listed by task.

    Args:
        name: of the program.
        about: it, for its help.
        commands: by their names, those that are loaded when they are used; they are listed after others.
    """

    class Program(_ByTask):
        later = commands

    app = typer.Typer(
        name=name, help=about, cls=Program, rich_markup_mode=None, pretty_exceptions_enable=False,
        context_settings={"help_option_names": ["-h", "--help"]},
    )  # fmt: skip

    def say_version(asked: bool) -> None:
        if asked:
            print(program())
            raise typer.Exit

    @app.callback()
    def about_all(
        version: Annotated[
            bool, typer.Option("--version", help="name and version", is_eager=True, callback=say_version)
        ] = False,
    ) -> None:
        del version

    about_all.__doc__ = about
    return app


def command(app: typer.Typer, name: str | None = None, task: str | None = None) -> Callable[[Function], Function]:
    """Decorate a function as a command of an app, with `--json` among its options.

    `run` heeds the option; the function never sees it.

    Args:
        app: of the command.
        name: on the command line; None: the function's.
        task: under which the program's help lists it.
    """

    def register(function: Function) -> Function:
        @wraps(function)
        def with_json(*, as_json: bool, **values: object) -> Summary:
            return function(**values)

        signature = inspect.signature(function)
        annotation = Annotated[
            bool, typer.Option(JSON, help="answer in JSON on standard output, for programs", rich_help_panel="Output")
        ]
        option = inspect.Parameter("as_json", inspect.Parameter.KEYWORD_ONLY, default=False, annotation=annotation)
        parameters = [*signature.parameters.values(), option]
        with_json.__signature__ = signature.replace(parameters=parameters)  # type: ignore[attr-defined]
        app.command(name, cls=_Command, rich_help_panel=task)(with_json)
        return function

    return register


def run(app: typer.Typer) -> None:
    """Run a command line and leave the program.

    The exit code is 0 if all is well, 1 if the command ran but its answer is negative, 2 for bad input, which ends in
    one line on standard error, and 130 if a person stopped it. With `--json` standard output holds one JSON document
    and nothing else.
    """
    forgive_readers()
    # Seldom while the command runs, and not at all when the process ends, which took a sixth of a short command.
    gc.set_threshold(OBJECTS_BETWEEN_SEARCHES)
    atexit.register(_leave)
    if not sys.warnoptions:  # what NumPy says of a number that a line refuses
        warnings.simplefilter("ignore", RuntimeWarning)
    os.environ.setdefault("PYDANTIC_DISABLE_PLUGINS", "__all__")  # else all installed packages are asked for some
    name = app.info.name if isinstance(app.info.name, str) else Path(sys.argv[0]).name
    words = sys.argv[1:]
    line = re.sub(
        r"://[^/@\s]*@", "://USER:PASSWORD@", shlex.join([name, *words])
    )  # of cameras' and clusters' addresses
    before = LINE.set(line)
    try:
        # Told from the words, so that a line that cannot be understood is answered in JSON too.
        if JSON not in (words[: words.index("--")] if "--" in words else words):
            summary, _ = _carried_out(app, name, words)
        else:
            with people_on_stderr():
                summary, error = _carried_out(app, name, words)
            print(document(summary, command=_command_of(app, name, words), line=line, error=error), end="")
    finally:
        LINE.reset(before)
        with suppress(KeyboardInterrupt):  # it came too late
            heed_interrupts()
    if reason := not_heard():
        summary, _ = _refused(f"standard output cannot be written: {reason}; make room, or send it elsewhere")
    sys.exit(summary.exit_code)


def _leave() -> None:
    """Without a search, but where booleans were used: their library writes about each solid that is left in a cycle.

    What the command wrote and said stands; Ctrl-C comes too late.
    """
    for stop in STOPS:
        signal.signal(stop, signal.SIG_IGN)
    if "manifold3d" in sys.modules:
        gc.collect()
    gc.freeze()


def _carried_out(app: typer.Typer, name: str, words: Sequence[str]) -> tuple[Summary, str | None]:
    """What came of a command line, and why it did not come to its end, which people are told."""
    try:
        try:
            heed_interrupts()
            ended = typer.main.get_command(app).main(list(words) or ["--help"], prog_name=name, standalone_mode=False)
        finally:
            hold_interrupts()  # until the answer is told
    except StoppedError as error:
        return _stopped(str(error), error.summary)
    except NegativeError as error:
        print(printable(str(error)))
        return replace(error.summary, exit_code=NEGATIVE), None
    except (typer.Abort, KeyboardInterrupt):
        return _stopped(NOTHING_WRITTEN, Summary())
    except typer.TyperException as error:
        return _refused(error.format_message())
    except InputError as error:
        return _refused(str(error))
    except OSError as error:
        place = "the answer" if error.filename is None else str(error.filename)
        return _refused(f"{place}: cannot be written: {error.strerror or error}; check where -o leads")
    if isinstance(ended, Summary):
        return ended, None
    if ended == STOPPED:  # what typer makes of Ctrl-C
        return _stopped(NOTHING_WRITTEN, Summary())
    return Summary(exit_code=ended or 0), None


def _refused(message: str) -> tuple[Summary, str]:
    print(f"error: {printable(message)}", file=sys.stderr)
    return Summary(exit_code=BAD_INPUT), printable(message)


def _stopped(message: str, kept: Summary) -> tuple[Summary, str]:
    exec("")  # noqa: S102  # else Python, if Ctrl-C met such a call, as of a dataclass, kills itself in the end
    print(printable(message), file=sys.stderr)
    return Summary(kept.answer, kept.wrote, kept.next_steps, kept.remarks, STOPPED), printable(message)


def _command_of(app: typer.Typer, name: str, words: Sequence[str]) -> str:
    """The command's name, as in `calib study plot`."""
    place, names = typer.main.get_command(app), [name]
    for word in words:
        if not isinstance(place, TyperGroup) or word not in place.commands:
            break
        place = place.commands[word]
        names.append(word)
    return " ".join(names)


class _Forgiving(io.TextIOWrapper):
    """A stream whose reader may leave, as in `calib ... | head -1`: the work goes on, and nobody hears the rest.

    So it does where the disk that the words go to is full, but that is no one's wish: `failure` says so at the end.
    """

    failure = ""

    def write(self, text: str, /) -> int:
        try:
            return super().write(text)
        except OSError as error:
            return self._unheard(len(text), error)

    def flush(self) -> None:
        try:
            super().flush()
        except OSError as error:
            self._unheard(0, error)

    def _unheard(self, count: int, error: OSError) -> int:
        """Lead nowhere from now on, what is still in the buffer included."""
        if not isinstance(error, BrokenPipeError):
            self.failure = error.strerror or str(error)
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, self.fileno())
        os.close(nowhere)
        return count


def forgive_readers() -> None:
    """Let the readers of this program's standard output and error leave before its end, or not be there at all."""
    if sys.stdout is sys.__stdout__:
        sys.stdout = _forgiving(sys.stdout, OUT)
    if sys.stderr is sys.__stderr__:
        sys.stderr = _forgiving(sys.stderr, ERR)


def not_heard() -> str:
    """Why standard output could not be written to its end; "" if it was, or nobody wished to hear it."""
    if not isinstance(sys.stdout, _Forgiving):
        return ""
    sys.stdout.flush()
    return sys.stdout.failure


def _forgiving(stream: TextIO | None, number: int) -> TextIO:
    if stream is None:  # closed: of the next file that is opened its number would be
        nowhere = os.open(os.devnull, os.O_WRONLY)
        if nowhere != number:
            os.dup2(nowhere, number)
            os.close(nowhere)
        return open(number, "w", encoding="utf-8", closefd=False)
    stream.flush()
    codecs.register_error("plain", _plain)
    return _Forgiving(
        open(number, "wb", closefd=False),  # open to the end of the program
        encoding=stream.encoding,
        errors="plain",
        line_buffering=number == ERR or stream.isatty(),
    )


def _plain(error: UnicodeError) -> tuple[str, int]:
    """Stand in for a character that a terminal does not have."""
    if not isinstance(error, UnicodeEncodeError):
        raise error
    character = error.object[error.start]
    nearest = unicodedata.normalize("NFKD", character).encode("ascii", "ignore").decode()  # `2` of a raised one
    return PLAIN.get(character) or nearest or ascii(character)[1:-1], error.start + 1


@contextmanager
def people_on_stderr() -> Iterator[None]:
    """Standard output is kept for a program: what is printed meanwhile goes to standard error.

    That of child processes and of compiled libraries too, which know nothing of `sys.stdout`.
    """
    if sys.stdout is not None:
        sys.stdout.flush()
    kept: int | None = None
    with suppress(OSError):  # one of them is closed
        kept = os.dup(OUT)
        os.dup2(ERR, OUT)
    try:
        with redirect_stdout(sys.stderr):
            yield
    finally:
        if kept is not None:
            os.dup2(kept, OUT)
            os.close(kept)
