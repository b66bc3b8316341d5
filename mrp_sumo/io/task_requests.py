"""Task requests of Open-RMF, read from JSON as tasks: what a dashboard or `rmf_demos_tasks` would post.

A file has one request or a list of them, each as it is or inside a message with `request` (and `robot`). Read are the categories
`patrol`, `delivery`, `clean` and `compose` (activities `go_to_place`, `pickup`, `dropoff`, `wait_for`, `perform_action`); times count
from the earliest start time of the file, and a label `robot_type=forklift` says which type of robot a task needs.
Source: `task_request.json` and `task_descriptions/*.json` of Open-RMF's rmf_api_msgs and
rmf_fleet_adapter. Refuses other categories and activities, in one line that says where.
"""

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from mrp_sumo.errors import ScenarioError, nearest

ROBOT_TYPE = "robot_type="  # of a label
EARLIEST = "unix_millis_earliest_start_time"
LASTING = {"wait_for": "duration", "perform_action": "unix_millis_action_duration_estimate"}  # activities without a place
MOST_ROUNDS = 10_000
FARTHEST = 1e15  # no time nor duration, in ms, is farther from 0: 30,000 years
ACTIVITIES = ("go_to_place", "pickup", "dropoff", "wait_for", "perform_action", "sequence")


def tasks_of_requests(content: Any, where: str) -> list[dict[str, Any]]:
    """Tasks by the keys of a scenario's list: name, stops, release_s, priority, robot_type, and service_s of each stop.

    Raises ScenarioError: one line, for what is no request that this program reads.
    """
    listed = content if isinstance(content, list) else [content]
    requests = [_request(each, f"{where}: [{n}]") for n, each in enumerate(listed)]
    millis = [_number(request, EARLIEST, f"{where}: [{n}]") for n, request in enumerate(requests)]
    first = min((t for t in millis if t is not None), default=0.0)
    tasks = []
    for n, (request, at) in enumerate(zip(requests, millis)):
        here = f"{where}: [{n}]"
        stops, labels = list(_stops(request, here)), _labels(request, here)
        types = [label.removeprefix(ROBOT_TYPE) for label in labels if label.startswith(ROBOT_TYPE)]  # Open-RMF has no key for it
        tasks.append(
            {
                "name": next((label for label in labels if not label.startswith(ROBOT_TYPE)), f"task_{n}"),
                "stops": [name for name, _ in stops],
                "service_s": [seconds for _, seconds in stops],
                "release_s": 0.0 if at is None else (at - first) / 1000,
                "priority": _priority(request, here),
                "robot_type": types[0] if types else "",
            }
        )
    return tasks


def _request(content: Any, where: str) -> Mapping[str, Any]:
    request = content.get("request", content) if isinstance(content, dict) else None
    if not isinstance(request, dict) or "category" not in request:
        raise ScenarioError(f"{where}: found no task request, expected an object with category and description")
    return request


def _labels(request: Mapping[str, Any], where: str) -> list[str]:
    return [str(label) for label in _list(request, "labels", where)] if request.get("labels") else []


def _priority(request: Mapping[str, Any], where: str) -> int:
    """Open-RMF's binary priority, or a number."""
    if isinstance(priority := request.get("priority"), dict):
        return int(_number(priority, "value", f"{where}.priority") or 0)
    return int(_number(request, "priority", where) or 0)


def _stops(request: Mapping[str, Any], where: str) -> Iterator[tuple[str, float]]:
    """Names of places, and s for which the robot stays there."""
    category, what = request["category"], request.get("description", {})
    where = f"{where}.description"
    if category == "patrol":
        rounds = int(_number(what, "rounds", where) or 1)
        if not 1 <= rounds <= MOST_ROUNDS:
            raise ScenarioError(f"{where}.rounds: found {what['rounds']!r}, expected 1 to {MOST_ROUNDS}")
        for _ in range(rounds):
            yield from ((_place(each, f"{where}.places"), 0.0) for each in _list(what, "places", where))
    elif category == "delivery":
        for key in ("pickup", "dropoff"):
            yield _place(_member(what, key, where), f"{where}.{key}"), 0.0
    elif category == "clean":
        yield _place(what, where), 0.0
    elif category == "compose":
        yield from _merged([_activity(phase.get("activity"), f"{where}.phases") for phase in _list(what, "phases", where)], where)
    else:
        raise ScenarioError(
            f"{where.removesuffix('.description')}.category: found '{category}', expected patrol, delivery, clean or compose"
        )


def _activity(activity: Any, where: str) -> list[tuple[str, float]]:
    """Stops of an activity; a name '' is where the robot is already."""
    category = activity.get("category") if isinstance(activity, dict) else None
    if category not in ACTIVITIES:
        raise ScenarioError(f"{where}: activity '{category}'{nearest(str(category), ACTIVITIES, limit=9)}")
    what = activity.get("description", {})
    if category == "sequence":
        parts = what if isinstance(what, list) else _list(what, "activities", where)
        return [stop for part in parts for stop in _activity(part, where)]
    if category in LASTING:
        return [("", (_number(what, LASTING[category], where) or 0.0) / 1000)]
    return [(_place(what, where), 0.0)]


def _merged(phases: Sequence[Sequence[tuple[str, float]]], where: str) -> list[tuple[str, float]]:
    """Stops where waiting is counted to the place before."""
    stops: list[tuple[str, float]] = []
    for name, seconds in (stop for phase in phases for stop in phase):
        if name and not (stops and stops[-1][0] == name):
            stops.append((name, seconds))
        elif stops:
            stops[-1] = stops[-1][0], stops[-1][1] + seconds
        else:
            raise ScenarioError(f"{where}: begins where the robot happens to be, expected a place first")
    return stops


def _place(what: Any, where: str) -> str:
    """A name, or an object that has one; of several choices the first."""
    if isinstance(what, dict):
        if isinstance(what.get("one_of"), list) and what["one_of"]:
            return _place(what["one_of"][0], where)
        what = next((what[key] for key in ("waypoint", "place", "zone", "start_waypoint") if key in what), None)
        return _place(what, where)
    if not isinstance(what, str):
        raise ScenarioError(f"{where}: found {what!r}, expected the name of a place")
    return what


def _member(what: Any, key: str, where: str) -> Any:
    if not isinstance(what, dict) or key not in what:
        raise ScenarioError(f"{where}: has no '{key}'")
    return what[key]


def _list(what: Any, key: str, where: str) -> list[Any]:
    value = _member(what, key, where)
    if not isinstance(value, list) or not value:
        raise ScenarioError(f"{where}.{key}: found {value!r}, expected a list")
    return value


def _number(what: Any, key: str, where: str) -> float | None:
    value = what.get(key) if isinstance(what, dict) else None
    if value is None:
        return None
    if isinstance(value, bool) or not isinstance(value, int | float) or not abs(value) <= FARTHEST:
        raise ScenarioError(f"{where}.{key}: found {value!r}, expected a number of at most {FARTHEST:g}")
    return float(value)
