"""A server that says to the live page what a test tells it to, and keeps what the page says."""

import asyncio
import socket
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field

import numpy as np
import uvicorn
from numpy.typing import NDArray
from starlette.applications import Starlette
from starlette.requests import Request
from starlette.responses import FileResponse, HTMLResponse, Response
from starlette.routing import Route, WebSocketRoute
from starlette.websockets import WebSocket, WebSocketDisconnect

from calib.capture.messages import (
    FrameHeader,
    LookMessage,
    Message,
    PageCommand,
    command_from,
    header_of,
    text_of,
    with_header,
)
from calib.capture.server import MEDIA, PAGE_POLICY, REPORT_POLICY, page_files
from tests.support.pages import png
from tests.support.waiting import wait_until

REPORT = "<!doctype html><title>report</title><h1>The report</h1><a href=#x>part</a><a href=a.json>file</a>"
Frame = tuple[FrameHeader, NDArray[np.uint8]]


@dataclass
class ScriptedServer:
    """What is said at first and to each frame, and what was heard."""

    first: list[Message]
    answer: Callable[[FrameHeader], LookMessage] | None = None
    photos: dict[str, bytes] = field(default_factory=dict)
    address: str = ""
    frames: list[Frame] = field(default_factory=list)
    commands: list[PageCommand] = field(default_factory=list)
    sockets: list[WebSocket] = field(default_factory=list)
    is_refusing: bool = False
    _loop: asyncio.AbstractEventLoop | None = None

    def say(self, *messages: Message) -> None:
        """Tell the newest page."""
        for message in messages:
            self._run(self.sockets[-1].send_text(text_of(message)))

    def show(self, header: FrameHeader, jpeg: bytes) -> None:
        """Send the newest page a picture of another source."""
        self._run(self.sockets[-1].send_bytes(with_header(header, jpeg)))

    def hang_up(self) -> None:
        """Close the newest page's socket."""
        self._run(self.sockets[-1].close())

    def _run(self, work: "asyncio.Future[None] | object") -> None:
        assert self._loop is not None
        asyncio.run_coroutine_threadsafe(work, self._loop).result(10)  # type: ignore[arg-type]

    def heard(self, kind: str) -> PageCommand:
        """The first command of this kind, which must come; earlier ones are forgotten with it."""
        wait_until(lambda: any(said.kind == kind for said in self.commands))
        row = next(row for row, said in enumerate(self.commands) if said.kind == kind)
        said = self.commands[row]
        del self.commands[: row + 1]
        return said

    async def talk(self, page: WebSocket) -> None:
        """One page, as long as it is there."""
        self._loop = asyncio.get_running_loop()
        if self.is_refusing:
            await page.close()
            return
        await page.accept()
        for message in self.first:
            await page.send_text(text_of(message))
        self.sockets.append(page)
        try:
            while True:
                await self._hear(page, await page.receive())
        except (WebSocketDisconnect, RuntimeError):
            return

    async def _hear(self, page: WebSocket, said: "dict[str, object] | object") -> None:
        assert isinstance(said, dict)
        if said["type"] == "websocket.disconnect":
            raise WebSocketDisconnect
        if (text := said.get("text")) is not None:
            self.commands.append(command_from(str(text)))
            return
        header, image = header_of(said["bytes"])
        grey = np.frombuffer(image, dtype=np.uint8).reshape(header.height, header.width)
        self.frames = [*self.frames[-20:], (header, grey)]
        if self.answer is not None:
            await page.send_text(text_of(self.answer(header)))


def _app(server: ScriptedServer) -> Starlette:
    def file(request: Request) -> Response:
        found = page_files().get(str(request.path_params.get("name", "")))
        if found is None:
            return Response(status_code=404)
        headers = {"Content-Security-Policy": PAGE_POLICY, "Cache-Control": "no-store"}
        return FileResponse(found, media_type=MEDIA[found.suffix], headers=headers)

    def photo(request: Request) -> Response:
        return Response(server.photos.get(str(request.path_params["name"]), png(60, 40)), media_type="image/png")

    def report(_: Request) -> Response:
        return HTMLResponse(REPORT, headers={"Content-Security-Policy": REPORT_POLICY})

    return Starlette(
        routes=[
            WebSocketRoute("/token/socket", server.talk),
            Route("/token/report", report),
            Route("/token/photos/{name}", photo),
            Route("/token/", file),
            Route("/token/{name}", file),
        ]
    )


@contextmanager
def scripted_server(
    *first: Message, answer: Callable[[FrameHeader], LookMessage] | None = None
) -> Iterator[ScriptedServer]:
    """A server on some port of this machine, stopped at the end."""
    server = ScriptedServer(list(first), answer)
    with socket.create_server(("127.0.0.1", 0)) as port:
        server.address = f"http://127.0.0.1:{port.getsockname()[1]}/token/"
        running = uvicorn.Server(
            uvicorn.Config(_app(server), log_level="error", lifespan="off", ws_max_size=100_000_000)
        )
        thread = threading.Thread(target=running.run, kwargs={"sockets": [port]}, daemon=True)
        thread.start()
        try:
            yield server
        finally:
            running.should_exit = True
            running.force_exit = True
            thread.join(10)
