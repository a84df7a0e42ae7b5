"""The server of the live page: on this machine only, for whoever knows its address, and for no other page.

A page of another site may make the browser send requests here. It knows neither the token in the address, nor can it
say that it is ours: `Host` must be this machine by its own name (which a rebound name server cannot fake), and a
WebSocket's `Origin` must be this server.

The files that the page is made of are asked for beside the page, `ADDRESS/`, and are handed out as they are, and no
others; so are the WebSocket `ADDRESS/socket`, a photo `ADDRESS/photos/NAME` and, at the end, the report
`ADDRESS/report`.
"""

import asyncio
import secrets
import socket
from collections.abc import Awaitable, Callable
from contextlib import suppress
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

import designer.page
from calib.capture.messages import LookMessage, Message, PageCommand, StateMessage, command_from, header_of, text_of
from calib.capture.sources import Frame
from designer.base.errors import InputError

if TYPE_CHECKING:
    from starlette.applications import Starlette
    from starlette.requests import Request
    from starlette.responses import Response
    from starlette.websockets import WebSocket

LOOPBACK = "127.0.0.1"
MOST_BYTES = 64 * 2**20
"""Of a message: a frame of 60 megapixels."""
MOST_SIDE_PX = 20_000
REFUSED = "this is the page of a calib live that runs on this machine; open the address that it printed\n"
COMMON_HEADERS = {
    "Cache-Control": "no-store", "Referrer-Policy": "no-referrer", "X-Content-Type-Options": "nosniff",
    "Cross-Origin-Resource-Policy": "same-origin", "Cross-Origin-Opener-Policy": "same-origin",
}  # fmt: skip
PAGE_POLICY = (
    "default-src 'none'; script-src 'self'; worker-src 'self'; style-src 'self'; img-src 'self' blob: data:; "
    "connect-src 'self'; frame-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
)
"""The Content-Security-Policy of the page: nothing is fetched from elsewhere, no script stands in the markup."""
PHOTO_POLICY = "default-src 'none'"
REPORT_POLICY = "frame-ancestors 'self'"
"""Of the report, which the page shows in a frame; what may run in it, the report itself says."""
MEDIA = {".html": "text/html", ".css": "text/css", ".js": "text/javascript"}
"""Of the page's files, whatever a machine calls them; of photos their suffix tells it."""
SHARED = ("page.css", "three.min.js", "viewer_shapes.js")
"""Files of all pages."""
TAKEN_OVER, NOT_OURS = 4001, 4003
BACKLOG = 64
"""Messages that wait for a page that does not read; further pictures and looks are of no use to it."""


@cache
def page_files() -> dict[str, Path]:
    """The files that the page is made of, by their names; the page itself is ""."""
    shared = (Path(designer.page.__file__).parent / "parts" / name for name in SHARED)
    files = {path.name: path for path in (*(Path(__file__).parent / "parts").iterdir(), *shared)}
    return {"" if name == "live.html" else name: path for name, path in files.items()}


class Pages:
    """The pages that are open, of which the newest has the session."""

    def __init__(
        self, greet: Callable[[], None], put: Callable[[Frame], None], do: Callable[[PageCommand], None]
    ) -> None:
        self.greet, self.put, self.do = greet, put, do
        self._loop: asyncio.AbstractEventLoop | None = None
        self._out: asyncio.Queue[str | bytes | None] | None = None
        self._state: StateMessage | None = None

    @property
    def has_one(self) -> bool:
        """Whether a page is open."""
        return self._out is not None

    def tell(self, message: Message) -> None:
        """A message to the page that has the session; of any thread."""
        if isinstance(message, StateMessage):
            self._state = message
        self.send(text_of(message), may_be_lost=isinstance(message, LookMessage))

    def send(self, data: str | bytes, *, may_be_lost: bool = True) -> None:
        """A text, or a frame's picture; of any thread."""
        loop = self._loop
        if loop is not None and not loop.is_closed():
            with suppress(RuntimeError):  # it closes just now
                loop.call_soon_threadsafe(self._put_out, data, may_be_lost)

    def _put_out(self, data: str | bytes, may_be_lost: bool) -> None:
        if self._out is not None and not (may_be_lost and self._out.qsize() > BACKLOG):
            self._out.put_nowait(data)

    async def serve(self, page: "WebSocket") -> None:
        """Talk to a page until it is closed, or another one takes over."""
        await page.accept()
        self._loop = asyncio.get_running_loop()
        if self._out is not None:
            self._out.put_nowait(None)
        mine: asyncio.Queue[str | bytes | None] = asyncio.Queue()
        self._out = mine
        writing = asyncio.create_task(self._write(page, mine))
        self.greet()
        try:
            await self._read(page, mine)
        finally:
            if self._out is mine:
                self._out = None
            mine.put_nowait(None)
            await asyncio.gather(writing, return_exceptions=True)  # a page that is gone cannot be written to

    async def _write(self, page: "WebSocket", mine: "asyncio.Queue[str | bytes | None]") -> None:
        while (data := await mine.get()) is not None:
            await (page.send_text(data) if isinstance(data, str) else page.send_bytes(data))
        if self._out is not None and self._out is not mine and self._state is not None:
            await page.send_text(text_of(replace(self._state, is_here=False)))
            await page.close(TAKEN_OVER)

    async def _read(self, page: "WebSocket", mine: "asyncio.Queue[str | bytes | None]") -> None:
        """Frames and commands; what is neither is passed over, as is what a page says that has the session no more."""
        while (message := await page.receive())["type"] != "websocket.disconnect":
            text, data = message.get("text"), message.get("bytes")
            with suppress(ValueError, RecursionError, InputError):
                if self._out is not mine:
                    continue
                if text is not None:
                    self.do(command_from(text))
                elif data is not None:
                    self.put(frame_of(data))


