"""Caps of lanes and arcs on the next step, by hand: a way of two lanes, 10 m and 8 m, whose end may be on an arc."""

from types import SimpleNamespace

import numpy as np
import pytest
from plain_kernels import as_plain_python

from mrp_sumo.search import _bodies


def cap_mps(monkeypatch, s_m, *, reached=1, bend_m=(0.0, 0.0, 3.0), bend_mps=(np.inf, np.inf, 0.5), limit_mps=(np.inf, np.inf, np.inf)):
    """Of a robot at 1 m/s that brakes at 1 m/s2, where it is the `reached`-th visit that it has made; steps of 0.1 s."""
    as_plain_python(monkeypatch, _bodies)
    visits = SimpleNamespace(
        next=np.array([1, 2, -1]),
        at_m=np.array([0.0, 10.0, 18.0]),
        lane=np.array([-1, 0, 1]),
        limit_mps=np.array(limit_mps),
        bend_m=np.array(bend_m),
        bend_mps=np.array(bend_mps),
        reached=np.array([reached]),
    )
    cap = np.empty(1)
    _bodies.lane_limits(0.1, np.ones(1), visits, np.ones(1), np.array([s_m]), cap)
    return float(cap[0])


def test_the_arc_on_which_a_way_ends_has_its_speed(monkeypatch):
    assert cap_mps(monkeypatch, 15.0) == 0.5  # the arc begins at 15 m
    assert cap_mps(monkeypatch, 17.0) == 0.5
    assert 0.5 < cap_mps(monkeypatch, 14.7) < 1.0  # it brakes for it
    assert cap_mps(monkeypatch, 12.0) == np.inf
    assert cap_mps(monkeypatch, 17.0, bend_m=(0.0, 0.0, 0.0), bend_mps=(np.inf,) * 3) == np.inf


def test_an_arc_between_lanes_has_its_speed_on_both(monkeypatch):
    bend = {"bend_m": (0.0, 2.0, 0.0), "bend_mps": (np.inf, 0.4, np.inf)}
    assert cap_mps(monkeypatch, 9.0, reached=0, **bend) == 0.4
    assert cap_mps(monkeypatch, 11.0, **bend) == 0.4
    assert cap_mps(monkeypatch, 12.5, **bend) == np.inf


def test_a_slower_lane_ahead_is_braked_for(monkeypatch):
    slower = {"bend_m": (0.0,) * 3, "bend_mps": (np.inf,) * 3, "limit_mps": (np.inf, np.inf, 0.3)}
    assert cap_mps(monkeypatch, 3.0, reached=0, **slower) == np.inf
    assert cap_mps(monkeypatch, 9.9, reached=0, **slower) == pytest.approx(0.5)
    assert cap_mps(monkeypatch, 10.0, reached=1, **slower) == 0.3
