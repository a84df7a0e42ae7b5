"""The program's name, and the one it had before: `as_written_today(text)` reads files of either.

Files say whose they are: JSON and TOML by `"format": "NAME.kind"`, tables by a first line `# NAME kind, version 1`.
"""

import re

NAME, FORMER = "ringsolid", "ringforge"
_FORMER = re.compile(
    r'((?:^|[{,\s])"?format"?\s*[:=]\s*"|\A\ufeff?# |<meta name="generator" content=")' + FORMER + "(?=[. ])"
)
"""Where a file says its kind by the former name."""


def as_written_today(text: str) -> str:
    """The text, or the beginning, of a file with its marks under the present name."""
    return _FORMER.sub(rf"\g<1>{NAME}", text) if FORMER in text else text
