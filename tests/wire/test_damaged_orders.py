"""Orders that are damaged at random: no vehicle breaks, and each that is wrong is refused by a name that the standard has.

    python -m pytest -m campaign tests/wire/test_damaged_orders.py

What the official schemas call wrong has to be refused; what is taken has to keep the rules that they cannot say (`formats.vda.check`).
"""

import json
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from wire.worlds import PLACES, carts

from mrp_sumo.formats.vda.check import check
from mrp_sumo.formats.vda.errors import Reason
from mrp_sumo.formats.vda.messages import action, line_of, node

SCHEMAS = Path(__file__).resolve().parents[3] / "shared" / "reference" / "data" / "vda5050"
NEXT = {"a": "b", "b": "acd", "c": "be", "d": "be", "e": "dc"}
NEXT = {name: list(near) for name, near in NEXT.items()}
JUNK = (None, "", "x", -1, 0, 1, 2**31, 10**30, 1e308, -1e-308, 0.5, 90.0, True, False, [], {}, [[]], {"x": 1}, "x" * 300)
JUNK += ("../../etc", "\ud800", "a/b#+")


def sound(rng, master, vehicle, number):
    """An order, or an update where there is one, with everything in it that one may have and that the vehicle can do."""
    dialect, site = master.dialect, master.fleet.site
    updates = vehicle.is_busy and not vehicle.cancels
    order = vehicle.order
    begin, at = (vehicle.base_end.sequence, vehicle.base_end.name) if updates else (0, vehicle.at)
    stitch = [] if not updates else [action(a.kind, a.name, a.blocking, **a.parameters) for a in vehicle.base_end.actions]
    names = [at]
    for _ in range(int(rng.integers(0, 6))):
        near = NEXT.get(names[-1]) or [n for n in PLACES if site.is_joined(names[-1], n)]
        names.append(str(rng.choice(near)))
    released = int(rng.integers(1, len(names) + 1))
    made = {0: stitch}
    for k in range(int(updates), len(names)):
        if rng.random() < 0.3:
            kind, blocking = str(rng.choice(["pick", "drop", "detectObject"])), str(rng.choice(["NONE", "SOFT", "HARD"]))
            made[k] = [action(kind, f"{number}-{k}", blocking, duration=0.3)]
    nodes = [node(n, begin + 2 * k, k < released, site.place(n)[:2], "L1", made.get(k, ())) for k, n in enumerate(names)]
    edges = [dialect.edge(begin + 2 * k + 1, k + 1 < released, (a, b), 4.0, 1.0) for k, (a, b) in enumerate(pairwise(names))]
    if rng.random() < 0.5 and edges:
        edges[0]["corridor"] = {"leftWidth": 0.5, "rightWidth": 0.5}
        edges[-1]["orientation"] = 1.0
        nodes[-1]["nodePosition"]["theta"] = 1.0
    name, update = (order.name, order.update + 1) if updates else (f"o{number}", 0)
    return {"orderId": name, "orderUpdateId": update, "nodes": nodes, "edges": edges}


def places(document, at=()):
    """Paths of all members."""
    result = [at] if at else []
    inside = document.items() if isinstance(document, dict) else enumerate(document) if isinstance(document, list) else ()
    return result + [path for key, value in inside for path in places(value, (*at, key))]


def damaged(rng, document):
    """The order, wrong in a place or two."""
    for _ in range(int(rng.integers(1, 3))):
        known = places(document)
        *route, last = known[int(rng.integers(len(known)))]
        at = document
        for key in route:
            at = at[key]
        kind = int(rng.integers(6))
        if kind == 0:
            del at[last]
        elif kind == 1:
            at[last] = JUNK[int(rng.integers(len(JUNK)))]
        elif kind == 2 and isinstance(at, list):
            at.append(json.loads(json.dumps(at[last])))
        elif kind == 3 and isinstance(at, list):
            at.reverse()
        elif kind == 4 and isinstance(at[last], int | float):
            at[last] = at[last] + int(rng.integers(-3, 4))
        elif isinstance(at, dict):
            at[last + "X"] = at.pop(last)
    return document


