"""A server of the page for tests: page files over HTTP, and a socket that says what the test chooses."""

import json
import threading
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from http import HTTPStatus
from queue import SimpleQueue

from websockets.datastructures import Headers
from websockets.exceptions import ConnectionClosed
from websockets.http11 import Request, Response
from websockets.sync.server import ServerConnection, serve
from websockets.typing import Subprotocol

from cogrip.view.page import content_security_policy, served_files

TOKEN = "t0ken"
SUBPROTOCOL = Subprotocol("cogrip.view.v1")
PATIENCE_S = 20.0


@dataclass
class PageServer:
    """Serves one scene. `said`: what the page says, without chunk requests; hellos: the first message of each socket."""

    scene: str
    chunks: Sequence[bytes] = ()
    refuse: int | None = None  # close code instead of a scene
    reason: str = ""  # given with it
    said: SimpleQueue[str | bytes] = field(default_factory=SimpleQueue)
    hellos: SimpleQueue[dict[str, object]] = field(default_factory=SimpleQueue)
    asked: list[int] = field(default_factory=list)
    sockets: list[ServerConnection] = field(default_factory=list)
    joined: threading.Semaphore = field(default_factory=lambda: threading.Semaphore(0))
    port: int = 0

    @property
    def address(self) -> str:
        return f"http://127.0.0.1:{self.port}/#{TOKEN}"

    def send(self, message: str | bytes) -> None:
        """Send to the page that came last."""
        self.sockets[-1].send(message)

    def wait_for_page(self) -> None:
        assert self.joined.acquire(timeout=PATIENCE_S), "the page opens its socket"

    def come_again(self) -> None:
        """Break the page's socket, and wait until it has opened another one. What it said before is forgotten."""
        self.sockets[-1].close(1011)
        self.wait_for_page()
        while not self.said.empty():
            self.said.get()

    def answer(self, _: ServerConnection, request: Request) -> Response | None:
        if request.path == "/socket":
            return None
        file = served_files().get(request.path.partition("?")[0])
        if file is None:
            return Response(HTTPStatus.NOT_FOUND, "Not Found", Headers(), b"")
        headers = {
            "Content-Type": file.content_type,
            "Content-Length": str(len(file.content)),
            "Content-Security-Policy": content_security_policy(),
            "X-Content-Type-Options": "nosniff",
        }
        return Response(HTTPStatus.OK, "OK", Headers(headers), file.content)

    def talk(self, socket: ServerConnection) -> None:
        try:
            self.hellos.put(json.loads(socket.recv()))
            if self.refuse is not None:
                socket.close(self.refuse, self.reason)
                return
            socket.send(self.scene)
            self.sockets.append(socket)
            self.joined.release()
            for message in socket:
                wanted = json.loads(message) if isinstance(message, str) else {}
                if wanted.get("type") == "chunk":
                    self.asked.append(wanted["number"])
                    socket.send(self.chunks[wanted["number"]])
                else:
                    self.said.put(message)
        except ConnectionClosed:
            pass


@contextmanager
def serving(server: PageServer) -> Iterator[PageServer]:
    """Serve until the block ends."""
    how = {"process_request": server.answer, "subprotocols": [SUBPROTOCOL], "compression": None, "close_timeout": 1}
    with serve(server.talk, "127.0.0.1", 0, **how) as listening:  # type: ignore[arg-type]
        server.port = listening.socket.getsockname()[1]
        threading.Thread(target=listening.serve_forever, daemon=True).start()
        yield server
        listening.shutdown()
