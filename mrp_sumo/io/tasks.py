"""The streams of tasks that a scenario asks for, on the vertices of a map.

Names are those of stations, of groups of stations, or of vertices of the map, each of which is a station with one place. Refuses
unknown names, each in one line with its place in the file.
"""

import copy
import csv
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import reduce
from itertools import product
from operator import ne
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import ValidationError

from mrp_sumo.core.graph import BoolArray
from mrp_sumo.core.shifts import spans_of
from mrp_sumo.core.stream import ClosedLoop, TaskList, TaskSource, TaskStream, zipf_weights
from mrp_sumo.core.task import NOBODY, Station, Stop, Task
from mrp_sumo.errors import ScenarioError, nearest
from mrp_sumo.files.reading import read_json, read_text, shortened
from mrp_sumo.io.documents import Place, in_words, read_document
from mrp_sumo.io.scenario.tasks import StationChoice, StreamChoice, TaskChoice, TasksChoice
from mrp_sumo.io.task_requests import tasks_of_requests

MAX_BYTES = 64_000_000
MAX_ROUTES = 100_000
REVEALED = 1.5  # tasks known for each robot in the League of Robot Runners


@dataclass(frozen=True)
class TaskNames:
    """Meanings of names in tasks, and their vertices."""

    vertex_of: Callable[[str], int | None]  # the vertex of the plan graph by its name on the map
    known: Sequence[str]  # all names
    at: Callable[..., str]  # `file:line: key` of a place in the scenario
    folder: Path  # where the path of a file begins
    cells: Callable[[], BoolArray]  # the free cells [H, W] of a MovingAI map, row 0 the uppermost
    robot_types: Sequence[str] = ()  # of the fleet
    robots: Sequence[str] = ()  # names
    max_load_kg: Sequence[float] = ()  # [R] that robots can carry; empty: any
    heading_at: Callable[[int], float | None] = lambda vertex: None  # rad, in which the map has vehicles stand there


def sources_of(choice: TasksChoice, site: TaskNames, seed: int, step_s: float, num_robots: int) -> tuple[TaskSource, ...]:
    """The streams of tasks that a scenario asks for.

    Raises ScenarioError: one line, for a name that is not known and a file that cannot be read.
    """
    names = _Names(choice, site)
    sources: list[TaskSource] = []
    listed = [(("tasks", "list", i), task) for i, task in enumerate(choice.list)]
    if listed:
        sources.append(_listed([_task(names, place, task, n) for n, (place, task) in enumerate(listed)]))
    if choice.file is not None:
        sources.append(_file(names, site, site.folder / choice.file, num_robots, len(listed)))
    for i, stream in enumerate(choice.streams):
        is_named = "name" in stream.model_fields_set or not (i or sources)
        name, stream = stream.name if is_named else f"{stream.name}_{i + 1}", _with_profile(stream, choice.profile)
        sources.append(_stream(names, ("tasks", "streams", i), stream, i, seed, step_s, name))
    return tuple(sources) if choice.open is None else (ClosedLoop(tuple(sources), choice.open),)


def chargers_of(choice: TasksChoice, site: TaskNames) -> tuple[int, ...]:
    """Vertices where robots of a scenario charge. As `sources_of`."""
    return () if choice.charging is None else _places(choice, site, ("tasks", "charging", "stations"), choice.charging.stations)


def parking_of(choice: TasksChoice, site: TaskNames) -> tuple[int, ...]:
    """Vertices where robots without a task go. As `sources_of`."""
    return _places(choice, site, ("tasks", "parking"), choice.parking)


def _places(choice: TasksChoice, site: TaskNames, key: Place, listed: Sequence[str]) -> tuple[int, ...]:
    """The vertices of groups and stations, each once."""
    names = _Names(choice, site)
    stations = [station for i, name in enumerate(listed) for station in names.group((*key, i), name)]
    return tuple(dict.fromkeys(v for station in stations for v in station.places))


