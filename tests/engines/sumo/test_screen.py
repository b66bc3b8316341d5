"""sumo-gui without a screen is refused before anything is planned."""

import socket
from contextlib import closing

import pytest

from mrp_sumo.engines.sumo.screen import require_screen
from mrp_sumo.errors import ExecutionError


@pytest.mark.parametrize(
    ("display", "fault"),
    [
        ("", "DISPLAY is not set"),
        ("here", "DISPLAY is 'here', expected such as :0"),
        (":4711", "nothing answers at DISPLAY=:4711"),
        ("127.0.0.1:1.0", "nothing answers at DISPLAY=127.0.0.1:1.0"),
    ],
)
def test_display_without_a_server_is_refused_in_a_sentence(monkeypatch, display, fault):
    monkeypatch.setenv("DISPLAY", display)
    with pytest.raises(ExecutionError) as error:
        require_screen()
    assert str(error.value) == f"sumo-gui needs a screen, and {fault}; --live shows a run in the browser"


def test_display_with_a_server_is_taken(monkeypatch):
    with closing(socket.socket(socket.AF_UNIX)) as server:
        server.bind("\0/tmp/.X11-unix/X4712")
        server.listen()
        monkeypatch.setenv("DISPLAY", ":4712.0")
        require_screen()
