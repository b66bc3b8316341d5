"""Messages to a vehicle: those of the topics order and instantActions, and what each instant action does."""

import math
from collections.abc import Callable
from typing import Any

from mrp_sumo.formats.vda import errors
from mrp_sumo.formats.vda.abilities import FAULTS, INSTANT, LOST
from mrp_sumo.formats.vda.errors import Reason, RefusalError, error_of
from mrp_sumo.formats.vda.order import Action, check_header, read_actions, read_document, read_order
from mrp_sumo.formats.vda.vehicle import FAILED, FINISHED, RUNNING, ActionProgress, Vehicle

SAME_POSE_M, SAME_POSE_RAD = 1.0, 0.8  # an initial position farther off is refused
MOST_INSTANT = 100  # instant actions that are over and still reported


def receive(vehicle: Vehicle, kind: str, payload: bytes, now_s: float) -> None:
    """Take a message of the topics order or instantActions. What is wrong with it is in the next state."""
    vehicle.has_changed = True
    try:
        document = read_document(payload)
        check_header(document, vehicle.dialect, vehicle.sender.manufacturer, vehicle.sender.serial)
        if kind == "order":
            vehicle.take(read_order(document, vehicle.dialect), now_s)
        else:
            for action in read_actions(document, vehicle.dialect):
                _do(vehicle, action, now_s)
    except RefusalError as refusal:
        refusal.references = {"topic": kind, **refusal.references}
        vehicle.refused[kind] = error_of(vehicle.dialect.is_new, refusal)


def _do(vehicle: Vehicle, action: Action, now_s: float) -> None:
    """Do one instant action. An identifier that is known already is a message that was sent again."""
    if action.name in vehicle.instants:
        return
    over = [name for name, doing in vehicle.instants.items() if doing.is_over]
    for name in over[: max(0, len(vehicle.instants) + 1 - MOST_INSTANT)]:
        del vehicle.instants[name]
    doing = vehicle.instants[action.name] = ActionProgress(action, RUNNING)
    references = {"actionId": action.name, "actionType": action.kind}
    try:
        if action.kind not in INSTANT:
            raise RefusalError(Reason.INSTANT_ACTION, f"instant action '{action.kind[:60]}' is not known here", references)
        if DO[action.kind](vehicle, action, now_s):
            doing.end(FINISHED)
    except RefusalError as refusal:
        doing.end(FAILED, refusal.text[: errors.LONGEST_TEXT])
        refusal.references = {"topic": "instantActions", **references, **refusal.references}
        vehicle.refused["cancelOrder" if refusal.reason == Reason.NO_ORDER else "instantActions"] = error_of(
            vehicle.dialect.is_new, refusal
        )
    else:
        vehicle.refused.pop("instantActions", None)


def _start_pause(vehicle: Vehicle, action: Action, now_s: float) -> bool:
    vehicle.paused = True
    return not vehicle.body.moves


def _stop_pause(vehicle: Vehicle, action: Action, now_s: float) -> bool:
    vehicle.paused = False
    return True


def _factsheet_request(vehicle: Vehicle, action: Action, now_s: float) -> bool:
    vehicle.asked_for_factsheet = True
    return True


def _start_charging(vehicle: Vehicle, action: Action, now_s: float) -> bool:
    if vehicle.body.moves:
        raise RefusalError(Reason.INSTANT_ACTION, "the vehicle drives")
    vehicle.charging = True
    return True


def _stop_charging(vehicle: Vehicle, action: Action, now_s: float) -> bool:
    vehicle.charging = False
    return True


def _cancel_order(vehicle: Vehicle, action: Action, now_s: float) -> bool:
    wanted = action.parameters.get("orderId")
    if not vehicle.is_busy or vehicle.cancels or (wanted is not None and vehicle.order and wanted != vehicle.order.name):
        raise RefusalError(Reason.NO_ORDER, "there is no such order to cancel")
    vehicle.cancels = action.name
    for other in vehicle.doings.values():
        if not other.is_over:
            other.end(FAILED, "the order is cancelled")
    return False


def _init_position(vehicle: Vehicle, action: Action, now_s: float) -> bool:
    """A simulated vehicle is where it is: a position that agrees has it localized again, another is refused."""
    parameters, body = action.parameters, vehicle.body
    numbers: list[Any] = [parameters.get(key) for key in ("x", "y", "theta")]
    if not all(type(value) in (int, float) and abs(value) < 1e9 for value in numbers):
        raise RefusalError(Reason.INSTANT_ACTION, "expected the numbers x, y and theta")
    x, y, theta = numbers
    off_m, off_rad = math.hypot(x - body.x_m, y - body.y_m), abs(math.remainder(theta - body.yaw_rad, 2 * math.pi))
    if off_m > SAME_POSE_M or off_rad > SAME_POSE_RAD or parameters.get("mapId", body.map_id) != body.map_id:
        raise RefusalError(Reason.INSTANT_ACTION, f"that is {off_m:.2f} m and {off_rad:.2f} rad from where the vehicle is")
    vehicle.faults.pop(LOST, None)
    return True


def _simulate_fault(vehicle: Vehicle, action: Action, now_s: float) -> bool:
    kind, lasts_s = _fault(action), action.parameters.get("duration", math.inf)
    if type(lasts_s) not in (int, float) or not lasts_s > 0:
        raise RefusalError(Reason.INSTANT_ACTION, "duration: expected seconds above 0")
    vehicle.fail(kind, now_s + float(min(lasts_s, 1e9)) if lasts_s < math.inf else math.inf)
    return True


def _clear_fault(vehicle: Vehicle, action: Action, now_s: float) -> bool:
    vehicle.faults.pop(_fault(action), None)
    return True


def _fault(action: Action) -> str:
    fault = action.parameters.get("fault")
    if fault not in FAULTS:
        raise RefusalError(Reason.INSTANT_ACTION, f"fault: expected one of {', '.join(FAULTS)}")
    return str(fault)


DO: dict[str, Callable[[Vehicle, Action, float], bool]] = {  # which say whether an action is done at once
    "startPause": _start_pause,
    "stopPause": _stop_pause,
    "stateRequest": lambda *_: True,
    "factsheetRequest": _factsheet_request,
    "startCharging": _start_charging,
    "stopCharging": _stop_charging,
    "cancelOrder": _cancel_order,
    "initPosition": _init_position,
    "simulateFault": _simulate_fault,
    "clearFault": _clear_fault,
}