class _Names:
    """Stations and groups by name."""

    def __init__(self, choice: TasksChoice, site: TaskNames) -> None:
        self._site, self.at, self._group = site, site.at, choice.groups
        self._orders: dict[str, str] = {}  # where each was named
        self._factor: dict[str, float] = {}  # on service times
        self._station: dict[str, Station] = {}
        for name, factor in choice.service_factor.items():
            for member in choice.groups.get(name, [name]):
                self._factor[member] = factor * self._factor.get(member, 1.0)
        self._station = {name: self._made(name, station) for name, station in choice.stations.items()}
        for name in choice.service_factor:
            self.group(("tasks", "service_factor", name), name)
        for name, members in choice.groups.items():
            for i, member in enumerate(members):
                self.station(("tasks", "groups", name, i), member)

    def _made(self, name: str, station: StationChoice) -> Station:
        places, queue = (
            tuple(self._vertex(("tasks", "stations", name, key, i), vertex) for i, vertex in enumerate(vertices))
            for key, vertices in (("places", station.places), ("queue", station.queue))
        )
        degrees, spans_s, factor = station.heading_deg, tuple(sorted(spans_of(station.shifts))), self._factor.get(name, 1.0)
        heading_rad = self._of_map(places) if degrees is None else math.remainder(math.radians(degrees), 2 * math.pi)
        return Station(name, places, queue, station.holds, tuple(station.actions), spans_s, station.charges, factor, heading_rad)

    def of_line(self, line: str) -> "_Names":
        """The same names, for messages about a line of another file."""
        names = copy.copy(self)
        names.at = lambda *place: line
        return names

    def station(self, place: Place, name: str) -> Station:
        if (known := self._station.get(name)) is not None:
            return known
        at = (self._vertex(place, name),)
        return Station(name, at, service_factor=self._factor.get(name, 1.0), heading_rad=self._of_map(at))

    def _of_map(self, places: tuple[int, ...]) -> float | None:
        """The heading that the map has for all of these places."""
        headings = {self._site.heading_at(v) for v in places}
        return headings.pop() if len(headings) == 1 else None

    def group(self, place: Place, name: str) -> tuple[Station, ...]:
        return tuple(self.station(place, member) for member in self._group.get(name, [name]))

    def order(self, place: Place, name: str) -> str:
        """The name of an order, which no other may have."""
        first = self._orders.setdefault(name, where := self.at(*place))
        if first != where:
            raise ScenarioError(f"{where}: the order at {first} is called '{name}', too")
        return name

    def robot_type(self, place: Place, name: str) -> str:
        """The type of robot that a task needs, which somebody has to be of."""
        if name and name not in self._site.robot_types:
            known = dict.fromkeys(self._site.robot_types)
            had = ", ".join(f"'{each}'" for each in known)
            raise ScenarioError(f"{self.at(*place)}: no robot is of type '{name}', the fleet's are {had}{nearest(name, known)}")
        return name

    def load_kg(self, place: Place, load_kg: float, robot_type: str, robot: int) -> float:
        """The weight of an order, which somebody that it is for has to be able to carry."""
        able = [robot] if robot != NOBODY else [r for r, name in enumerate(self._site.robot_types) if robot_type in ("", name)]
        most_kg = max((self._site.max_load_kg[r] for r in able), default=math.inf) if self._site.max_load_kg else math.inf
        if load_kg > most_kg:
            raise ScenarioError(f"{self.at(*place)}: found {load_kg:g}, but the robots that the order is for carry {most_kg:g} kg at most")
        return load_kg

    def robot(self, place: Place, name: str, robot_type: str) -> int:
        """The robot that a task is for, which has to be of the type that it needs."""
        if not name:
            return NOBODY
        if name not in self._site.robots:
            raise ScenarioError(f"{self.at(*place)}: no robot is called '{name}'{nearest(name, self._site.robots)}")
        robot = self._site.robots.index(name)
        if robot_type and self._site.robot_types[robot] != robot_type:
            raise ScenarioError(f"{self.at(*place)}: {name} is of type '{self._site.robot_types[robot]}', the order needs '{robot_type}'")
        return robot

    def _vertex(self, place: Place, name: str) -> int:
        vertex = self._site.vertex_of(name)
        if vertex is None:
            likely = nearest(name, [*self._station, *self._group, *filter(None, self._site.known)])
            raise ScenarioError(f"{self.at(*place)}: '{name}' is no station, group or vertex{likely}")
        return vertex


