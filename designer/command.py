"""How a command line ends: well, or with one line and an exit code."""

import sys

import typer

from designer.errors import InputError

BAD_INPUT, STOPPED = 2, 130


def run(app: typer.Typer) -> None:
    """Run a command line and leave the program; bad input ends in one line on standard error and exit code 2."""
    try:
        code = app(sys.argv[1:] or ["--help"], standalone_mode=False) or 0
    except typer.TyperException as error:
        code = _fail(error.format_message(), BAD_INPUT)
    except InputError as error:
        code = _fail(str(error), BAD_INPUT)
    except OSError as error:
        place = "the answer" if error.filename is None else str(error.filename)
        code = _fail(f"{place}: cannot be written: {error.strerror or error}; check where -o leads", BAD_INPUT)
    except (typer.Abort, KeyboardInterrupt):
        code = STOPPED
    if code == STOPPED:
        _fail("stopped; nothing was written", STOPPED)
    sys.exit(code)


def _fail(message: str, code: int) -> int:
    print(f"error: {printable(message)}", file=sys.stderr)
    return code


def printable(text: str) -> str:
    """Text as one line, with characters that would steer a terminal escaped: file names may hold any."""
    line = " ".join(text.split())
    return "".join(c if c.isprintable() else c.encode("unicode_escape", "backslashreplace").decode() for c in line)
