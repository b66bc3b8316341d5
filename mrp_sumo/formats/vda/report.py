"""Messages of a vehicle: its state, with errors, and its visualization."""

import math
from collections.abc import Iterator

from mrp_sumo.formats.vda import errors
from mrp_sumo.formats.vda.abilities import BREAKDOWN, EMERGENCY_STOP, FIELD, LOST
from mrp_sumo.formats.vda.errors import Reason, RefusalError, error, error_of
from mrp_sumo.formats.vda.messages import Json, StateContent, state, states_of
from mrp_sumo.formats.vda.order import Edge, Node
from mrp_sumo.formats.vda.vehicle import ActionProgress, Vehicle


def state_of(vehicle: Vehicle, now_s: float) -> Json:
    """The payload of a state. Nothing has changed afterwards."""
    vehicle.has_changed = False
    body, own = vehicle.body, vehicle.site.place(vehicle.at)
    document = {"nodes": [_said_node(n) for n in vehicle.nodes], "edges": [_said_edge(e) for e in vehicle.edges]}
    nodes, edges = states_of(document, vehicle.passed)
    place, velocity = _motion(vehicle)
    return vehicle.sender.message(
        "state",
        now_s,
        state(
            vehicle.dialect,
            StateContent(
                order=(vehicle.order.name, vehicle.order.update) if vehicle.order else ("", 0),
                last=(vehicle.last_node, vehicle.passed),
                nodes=nodes,
                edges=edges,
                place=place,
                velocity=velocity,
                driving=body.moves,
                paused=vehicle.paused,
                away_m=math.hypot(body.x_m - own[0], body.y_m - own[1]) if own else 0.0,
                actions=[_said_doing(vehicle, doing) for doing in vehicle.doings.values()],
                instants=[_said_doing(vehicle, doing) for doing in vehicle.instants.values()],
                power=(vehicle.percent, vehicle.charging),
                errors=list(_errors(vehicle)),
                stopped=EMERGENCY_STOP in vehicle.faults,
                violated=FIELD in vehicle.faults or bool(vehicle.blocked_by),
                loads=[vehicle.load] if vehicle.load else [],
            ),
        ),
    )


def view_of(vehicle: Vehicle, now_s: float) -> Json:
    """The payload of a visualization."""
    reference = {"referenceStateHeaderId": max(0, vehicle.sender.count.get("state", 0) - 1)} if vehicle.dialect.is_new else {}
    place, velocity = _motion(vehicle)
    return vehicle.sender.message("visualization", now_s, {**reference, vehicle.dialect.place_key: place, "velocity": velocity})


def _motion(vehicle: Vehicle) -> tuple[Json, Json]:
    """Position and velocity."""
    body = vehicle.body
    place = vehicle.dialect.place(body.x_m, body.y_m, body.yaw_rad, body.map_id, known=LOST not in vehicle.faults)
    return place, {"vx": round(body.speed_mps, 6), "vy": 0.0, "omega": round(body.turn_rad_s, 6)}


def _errors(vehicle: Vehicle) -> Iterator[Json]:
    yield from vehicle.refused.values()
    if LOST in vehicle.faults:
        lost = RefusalError(Reason.LOCALIZATION, "the vehicle does not know where it is: initPosition says it")
        yield error_of(vehicle.dialect.is_new, lost)
    if BREAKDOWN in vehicle.faults:
        yield error(BREAKDOWN, errors.FATAL, "the vehicle is broken down", {})
    if vehicle.is_empty:
        yield error("batteryEmpty", errors.FATAL, "the battery is empty", {})
    if vehicle.blocked_by:
        yield error("blocked", errors.WARNING, vehicle.blocked_by, {"orderId": vehicle.order.name} if vehicle.order else {})


def _said_doing(vehicle: Vehicle, doing: ActionProgress) -> Json:
    said = {"actionId": doing.action.name, "actionType": doing.action.kind, "actionStatus": doing.status}
    return said | ({"actionResult" if vehicle.dialect.is_new else "resultDescription": doing.result} if doing.result else {})


def _said_node(node: Node) -> Json:
    said: Json = {"nodeId": node.name, "sequenceId": node.sequence, "released": node.released}
    return said | ({"nodePosition": node.position} if node.position is not None else {})


def _said_edge(edge: Edge) -> Json:
    return {"edgeId": edge.name, "sequenceId": edge.sequence, "released": edge.released}