def _listed(tasks: Sequence[Task]) -> TaskList:
    return TaskList(tuple(sorted(tasks, key=lambda task: task.release_s)))


def _task(names: _Names, place: Place, task: TaskChoice, number: int) -> Task:
    stations = [names.station((*place, "stops", i), name) for i, name in enumerate(task.stops)]
    times_s = task.service_s if isinstance(task.service_s, list) else [task.service_s] * len(stations)
    stops = tuple(Stop(at.places[0], at.service_factor * service_s, "", at) for at, service_s in zip(stations, times_s))
    due_s = math.inf if task.due_s is None else task.due_s
    name, robot_type = names.order(place, task.name or f"task_{number}"), names.robot_type((*place, "robot_type"), task.robot_type)
    robot = names.robot((*place, "robot"), task.robot, robot_type)
    load_kg = names.load_kg((*place, "load_kg"), task.load_kg, robot_type, robot)
    return Task(number, stops, task.release_s, due_s, task.priority, robot, name, robot_type=robot_type, load_kg=load_kg)


def _file(names: _Names, site: TaskNames, path: Path, num_robots: int, begin: int) -> TaskSource:
    """The tasks of a file, in the format that its name ends with. Those without a name are counted from `begin` on."""
    if not path.is_file():
        raise ScenarioError(f"{site.at('tasks', 'file')}: {shortened(path)}: no such file")
    if path.suffix == ".tasks":
        return TaskList(tuple(_league(names, path, site.cells(), begin)), max(1, int(REVEALED * num_robots)))
    if path.suffix == ".json":
        return _listed(_checked(names, path, tasks_of_requests(read_json(path, MAX_BYTES, ScenarioError), str(shortened(path))), begin))
    if path.suffix in (".yaml", ".yml"):
        return _listed(_checked(names, path, read_document(path).content.get("tasks"), begin))
    return _listed([_task(names.of_line(line), (), task, number) for number, (line, task) in enumerate(choices_in(path), begin)])


def _league(names: _Names, path: Path, free: BoolArray, begin: int) -> Iterator[Task]:
    """Tasks of the League of Robot Runners: a line each, its cells by row * width + column."""
    lines = [(n, text.strip()) for n, text in enumerate(read_text(path, MAX_BYTES, ScenarioError).splitlines(), 1)]
    lines = [(n, text) for n, text in lines if text and not text.startswith("#")][1:]  # after their number
    vertex = np.full(free.shape, -1)
    vertex[::-1][free[::-1]] = np.arange(free.sum())  # as readers number cells: from the lower left
    for number, (n, text) in enumerate(lines, begin):
        here = names.of_line(f"{shortened(path)}:{n}")
        cells = [int(word) if word.strip().isdecimal() else -1 for word in text.split(",")]
        wrong = next((word for word, cell in zip(text.split(","), cells) if not 0 <= cell < free.size or vertex.flat[cell] < 0), None)
        if wrong is not None:
            raise ScenarioError(f"{here.at()}: '{wrong.strip()}' is no free cell of the map, expected row * {free.shape[1]} + column")
        yield _task(here, (), TaskChoice(stops=[f"v{vertex.flat[cell]}" for cell in cells]), number)


def _checked(names: _Names, path: Path, content: Any, begin: int) -> list[Task]:
    if not isinstance(content, list) or not content:
        raise ScenarioError(f"{shortened(path)}: found no tasks, expected a list of them")
    tasks = []
    for number, item in enumerate(content):
        line = f"{shortened(path)}: [{number}]"
        try:
            task = TaskChoice.model_validate(item)
        except ValidationError as error:
            first = error.errors()[0]
            key = "".join(f".{part}" for part in first["loc"] if isinstance(part, int) or part in TaskChoice.model_fields)
            found_instead = f", found {first['input']!r}" if key else ""
            raise ScenarioError(f"{line}{key}: {in_words(first['msg'])}{found_instead}") from None
        tasks.append(_task(names.of_line(line), (), task, begin + number))
    return tasks


