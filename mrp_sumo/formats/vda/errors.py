"""Why a vehicle refuses what it is sent, and the names that the versions of VDA 5050 have for that.

Version 3.0 names each reason (section 6.6.5.4); 2.1 has few names (section 6.6.4), so that several reasons share one.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import Enum
from typing import Any

WARNING, URGENT, CRITICAL, FATAL = "WARNING", "URGENT", "CRITICAL", "FATAL"
LONGEST_TEXT = 300  # of a description


class Reason(Enum):
    """Reasons of refusals: type and level in 2.1, and in 3.0."""

    MALFORMED = (("validationError", WARNING), ("VALIDATION_FAILURE", WARNING))
    UNSUPPORTED = (("orderError", WARNING), ("UNSUPPORTED_PARAMETER", CRITICAL))
    ORDER_ACTION = (("orderError", WARNING), ("INVALID_ORDER_ACTION", WARNING))
    INSTANT_ACTION = (("instantActionError", WARNING), ("INVALID_INSTANT_ACTION", WARNING))
    OUTDATED = (("orderUpdateError", WARNING), ("OUTDATED_ORDER_UPDATE", WARNING))
    SAME_UPDATE = (("orderUpdateError", WARNING), ("SAME_ORDER_UPDATE_ID", WARNING))
    AFTER_CANCEL = (("orderUpdateError", WARNING), ("ORDER_UPDATE_FOLLOWING_CANCEL", WARNING))
    NOT_CONTINUED = (("orderUpdateError", WARNING), ("START_NODE_OUT_OF_RANGE", WARNING))
    OTHER_ACTIVE = (("orderError", WARNING), ("OTHER_ORDER_ACTIVE", WARNING))
    START = (("noRouteError", WARNING), ("START_NODE_OUT_OF_RANGE", WARNING))
    ROUTE = (("noRouteError", WARNING), ("NO_ROUTE_TO_TARGET", WARNING))
    MAP = (("orderError", WARNING), ("UNKNOWN_MAP_ID", WARNING))
    TOO_LARGE = (("validationError", WARNING), ("INSUFFICIENT_MEMORY", URGENT))
    NOT_AVAILABLE = (("orderError", WARNING), ("MOBILE_ROBOT_NOT_AVAILABLE", WARNING))
    NO_ORDER = (("noOrderToCancel", WARNING), ("NO_ORDER_TO_CANCEL", WARNING))
    LOCALIZATION = (("localizationError", FATAL), ("LOCALIZATION_ERROR", FATAL))


@dataclass
class RefusalError(Exception):
    """A fault of a message, for its sender."""

    reason: Reason
    text: str
    references: Mapping[str, object] = field(default_factory=dict)

    def __str__(self) -> str:
        return self.text


def error_of(is_new: bool, refusal: RefusalError) -> dict[str, Any]:
    """A refusal as states report it; `is_new`: in version 3.0."""
    kind, level = refusal.reason.value[is_new]
    return error(kind, level, refusal.text, refusal.references)


def error(kind: str, level: str, text: str, references: Mapping[str, object]) -> dict[str, Any]:
    listed = [{"referenceKey": key, "referenceValue": str(value)[:LONGEST_TEXT]} for key, value in references.items()]
    return {"errorType": kind, "errorLevel": level, "errorDescription": text[:LONGEST_TEXT], "errorReferences": listed}
