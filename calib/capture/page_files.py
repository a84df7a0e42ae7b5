"""The files that the live page is made of: a server hands out these, as they are, and no others.

They are asked for beside the page, `ADDRESS/`; so are the WebSocket `ADDRESS/socket`, a photo `ADDRESS/photos/NAME`
and, at the end, the report `ADDRESS/report`.
"""

from dataclasses import dataclass
from functools import cache
from pathlib import Path

import designer.page

PAGE_POLICY = (
    "default-src 'none'; script-src 'self'; worker-src 'self'; style-src 'self'; img-src 'self' blob: data:; "
    "connect-src 'self'; frame-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
)
"""The Content-Security-Policy of the page: nothing is fetched from elsewhere, no script stands in the markup."""
REPORT_POLICY = "frame-ancestors 'self'"
"""Of the report, which the page shows in a frame; what may run in it, the report itself says."""

_OWN = Path(__file__).parent / "parts"
_SHARED = Path(designer.page.__file__).parent / "parts"
_MEDIA = {".html": "text/html", ".css": "text/css", ".js": "text/javascript"}


@dataclass(frozen=True)
class PageFile:
    """One file, as it is sent."""

    content: bytes
    media_type: str  # "text/css; charset=utf-8"


@cache
def page_files() -> dict[str, PageFile]:
    """All files by their names; the page itself is "".

    `page_files()["live.css"].media_type`
    """
    shared = (_SHARED / name for name in ("page.css", "three.min.js", "viewer_shapes.js"))
    files = {path.name: _file(path) for path in (*sorted(_OWN.iterdir()), *shared)}
    return {"" if name == "live.html" else name: file for name, file in files.items()}


def _file(path: Path) -> PageFile:
    return PageFile(path.read_bytes(), f"{_MEDIA[path.suffix]}; charset=utf-8")