def choices_in(path: Path) -> Iterator[tuple[str, TaskChoice]]:
    """Rows of a CSV file, as file and line, and the task. Raises ScenarioError."""
    rows = csv.DictReader(read_text(path, MAX_BYTES, ScenarioError).splitlines())
    columns = set(rows.fieldnames or ())
    if lacking := {"release_s", "stops"} - columns:
        raise ScenarioError(f"{shortened(path)}:1: has no column '{sorted(lacking)[0]}', expected release_s and stops")
    if odd := columns - set(TaskChoice.model_fields):
        raise ScenarioError(
            f"{shortened(path)}:1: unknown column '{sorted(odd)[0]}'{nearest(sorted(odd)[0], TaskChoice.model_fields, limit=9)}"
        )
    for row in rows:
        line = f"{shortened(path)}:{rows.line_num}"
        values: Mapping[str, Any] = {key: value for key, value in row.items() if value not in (None, "")}
        times_s = str(values.get("service_s", "")).split()
        several = {"stops": str(values.get("stops", "")).split()} | ({"service_s": times_s} if len(times_s) > 1 else {})
        try:
            yield line, TaskChoice.model_validate({**values, **several})
        except ValueError as error:
            first = error.errors()[0] if hasattr(error, "errors") else {"loc": (), "msg": str(error)}
            key, says = str(first["loc"][0]) if first["loc"] else "", in_words(str(first["msg"]))
            raise ScenarioError(f"{line}: {key}: {says}, found {row.get(key)!r}" if key else f"{line}: {says}") from None


def _stream(names: _Names, place: Place, stream: StreamChoice, number: int, seed: int, step_s: float, name: str) -> TaskStream:
    routes: tuple[tuple[Station, ...], ...]
    if stream.matrix is not None:
        pairs = [
            ((one, other), weight / (len(ones) * len(others)))
            for a, row in stream.matrix.items()
            for b, weight in row.items()
            for ones, others in [(names.group((*place, "matrix", a), a), names.group((*place, "matrix", a, b), b))]
            for one, other in product(ones, others)
            if weight > 0 and one != other
        ]
        routes = tuple(route for route, _ in pairs)
        weights = np.array([weight for _, weight in pairs], np.float64)
    else:
        groups = [names.group((*place, "stops", i), name) for i, name in enumerate(stream.stops or ())]
        if (num_ways := math.prod(map(len, groups))) > MAX_ROUTES:
            raise ScenarioError(f"{names.at(*place, 'stops')}: {num_ways} ways from group to group, expected at most {MAX_ROUTES}")
        all_weights = reduce(np.multiply.outer, [zipf_weights(len(group), stream.zipf) for group in groups]).reshape(-1)
        weighted = [(route, weight) for route, weight in zip(product(*groups), all_weights.tolist()) if all(map(ne, route, route[1:]))]
        routes = tuple(route for route, _ in weighted)
        weights = np.array([weight for _, weight in weighted], np.float64)
    if not routes:
        raise ScenarioError(f"{names.at(*place)}: no way leads from a station to another")
    return TaskStream(
        name=name,
        arrivals=stream.arrivals,
        routes=routes,
        weight=weights,
        service=stream.service,
        count=stream.count or 0,
        due_after_s=stream.due_after_s or math.inf,
        priority=stream.priority,
        robot_type=names.robot_type((*place, "robot_type"), stream.robot_type),
        robot=(robot := names.robot((*place, "robot"), stream.robot, stream.robot_type)),
        load_kg=names.load_kg((*place, "load_kg"), stream.load_kg, stream.robot_type, robot),
        seed=seed,
        number=number,
        step_s=step_s,
    )


def _with_profile(stream: StreamChoice, profile: tuple[float, ...]) -> StreamChoice:
    """A stream with the profile of all, if it has a rate and no profile of its own."""
    if not profile or stream.arrivals.rate_per_h is None or stream.arrivals.profile:
        return stream
    return stream.model_copy(update={"arrivals": replace(stream.arrivals, profile=profile)})
