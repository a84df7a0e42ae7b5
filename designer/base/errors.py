"""The one exception that stands for bad input."""


class InputError(ValueError):
    """A person's input breaks a rule: `except InputError as error: print(error)`.

    The message is one line: the value, the rule, the remedy. The command line prints it as it is and exits with code 2.
    """


class NotWrittenError(InputError):
    """A file cannot be written where it is to lie: no room, or no right to. No command goes on without it."""
