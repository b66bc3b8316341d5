"""A web server on this machine alone for a run under way: the page, the stream of what happens, and a place for orders.

Every address begins with a token that nobody can guess, so that no other page in the browser can watch or steer the run.
"""

import base64
import json
from threading import Thread

from mrp_sumo.reports.live.broadcast import Broadcast
from mrp_sumo.wire.gate import LocalHandler, LocalServer

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
        self._server = LocalServer(port, _handler(self))
        self.address = self._server.address

    def start(self) -> None:
        """Serve until `close`."""
        Thread(target=self._server.serve_forever, kwargs={"poll_interval": 0.1}, daemon=True).start()

    def close(self) -> None:
        """Let go of the port."""
        self._server.shutdown()
        self._server.server_close()


def _handler(live: LiveServer) -> type[LocalHandler]:
    class LiveHandler(LocalHandler):
        def do_GET(self) -> None:
            place = self.place()
            if place == "":
                self.answer(200, "text/html; charset=utf-8", live.page or WAITING.format(stage=live.stage).encode())
            elif place == "events":
                self._stream()
            elif place is not None:
                self.answer(404, "text/plain; charset=utf-8", b"not here")

        def do_POST(self) -> None:
            place = self.place()
            if place is None:
                return
            if place != "control":
                self.answer(404, "text/plain; charset=utf-8", b"not here")
                return
            try:
                order = json.loads(self.rfile.read(min(MOST_BYTES, int(self.headers.get("Content-Length", 0)))))
                why_not = live.broadcast.control(order)
            except (ValueError, RecursionError):
                why_not = "expected JSON"
            self.answer(400 if why_not else 204, "text/plain; charset=utf-8", why_not.encode())

        def _stream(self) -> None:
            self.send_response(200)
            self.send_header("Content-Type", "text/event-stream")
            self.send_safe_headers()
            self.end_headers()
            try:
                for text, samples in live.broadcast.stream():
                    line = text or f"event: samples\ndata: {base64.b64encode(samples).decode()}\n\n"
                    self.wfile.write(line.encode())
                    self.wfile.flush()
            except OSError:
                pass  # the viewer has gone
            self.close_connection = True

    return LiveHandler
