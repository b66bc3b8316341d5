"""Viewers who go back and forth in a run that is driven meanwhile."""

import itertools
import threading
import time

import pytest

from mrp_sumo.wire.playback import Playback

SECOND_NS = 1_000_000_000


@pytest.fixture
def driven():
    """A playback with a viewer, what the viewer got, and a function that drives the run until a time in a thread."""
    got, threads = [], []
    playback = Playback(lambda topic, t_ns, message: got.append((topic, t_ns // SECOND_NS, message)), lambda position: None)
    playback.listens(1, "/tf")

    def drive(begin, end):
        def steps():
            for t in range(begin, end):
                playback.add([("/map", b"m")] if t == 0 else [("/tf", b"%d" % t)], t * SECOND_NS)

        threads.append(threading.Thread(target=steps))
        threads[-1].start()
        return threads[-1]

    yield playback, got, drive
    playback.leaves(1, "/tf")
    for thread in threads:
        thread.join(60)
    playback.close()


def stands(thread, got, count):
    """Whether a thread has said `count` messages, and waits."""
    until = time.monotonic() + 60
    while len(got) < count and time.monotonic() < until:
        thread.join(0.01)
    thread.join(0.1)
    return thread.is_alive()


@pytest.mark.parametrize("look_s", [None, 0.003], ids=["a clock", "a clock that goes on at each look"])
def test_viewer_who_goes_back_sees_what_was_said_and_then_what_comes(driven, look_s, monkeypatch):
    playback, got, drive = driven
    if look_s is not None:
        monkeypatch.setattr("time.monotonic", itertools.count(time.monotonic(), look_s).__next__)
    playback.control(True, 1000.0, None)
    drive(0, 6).join(60)
    assert got == [("/map", 0, b"m"), *(("/tf", t, b"%d" % t) for t in range(1, 6))]
    got.clear()
    position = playback.control(True, 1000.0, 2 * SECOND_NS)
    assert (position.now_ns, position.buffering) == (2 * SECOND_NS, False)
    drive(6, 7).join(60)
    assert got == [("/map", 2, b"m"), *(("/tf", t, b"%d" % t) for t in range(2, 7))]


def test_viewer_who_goes_ahead_has_the_run_driven_there_and_is_shown_nothing_between(driven):
    playback, got, drive = driven
    position = playback.control(False, 1000.0, 4 * SECOND_NS)
    assert (position.now_ns, position.buffering) == (4 * SECOND_NS, True)
    assert stands(drive(0, 9), got, 2)  # as it is paused there
    assert got == [("/map", 4, b"m"), ("/tf", 4, b"4")]


def test_run_goes_on_when_the_viewer_who_paused_it_leaves(driven):
    playback, got, drive = driven
    playback.control(False, 1000.0, None)
    thread = drive(0, 3)
    assert stands(thread, got, 1) and got == [("/map", 0, b"m")]
    playback.leaves(1, "/tf")
    thread.join(60)
    assert not thread.is_alive()


def test_late_viewer_gets_what_was_last_said_on_its_topics(driven):
    playback, got, drive = driven
    playback.control(True, 1000.0, None)
    drive(0, 3).join(60)
    got.clear()
    playback.listens(2, "/map")
    playback.finish()
    assert got == [("/map", 2, b"m")]
