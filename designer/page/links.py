"""Links from a page to the files beside it: inside its folder, whatever the files are called."""

import re
from urllib.parse import quote

_SCHEME = re.compile(r"[A-Za-z][A-Za-z0-9+.-]*://|[A-Za-z]:")
_CONTROL = re.compile(r"[\x00-\x1f\x7f]")


def href(path: str) -> str:
    """The relative URL of a file, percent-encoded (RFC 3986, section 4.2).

    Colons become %3A, so no path can be read as a scheme.

    Raises:
        ValueError: absolute, with a scheme or drive, upwards, with a backslash (a separator to browsers) or a control
            character, or empty.
    """
    if not is_linkable(path):
        raise ValueError(f"{path!r}: is no path inside the page's folder")
    return quote(path, safe="/", errors="surrogateescape")


def is_linkable(path: str) -> bool:
    """Whether `href` has a URL for the path: a builder leaves the link off where it has none."""
    if not path or path.startswith("/") or "\\" in path or _SCHEME.match(path) or _CONTROL.search(path):
        return False
    return all(part not in {"", ".", ".."} for part in path.split("/"))
