"""A web server on this machine alone for a run under way: the page, the stream of what happens, and a place for orders.

Every address begins with a token that nobody can guess, so that no other page in the browser can watch or steer the run.
"""

import base64
import json
import secrets
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from threading import Thread

from mrp_sumo.errors import MrpSumoError
from mrp_sumo.reports.live.broadcast import Broadcast

MOST_BYTES = 1000  # of an order
WAITING = """<!doctype html><html lang="en"><meta charset="utf-8"><meta name="viewport" content="width=device-width">
<meta name="color-scheme" content="light dark"><meta http-equiv="refresh" content="1"><link rel="icon" href="data:,"><title>mrp_sumo</title>
<body style="font:15px system-ui,sans-serif;display:grid;place-items:center;min-height:80vh"><p>{stage} …</p>"""


class LiveServer:
    """Serves one run on 127.0.0.1 from threads of its own."""

    def __init__(self, broadcast: Broadcast, port: int = 0) -> None:
        """Raises MrpSumoError where the port cannot be had."""
        self.broadcast = broadcast
        self.page = b""  # until there is one
        self.stage = "starting"  # what is done before there is a page
        self.token = secrets.token_urlsafe(12)
        try:
            self._server = _Server(("127.0.0.1", port), _handler(self))
        except (OSError, OverflowError) as error:
            raise MrpSumoError(f"--port {port}: {getattr(error, 'strerror', None) or error}") from None
        self.address = f"http://127.0.0.1:{self._server.server_port}/{self.token}/"

    def start(self) -> None:
        """Serve until `close`."""
        Thread(target=self._server.serve_forever, kwargs={"poll_interval": 0.1}, daemon=True).start()

    def close(self) -> None:
        """Let go of the port."""
        self._server.shutdown()
        self._server.server_close()


class _Server(ThreadingHTTPServer):
    daemon_threads = True
    block_on_close = False

    def handle_error(self, request: object, client_address: object) -> None:
        """A viewer that goes away is no news."""


def _handler(live: LiveServer) -> type[BaseHTTPRequestHandler]:  # noqa: C901  counts all methods of the class
    class Handler(BaseHTTPRequestHandler):
        def do_GET(self) -> None:
            place = self._place()
            if place == "":
                self._answer(200, "text/html; charset=utf-8", live.page or WAITING.format(stage=live.stage).encode())
            elif place == "events":
                self._stream()
            else:
                self._answer(404, "text/plain; charset=utf-8", b"not here")

        def do_POST(self) -> None:
            if self._place() != "control":
                self._answer(404, "text/plain; charset=utf-8", b"not here")
                return
            try:
                order = json.loads(self.rfile.read(min(MOST_BYTES, int(self.headers.get("Content-Length", 0)))))
                why_not = live.broadcast.control(order)
            except (ValueError, RecursionError):
                why_not = "expected JSON"
            self._answer(400 if why_not else 204, "text/plain; charset=utf-8", why_not.encode())

        def _place(self) -> str | None:
            """What is asked for; None without the token."""
            place = self.path.split("?")[0]
            return place.removeprefix(f"/{live.token}/") if place.startswith(f"/{live.token}/") else None

        def _stream(self) -> None:
            self.send_response(200)
            self.send_header("Content-Type", "text/event-stream")
            self.send_header("Cache-Control", "no-store")
            self.end_headers()
            try:
                for text, samples in live.broadcast.stream():
                    line = text or f"event: samples\ndata: {base64.b64encode(samples).decode()}\n\n"
                    self.wfile.write(line.encode())
                    self.wfile.flush()
            except OSError:
                pass  # the viewer has gone
            self.close_connection = True

        def _answer(self, status: int, kind: str, body: bytes) -> None:
            self.send_response(status)
            self.send_header("Content-Type", kind)
            self.send_header("Content-Length", str(len(body)))
            self.send_header("Cache-Control", "no-store")
            self.end_headers()
            self.wfile.write(body)

        def log_message(self, format: str, *args: object) -> None:
            """Say nothing."""

    return Handler
