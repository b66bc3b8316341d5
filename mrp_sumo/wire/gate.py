"""Servers for viewers, on this machine alone, and whom they let in.

A page of anybody's in the user's browser can send requests to this machine. A request is therefore answered only when it has the token
that the server's address ends with, names this machine as its host (a name of anybody's may lead here, too), and comes from no other page.
"""

import re
import secrets
import select
import socket
import time
from collections.abc import Collection
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from threading import BoundedSemaphore, Event
from typing import Any

from mrp_sumo.errors import MrpSumoError

HOST = "127.0.0.1"
HERE = re.compile(r"(https?://)?(127\.0\.0\.1|localhost)(:\d{1,5})?")  # as Host and Origin name this machine
MOST_CONNECTIONS = 64  # at a time; what comes beyond is closed
PATIENCE_S = 20.0  # with a viewer that says or takes nothing
BLOCK_BYTES = 2**16
FOXGLOVE = ("https://app.foxglove.dev", "file://")  # where Foxglove's own pages come from: the web's and the desktop's
LISTENERS = (  # what listens: the command that is asked for it, where, and who is let in
    ("`run --live`, `status --live`", "127.0.0.1, a free port or `--port`", "token, Host, Origin"),
    ("`replay --serve`", "127.0.0.1, a free port or `--port`", "token, Host, Origin"),
    ("`studio`", "127.0.0.1, a free port or `--port`; the live view of a run that it starts at another", "token, Host, Origin"),
    (
        "`run --foxglove`",
        "127.0.0.1:8765 or `--port`; behind it Foxglove's own server, at an address of 127.0.0.0/8 drawn by chance",
        "token, Host, Origin (Foxglove's own pages and those of this machine)",
    ),
    ("`run --dds`", "UDP ports of DDS at 127.0.0.1 or `--interface`", "everybody who reaches the interface; it takes no orders"),
    ("`run --gui`", "a free TCP port on all interfaces, until sumo-gui has the one connection that it waits for", "the first who connects"),
)


class LocalServer(ThreadingHTTPServer):
    """A server at a port of 127.0.0.1, with a thread for each connection."""

    daemon_threads = True
    block_on_close = False

    def __init__(self, port: int, handler: "type[LocalHandler]") -> None:
        """Raises MrpSumoError where the port cannot be had."""
        self.token = secrets.token_urlsafe(12)
        self._room = BoundedSemaphore(MOST_CONNECTIONS)
        try:
            super().__init__((HOST, port), handler)
        except (OSError, OverflowError) as error:
            raise MrpSumoError(f"--port {port}: {getattr(error, 'strerror', None) or error}") from None

    @property
    def address(self) -> str:
        return f"http://{HOST}:{self.server_port}/{self.token}/"

    def process_request(self, request: Any, client_address: Any) -> None:
        """Answer in a thread of its own, as long as there are not too many."""
        if self._room.acquire(blocking=False):
            super().process_request(request, client_address)
        else:
            self.shutdown_request(request)

    def process_request_thread(self, request: Any, client_address: Any) -> None:
        """Answer, and make room for another."""
        try:
            super().process_request_thread(request, client_address)
        finally:
            self._room.release()

    def handle_error(self, request: object, client_address: object) -> None:
        """Say nothing of a viewer that goes away."""


class LocalHandler(BaseHTTPRequestHandler):
    """One connection to a LocalServer."""

    timeout = PATIENCE_S
    server: LocalServer
    origins: Collection[str] = ()  # of pages that are let in beside the server's own
    policy = "frame-ancestors 'none'"  # of content: no other page may show its documents within its own

    def place(self) -> str | None:
        """The place that is asked for, without the token; None where nobody is to be let in, and the refusal has been sent."""
        token, _, place = self.path.split("?")[0].removeprefix("/").partition("/")
        if not HERE.fullmatch(self.headers.get("Host", "")):
            reason = "this server is for this machine alone"
        elif not self._is_welcome(self.headers.get("Origin")):
            reason = "this server is not for other pages"
        elif not secrets.compare_digest(token.encode(), self.server.token.encode()):
            reason = "not here: the address that was printed has a token"
        else:
            return place
        self.answer(403, "text/plain; charset=utf-8", reason.encode())
        return None

    def _is_welcome(self, origin: str | None) -> bool:
        own = f"http://{self.headers.get('Host')}"
        return origin is None or origin == own or origin in self.origins or (bool(self.origins) and HERE.fullmatch(origin) is not None)

    def answer(self, status: int, kind: str, body: bytes) -> None:
        """Answer with a document that no other page may use and nobody keeps."""
        self.send_response(status)
        self.send_header("Content-Type", kind)
        self.send_header("Content-Length", str(len(body)))
        self.send_safe_headers()
        self.end_headers()
        self.wfile.write(body)

    def send_safe_headers(self) -> None:
        """Keep a document from other pages, from caches, and its address from whatever it links to."""
        self.send_header("Cache-Control", "no-store")
        self.send_header("Referrer-Policy", "no-referrer")
        self.send_header("X-Content-Type-Options", "nosniff")
        self.send_header("Cross-Origin-Resource-Policy", "same-origin")
        self.send_header("Content-Security-Policy", self.policy)

    def version_string(self) -> str:
        """The server's name."""
        return "mrp_sumo"

    def log_message(self, format: str, *args: object) -> None:
        """Say nothing."""


class Relay(LocalServer):
    """A gate before a server of somebody else's, which lets everybody in."""

    def __init__(self, port: int, origins: Collection[str]) -> None:
        """Raises MrpSumoError where the port cannot be had."""
        super().__init__(port, type("Handler", (_RelayHandler,), {"origins": origins}))
        self.behind = _hidden_address()
        self.is_there = Event()  # the server behind it: who comes before waits

    @property
    def address(self) -> str:
        return f"ws://{HOST}:{self.server_port}/{self.token}/"

    def drain(self) -> None:
        """Wait until viewers have what was sent to them, for two seconds at most; lets nobody in any more."""
        until = time.monotonic() + 2.0
        all(self._room.acquire(timeout=max(0.0, until - time.monotonic())) for _ in range(MOST_CONNECTIONS))


class _RelayHandler(LocalHandler):
    server: Relay

    def do_GET(self) -> None:
        place = self.place()
        if place is None:
            return
        self.server.is_there.wait()
        self.close_connection = True
        with socket.create_connection(self.server.behind, timeout=PATIENCE_S) as behind:
            lines = [f"GET /{place} HTTP/1.1", *(f"{name}: {value}" for name, value in self.headers.items())]
            behind.sendall("\r\n".join((*lines, "", "")).encode("latin-1"))
            self.connection.settimeout(PATIENCE_S)
            _exchange(self.connection, behind)


def _exchange(one: socket.socket, other: socket.socket) -> None:
    """Hand on what each of two says, until one ends."""
    partner = {one: other, other: one}
    while True:
        for speaker in select.select([one, other], [], [])[0]:
            data = speaker.recv(BLOCK_BYTES)
            if not data:
                return
            partner[speaker].sendall(data)


def _hidden_address() -> tuple[str, int]:
    """An address of this machine that pages will not guess; where there is only 127.0.0.1, a port of it."""
    for host in (".".join(map(str, (127, *(1 + secrets.randbelow(254) for _ in range(3))))), HOST):
        try:
            with socket.socket() as probe:
                probe.bind((host, 0))
                return host, int(probe.getsockname()[1])
        except OSError:
            continue
    raise MrpSumoError("no port of this machine is free")