def as_bytes(rng, document):
    """As it is sent, at times damaged on the way."""
    payload = bytearray(json.dumps(document).encode())
    if rng.random() < 0.1:
        k = int(rng.integers(len(payload)))
        payload[k : k + int(rng.integers(0, 20))] = rng.bytes(int(rng.integers(0, 20)))
    return bytes(payload)


def torment(folder, version, count, seed):
    """Send damaged orders to a fleet that drives what it takes. Returns how many were refused, and how many were driven."""
    jsonschema = pytest.importorskip("jsonschema")
    schemas = {
        kind: jsonschema.Draft202012Validator(json.loads((SCHEMAS / version / "json_schemas" / f"{kind}.schema").read_text()))
        for kind in ("order", "state")
    }
    rng, refused, driven = np.random.default_rng(seed), 0, 0
    with carts(folder, version) as master:
        dialect, named = master.dialect, {reason.value[master.dialect.is_new][0] for reason in Reason}
        for number in range(count):
            serial = "robot_0" if rng.random() < 0.5 else "robot_1"
            vehicle = master.fleet.vehicles[master.fleet.robot_of[serial]]
            content = json.loads(json.dumps(sound(rng, master, vehicle, number)))
            document, whole = (
                master.senders[serial].message("order", master.fleet.now_s, content),
                rng.random() < 0.1 and not vehicle.cancels,
            )
            payload = json.dumps(document).encode() if whole else as_bytes(rng, damaged(rng, document))
            before = vehicle.order
            vehicle.refused.clear()
            master.link.publish(serial, "order", payload)
            master.run(0.1)
            state = master.states[serial]
            faults = [error.message for error in schemas["state"].iter_errors(state)]
            assert not faults, (faults, payload)
            taken, errors = vehicle.order is not before, {error["errorType"] for error in state["errors"]} - {"blocked"}
            assert taken != bool(errors) or is_again(payload, before), (errors, payload)
            assert errors <= named and not (whole and errors), (errors, payload)
            refused += bool(errors)
            driven += taken
            if taken:
                document = json.loads(payload)
                faults = [error.message for error in schemas["order"].iter_errors(document)]
                assert not faults, (faults, payload)
                said = list(check([line_of(0.0, dialect.topic(serial, "order"), document)]))
                others = (
                    "is unknown",
                    "orderUpdateId is",
                    "of a new order",
                )  # open schemas, and a log that begins in the midst of an order
                assert not [fault for fault in said if not any(words in fault.text for words in others)], (said, payload)
                master.run(float(rng.uniform(0, 8)))
            if vehicle.is_busy and rng.random() < 0.1:
                master.instant(serial, "cancelOrder")
                master.run(4.0)
    return refused, driven


def is_again(payload, order):
    """Whether it is the last order once more, which is ignored."""
    document = json.loads(payload)
    return order is not None and (document["orderId"], document["orderUpdateId"]) == (order.name, order.update)


@pytest.mark.skipif(not SCHEMAS.is_dir(), reason="no reference data here")
@pytest.mark.parametrize("version", ["2.1", "3.0"])
def test_damaged_orders_are_refused_by_name(tmp_path, version):
    refused, driven = torment(tmp_path, version, 60, 1)
    assert refused > 30 and driven > 8


@pytest.mark.campaign
@pytest.mark.skipif(not SCHEMAS.is_dir(), reason="no reference data here")
@pytest.mark.parametrize("version", ["2.1", "3.0"])
def test_five_thousand_damaged_orders(tmp_path, version):
    refused, driven = torment(tmp_path, version, 5000, 2)
    print(f"{version}: 5000 damaged orders, {refused} refused, {driven} sound all the same and driven, 0 crashes")
