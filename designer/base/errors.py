"""The one exception that stands for bad input."""

import inspect
import re
from functools import wraps
from types import FunctionType


class InputError(ValueError):
    """A person's input breaks a rule: `except InputError as error: print(error)`.

    The message is one line: the value, the rule, the remedy. The command line prints it as it is and exits with code 2.
    """


class NoAnswerError(InputError):
    """What is sought is not in what was given, though that is as it should be: a command's exit code is 1.

    Args:
        message: why, in one line.
        result: what there is instead, to be told as the result of a capability is; None: the line says it all.
    """

    def __init__(self, message: str, result: object = None) -> None:
        super().__init__(message)
        self.result = result


class NotWrittenError(InputError):
    """A file cannot be written where it is to lie: no room, or no right to. No command goes on without it."""


def offered(found: object, package: str) -> object:
    """What a package offers. A function names what it refuses as in Python: `seen_by`, where a command has `--seen-by`.

    Args:
        found: whose messages name options as they are typed on a command line.
        package: where another process finds the function again.
    """
    if not isinstance(found, FunctionType):
        return found

    @wraps(found)
    def function(*values: object, **options: object) -> object:
        try:
            return found(*values, **options)
        except InputError as error:
            error.args = (_in_python(str(error), inspect.signature(found)),)
            raise

    function.__module__ = package
    return function


def _in_python(message: str, signature: inspect.Signature) -> str:
    """Options that are parameters under their Python names, which may end in a unit: `length_mm`."""
    names = {*signature.parameters}
    takes_all = any(one.kind is one.VAR_KEYWORD for one in signature.parameters.values())

    def name_of(option: re.Match[str]) -> str:
        word = option[1].replace("-", "_")
        alike = {word} if takes_all else {word} & names or {name for name in names if name.rpartition("_")[0] == word}
        return alike.pop() if len(alike) == 1 else option[0]

    return re.sub(r"(?<![\w-])--([a-z][a-z0-9-]*)", name_of, message)
