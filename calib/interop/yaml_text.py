"""YAML of other tools, read without trust.

All scalars stay text, tags and merge keys mean nothing, and an alias is a reference, not a copy; so a small file
cannot make large or foreign objects.
"""

import re
from collections.abc import Collection

import yaml

from calib.interop.format import MAX_FILE_BYTES
from designer.base.errors import InputError

_DIRECTIVE = re.compile(r"\A\s*%YAML[^\n]*\n")
"""OpenCV's first line, `%YAML:1.0`, is not YAML."""


MOST_NODES, DEEPEST = 10_000, 30
"""Values of a document, and how deep they may be nested: parsing takes time in proportion to their product."""


class _BoundedLoader(yaml.BaseLoader):
    """A loader that stops where a document becomes larger or deeper than any camera is."""

    def __init__(self, text: str) -> None:
        super().__init__(text)
        self.nodes = self.depth = 0

    def compose_node(self, parent: yaml.Node | None, index: int) -> yaml.Node | None:
        """A value and all in it.

        Raises:
            RecursionError: too deep.
            yaml.YAMLError: too many.
        """
        self.nodes, self.depth = self.nodes + 1, self.depth + 1
        if self.depth > DEEPEST:
            raise RecursionError
        if self.nodes > MOST_NODES:
            raise yaml.YAMLError(f"more than {MOST_NODES} values, where a camera file has fewer")
        node = super().compose_node(parent, index)
        self.depth -= 1
        return node


def only_keys(text: str, names: Collection[str]) -> str:
    """A YAML text with nothing but the entries of those names at its top; lines keep their numbers.

    OpenCV's files may hold all image points of a calibration, which are long to parse.
    """
    lines, is_wanted = [], False
    for line in text.splitlines():
        if line[:1].strip(" \t-#]}"):  # neither within an entry nor a comment
            is_wanted = line.partition(":")[0].strip(" \t\"'") in names
        lines.append(line if is_wanted else "")
    return "\n".join(lines)


def parse_yaml(text: str, origin: str) -> object:
    """The first document in a YAML text: a tree of dict, list and str.

    Raises:
        InputError: not YAML, too long or nested too deep; the message names file and place.
    """
    if len(text) - text.count("\n") > MAX_FILE_BYTES:
        raise InputError(f"{origin}: more than {MAX_FILE_BYTES} characters; a YAML camera file is smaller")
    try:
        # The first only: printed messages end with a mark that begins another.
        document: object = next(iter(yaml.load_all(_DIRECTIVE.sub("", text), _BoundedLoader)), None)
        return document
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        place = "" if mark is None else f"line {mark.line + 1}, column {mark.column + 1}: "
        raise InputError(f"{origin}: {place}{error.problem or 'not valid YAML'}; not valid YAML") from None
    except yaml.YAMLError as error:
        raise InputError(f"{origin}: {' '.join(str(error).split())[:120]}; not valid YAML") from None
    except RecursionError:
        raise InputError(f"{origin}: nested too deep for a camera file") from None
    except (ValueError, OverflowError):  # an escape such as "\UFFFFFFFF" that is no character
        raise InputError(f"{origin}: not valid YAML") from None