def frame_of(data: bytes) -> Frame:
    """A frame from a page's message; ValueError: it is none."""
    header, image = header_of(data)
    if not (0 < header.width <= MOST_SIDE_PX and 0 < header.height <= MOST_SIDE_PX and header.source == 0):
        raise ValueError("a frame of no size")
    if len(image) != header.width * header.height:
        raise ValueError("a frame of another size than its header says")
    pixels = np.frombuffer(image, dtype=np.uint8).reshape(header.height, header.width).copy()
    return Frame(header.source, header.number, header.time_s, pixels)


def application(
    token: str, port: int, pages: Pages, photo_of: Callable[[str], Path | None], report: Callable[[], Path | None]
) -> "Starlette":
    """What answers requests.

    Args:
        token: in every address.
        port: that it is bound to.
        pages: that talk to the session.
        photo_of: the file of a photo's name; None: there is no such photo.
        report: the report, at the end; None: not yet.
    """
    from starlette.applications import Starlette
    from starlette.responses import FileResponse, PlainTextResponse
    from starlette.routing import Route, WebSocketRoute

    hosts = {f"{LOOPBACK}:{port}", f"localhost:{port}"}

    def is_ours(request: "Request | WebSocket") -> bool:
        given = str(request.path_params.get("token", ""))
        return request.headers.get("host") in hosts and secrets.compare_digest(given.encode(), token.encode())

    def file_of(path_of: Callable[[str], Path | None], policy: str) -> "Callable[[Request], Awaitable[Response]]":
        async def answer(request: "Request") -> "Response":
            path = path_of(request.path_params.get("name", "")) if is_ours(request) else None
            if path is None or not path.is_file():
                return PlainTextResponse(REFUSED, 403, COMMON_HEADERS)
            headers = {**COMMON_HEADERS, "Content-Security-Policy": policy}
            return FileResponse(path, headers=headers, media_type=MEDIA.get(path.suffix))

        return answer

    async def talk(page: "WebSocket") -> None:
        if is_ours(page) and page.headers.get("origin") in {f"http://{host}" for host in hosts}:
            await pages.serve(page)
        else:
            await page.close(NOT_OURS)

    part = file_of(page_files().get, PAGE_POLICY)
    return Starlette(
        routes=[
            Route("/{token}/", part),
            Route("/{token}/report", file_of(lambda _: report(), REPORT_POLICY)),
            Route("/{token}/photos/{name}", file_of(photo_of, PHOTO_POLICY)),
            Route("/{token}/{name}", part),
            WebSocketRoute("/{token}/socket", talk),
            Route("/{path:path}", file_of(lambda _: None, PAGE_POLICY)),
        ]
    )


def bound_socket(port: int) -> socket.socket:
    """A socket that listens to this machine alone; port 0: any that is free.

    Raises:
        InputError: the port is taken, or may not be used.
    """
    found = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
    found.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    try:
        found.bind((LOOPBACK, port))
        found.listen()  # a browser that is quicker than the server waits for it
    except (OSError, OverflowError) as error:
        found.close()
        why = getattr(error, "strerror", None) or str(error)
        raise InputError(f"--port {port}: cannot be used: {why}; give another, or 0 for any that is free") from None
    return found
