"""Abilities of virtual vehicles, and the orders that they cannot follow: those with nodes, lanes or actions that they do not know."""

import math
from collections.abc import Sequence, Set
from typing import Any, Protocol

from mrp_sumo.formats.vda.errors import Reason, RefusalError
from mrp_sumo.formats.vda.messages import VehicleLimits
from mrp_sumo.formats.vda.order import LONGEST_ID, LONGEST_PAYLOAD, MOST_ACTIONS, MOST_NODES, Action, Edge, Node, Order

AT_NODES = ("pick", "drop", "service", "startCharging", "stopCharging", "finePositioning", "detectObject")
ON_EDGES = ("finePositioning", "detectObject")
INSTANT = (
    *("startPause", "stopPause", "cancelOrder", "stateRequest", "factsheetRequest", "initPosition", "startCharging", "stopCharging"),
    *("simulateFault", "clearFault"),  # of our own
)
ABILITIES = {  # action -> where it may be asked for
    kind: [scope for scope, kinds in (("NODE", AT_NODES), ("EDGE", ON_EDGES), ("INSTANT", INSTANT)) if kind in kinds]
    for kind in dict.fromkeys((*AT_NODES, *ON_EDGES, *INSTANT))
}
LIMITS = VehicleLimits(LONGEST_PAYLOAD, LONGEST_ID, MOST_NODES, MOST_ACTIONS)
ACTION_S = {  # how long actions take that do not say it
    **dict.fromkeys(("pick", "drop", "service"), 5.0),
    **dict.fromkeys(("startCharging", "stopCharging", "detectObject"), 1.0),
    "finePositioning": 2.0,
}
LONGEST_ACTION_S = 86_400.0
SAME_PLACE_M = 0.5  # a node that an order places farther from where the map has it is another
BREAKDOWN, EMERGENCY_STOP, LOST, FIELD = "breakdown", "emergencyStop", "localizationLost", "fieldViolation"
FAULTS = (BREAKDOWN, EMERGENCY_STOP, LOST, FIELD)


class VehicleMap(Protocol):
    """The map that a vehicle has."""

    @property
    def maps(self) -> Sequence[str]:
        """The names of its maps."""

    def place(self, node: str) -> tuple[float, float, str] | None:
        """Position of a node in m, and its map; None for one that is unknown."""

    def is_joined(self, tail: str, head: str) -> bool:
        """True where a vehicle can drive from a known node to another without passing a third that has a name."""

    def arrival_rad(self, tail: str, head: str) -> float:
        """Heading of a vehicle that comes from a known node to another that is joined to it; NaN where these are one."""


def check_order(order: Order, site: VehicleMap, start: str, used: Set[str]) -> None:
    """Refuse an order that leads from a node where a vehicle cannot go, or has actions that vehicles do not know.

    Raises RefusalError with the JSON path. It begins with the node `start` of the map, and may not have actions whose names are used.
    """
    if order.zone_set:
        text = "zoneSetId: this vehicle knows no zones"
        raise RefusalError(Reason.UNSUPPORTED, text, {**order.references, "zoneSetId": order.zone_set})
    _check_route(order, site, start)
    _check_actions(order, used)


def _check_route(order: Order, site: VehicleMap, start: str) -> None:
    before, references = start, order.references
    for i, node in enumerate(order.nodes):
        place = site.place(node.name)
        if node.position is not None and node.position["mapId"] not in site.maps:
            raise RefusalError(Reason.MAP, f"nodes[{i}].nodePosition.mapId '{node.position['mapId'][:60]}' is unknown", references)
        if i == 0:
            continue
        if place is None:
            text = f"nodes[{i}].nodeId '{node.name[:60]}' is no node of the map"
            raise RefusalError(Reason.ROUTE, text, {**references, "nodeId": node.name})
        if node.position is not None:
            off_m = math.hypot(node.position["x"] - place[0], node.position["y"] - place[1])
            if off_m > SAME_PLACE_M + node.deviation_m or node.position["mapId"] != place[2]:
                text = f"nodes[{i}].nodePosition is {off_m:.2f} m from where the map has '{node.name[:60]}'"
                raise RefusalError(Reason.ROUTE, text, {**references, "nodeId": node.name})
        if node.name != before and not site.is_joined(before, node.name):
            text = f"edges[{i - 1}]: no lane leads from '{before[:60]}' to '{node.name[:60]}'"
            raise RefusalError(Reason.ROUTE, text, {**references, "edgeId": order.edges[i - 1].name})
        before = node.name
    for i, edge in enumerate(order.edges):
        if edge.has_trajectory:
            text = f"edges[{i}].trajectory: this vehicle keeps to the lanes of its map"
            raise RefusalError(Reason.UNSUPPORTED, text, {**references, "edgeId": edge.name, "trajectory": ""})


def _check_actions(order: Order, used: Set[str]) -> None:
    references = order.references
    places: list[tuple[str, Sequence[Node | Edge], Sequence[str]]] = [
        ("nodes", order.nodes, AT_NODES),
        ("edges", order.edges, ON_EDGES),
    ]
    for kind, ones, known in places:
        for i, one in enumerate(ones):
            for k, action in enumerate(one.actions):
                at, to = f"{kind}[{i}].actions[{k}]", {**references, "actionId": action.name}
                if action.kind not in known:
                    text = f"{at}.actionType '{action.kind[:60]}' is not known here"
                    raise RefusalError(Reason.ORDER_ACTION, text, {**to, "actionType": action.kind})
                if wrong := _duration_fault(action):
                    raise RefusalError(Reason.ORDER_ACTION, f"{at}.{wrong}", {**to, "duration": ""})
                if action.name in used:
                    raise RefusalError(Reason.ORDER_ACTION, f"{at}.actionId '{action.name[:60]}' was used before", to)


def duration_s(action: Action) -> float:
    """Duration of an action: as its parameter `duration` says, which may be a number or text."""
    duration = action.parameters.get("duration")
    return ACTION_S[action.kind] if duration is None else float(duration)


def _duration_fault(action: Action) -> str:
    duration: Any = action.parameters.get("duration", 0.0)
    try:
        value = float(duration) if isinstance(duration, str | int | float) and not isinstance(duration, bool) else math.nan
    except (ValueError, OverflowError):
        value = math.nan
    return "" if 0 <= value <= LONGEST_ACTION_S else f"actionParameters: duration, expected 0 to {LONGEST_ACTION_S:g} s"
