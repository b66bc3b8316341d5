"""Who is let in to servers of this machine, and that the document lists all of them."""

import http.client
import re
import socket
import threading
from pathlib import Path

import pytest

from mrp_sumo.wire.gate import FOXGLOVE, LISTENERS, MOST_CONNECTIONS, LocalHandler, LocalServer, Relay

PROJECT = Path(__file__).parents[2]


class Page(LocalHandler):
    def do_GET(self):
        if self.place() is not None:
            self.answer(200, "text/plain", b"in")


@pytest.fixture
def serving():
    """Start a server; it ends with the test."""
    servers = []

    def start(server):
        servers.append(server)
        threading.Thread(target=server.serve_forever, kwargs={"poll_interval": 0.02}, daemon=True).start()
        return server

    yield start
    for server in servers:
        server.shutdown()
        server.server_close()


def status(server, path=None, **headers):
    connection = http.client.HTTPConnection("127.0.0.1", server.server_port, timeout=60)
    connection.request("GET", f"/{server.token}/" if path is None else path, headers=headers)
    return connection.getresponse().status


def test_only_requests_with_the_token_to_this_machine_from_its_own_page_are_answered(serving):
    server = serving(LocalServer(0, Page))
    port = server.server_port
    assert status(server) == status(server, Host=f"localhost:{port}") == status(server, Origin=f"http://127.0.0.1:{port}") == 200
    assert status(server, "/") == status(server, f"/{server.token[:-1]}/") == status(server, f"/x/{server.token}/") == 403
    for host in ("evil.example", f"evil.example:{port}", f"127.0.0.1.evil.example:{port}", f"localhost:{port}.evil.example", "", "["):
        assert status(server, Host=host) == 403
    for origin in ("https://evil.example", "null", f"http://127.0.0.1:{port + 1}", f"https://127.0.0.1:{port}", *FOXGLOVE):
        assert status(server, Origin=origin) == 403


@pytest.mark.slow
def test_connections_beyond_the_limit_are_closed_and_there_is_room_again_afterwards(serving):
    server = serving(LocalServer(0, Page))
    address = ("127.0.0.1", server.server_port)
    waiting = [socket.create_connection(address) for _ in range(MOST_CONNECTIONS)]
    with socket.create_connection(address, timeout=60) as beyond:
        assert beyond.recv(1) == b""
    for each in waiting:
        each.sendall(b"GET / HTTP/1.1\r\nHost: localhost\r\n\r\n")
        assert each.recv(12) == b"HTTP/1.0 403"
        each.close()
    assert status(server) == 200


def test_relay_hands_on_what_foxgloves_pages_say_and_nothing_of_others(serving):
    relay = serving(Relay(0, FOXGLOVE))
    said = []

    def echo():
        with behind, behind.accept()[0] as viewer:
            said.append(viewer.recv(1000))
            viewer.sendall(b"HTTP/1.1 101 in\r\n\r\n")
            viewer.sendall(viewer.recv(1000).upper())

    for origin in ("https://evil.example", "http://127.0.0.1.evil.example", "http://127.0.0.1:80.evil.example", "http://[", "null"):
        assert status(relay, Origin=origin) == 403
    assert status(relay, "/") == status(relay, Host="evil.example") == 403
    behind = socket.create_server(relay.behind)
    relay.is_there.set()
    for origin in (*FOXGLOVE, "http://localhost:8080"):
        behind = behind if behind.fileno() >= 0 else socket.create_server(relay.behind)
        thread = threading.Thread(target=echo)
        thread.start()
        with socket.create_connection(("127.0.0.1", relay.server_port), timeout=60) as viewer:
            head = f"GET /{relay.token}/ HTTP/1.1\r\nHost: localhost\r\nOrigin: {origin}\r\nUpgrade: websocket\r\n\r\n"
            viewer.sendall(head.encode())
            assert viewer.recv(1000).startswith(b"HTTP/1.1 101")
            viewer.sendall(b"hello")
            assert viewer.recv(1000) == b"HELLO"
        thread.join()
    assert len(said) == 3 and all(b"Upgrade: websocket" in each and relay.token.encode() not in each for each in said)


def test_security_page_lists_what_listens():
    rows = ["| command | where | who is let in |", "|---|---|---|", *(f"| {' | '.join(row)} |" for row in LISTENERS)]
    assert "\n".join(rows) in (PROJECT / "SECURITY.md").read_text()


def test_nothing_else_listens():
    listens = re.compile(
        r"\.bind\(\(|\.listen\(|HTTPServer|start_server|create_server|import traci|DomainParticipant\(|LocalServer|Relay\("
    )
    files = {p for room in ("mrp_sumo", "planners") for p in (PROJECT / room).rglob("*.py") if listens.search(p.read_text())}
    assert {str(file.relative_to(PROJECT)) for file in files} == {
        "mrp_sumo/cli/replay.py",
        "mrp_sumo/engines/sumo/session.py",
        "mrp_sumo/reports/live/server.py",
        "mrp_sumo/studio/server.py",
        "mrp_sumo/wire/dds.py",
        "mrp_sumo/wire/foxglove.py",
        "mrp_sumo/wire/gate.py",
    }
