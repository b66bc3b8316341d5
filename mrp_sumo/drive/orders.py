"""Orders: the tasks of a run as they become known, what state each is in, and what has become of it.

A state changes by one table. Robots and where they are, are nobody's business here (`drive.work`).
"""

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from mrp_sumo.core.graph import frozen
from mrp_sumo.core.order_rules import Cancel
from mrp_sumo.core.stream import TaskList, TaskSource
from mrp_sumo.core.task import (
    ASSIGNED,
    CANCELLED,
    CHARGE,
    DONE,
    FAILED,
    HANDED_OVER,
    NOBODY,
    ORDER,
    PICKED,
    RELEASED,
    TASK_TIMES,
    Stop,
    Task,
    TaskLog,
)

NEXT = {  # what may come after what
    RELEASED: (ASSIGNED, CANCELLED, FAILED),
    ASSIGNED: (PICKED, RELEASED, HANDED_OVER, CANCELLED, FAILED),
    PICKED: (DONE, RELEASED, HANDED_OVER, FAILED),
    HANDED_OVER: (ASSIGNED, FAILED),
    DONE: (),
    FAILED: (),
    CANCELLED: (),
}


class Orders:
    """Tasks by release; their numbers are those of the log."""

    def __init__(self, sources: Sequence[TaskSource], cancel: Cancel | None = None) -> None:
        self._cancel = cancel  # None: nothing is withdrawn
        self.tasks: list[Task] = []
        self.status: list[str] = []
        self.robot: list[int] = []  # that has or had it
        self.waiting: list[int] = []  # those that nobody has
        self.tries: list[int] = []  # how often each was begun anew
        self._reason: list[str] = []
        self._handed: set[int] = set()  # those that were handed over
        self._open: set[int] = set()  # orders that have not ended
        self._times: dict[str, list[float]] = {name: [] for name in TASK_TIMES}
        listed = bool(sources) and isinstance(sources[0], TaskList)
        self._sources = [_Source(source.tasks(), source.num_open) for source in (sources if listed else (TaskList(()), *sources))]
        self._listed = self._sources[0]  # in which tasks may be put that are added while robots drive

    @property
    def endless(self) -> bool:
        """True if more will come."""
        return any(source.next is not None for source in self._sources)

    @property
    def next_release_s(self) -> float:
        """Time of the next that has one of its own; inf: none."""
        times = (source.next.release_s for source in self._sources if source.next is not None and not source.num_open)
        return min(times, default=np.inf)

    @property
    def open_since_s(self) -> float:
        """Time at which the oldest became known of those that have not ended; inf: all have."""
        return min((self._times["released_s"][k] for k in self._open), default=np.inf)

    @property
    def num_open(self) -> int:
        """Number of orders that are known and have not ended."""
        return len(self._open)

    @property
    def not_picked(self) -> list[int]:
        """Those that are still to be picked; empty where none is ever cancelled."""
        if self._cancel is None:
            return []
        return [k for k in sorted(self._open) if self.status[k] in (RELEASED, ASSIGNED) and k not in self._handed]

    def opened_s(self, task: int) -> float:
        """Time at which its first stop was reached, NaN: not yet."""
        return self._times["opened_s"][task]

    def assigned_s(self, task: int) -> float:
        """Time at which a robot was given it."""
        return self._times["assigned_s"][task]

    def released_s(self, task: int) -> float:
        """Time at which it became known."""
        return self._times["released_s"][task]

    def last_chance_s(self, task: int) -> float:
        """Time at which it is cancelled unless somebody has picked it by then; inf: never."""
        cancel = self._cancel
        if cancel is None:
            return np.inf
        due_s = self.tasks[task].due_s if cancel.overdue else np.inf
        return due_s if cancel.after_s is None else min(due_s, self._times["released_s"][task] + cancel.after_s)

    def add(self, task: Task) -> None:
        """Have one that nobody knew of, among those that are listed with times of their own."""
        self._listed.add(task)

    def reveal(self, now_s: float) -> list[int]:
        """Those that have become known by now."""
        new = []
        for source in self._sources:
            while (task := source.take(now_s, len(self.tasks))) is not None:
                known_s = now_s if source.num_open else task.release_s  # a due time goes with it
                new.append(self._know(replace(task, release_s=known_s, due_s=task.due_s - task.release_s + known_s)))
        self.waiting += new
        self._open.update(new)
        return new

    def charge(self, robot: int, stop: Stop, name: str, now_s: float) -> int:
        """The task of a robot to charge, which it has at once."""
        task = self._know(Task(0, (stop,), now_s, robot=robot, name=name, kind=CHARGE))
        self._enter(task, ASSIGNED)
        self.robot[task], self._times["assigned_s"][task] = robot, now_s
        return task

    def assign(self, task: int, robot: int, at_s: float) -> None:
        """A robot is given it."""
        self._enter(task, ASSIGNED)
        self.robot[task], self._times["assigned_s"][task] = robot, at_s
        self.waiting.remove(task)

    def begin(self, task: int, at_s: float) -> None:
        """The robot that was to go on with it does."""
        self._times["assigned_s"][task] = at_s

    def pick(self, task: int, at_s: float) -> None:
        """Its robot has come to a first stop."""
        self._enter(task, PICKED)
        if np.isnan(self._times["opened_s"][task]):
            self._times["opened_s"][task] = at_s

    def take_back(self, task: int) -> None:
        """Its robot has it no more, and nothing of it has been done, or nothing since it was handed over; it waits again."""
        handed = task in self._handed
        self._enter(task, HANDED_OVER if handed else RELEASED)
        self._times["assigned_s"][task] = np.nan
        if not handed:
            self._times["opened_s"][task] = np.nan
        self._wait(task)

    def begin_anew(self, task: int, why: str) -> None:
        """Let it wait again, whole: what was done of it is lost."""
        self._enter(task, RELEASED)
        self._times["assigned_s"][task] = self._times["opened_s"][task] = np.nan
        self.tries[task] += 1
        self._reason[task] = why
        self._wait(task)

    def hand_over(self, task: int, stops: tuple[Stop, ...], why: str) -> None:
        """Its robot is lost; another is to fetch the load at the first of these stops, and to make the others."""
        self._enter(task, HANDED_OVER)
        self._times["assigned_s"][task] = np.nan
        self._handed.add(task)
        self.tasks[task] = replace(self.tasks[task], stops=stops)
        self._reason[task] = why
        self._wait(task)

    def finish(self, task: int, at_s: float) -> None:
        """It is done."""
        self._enter(task, DONE)
        self._times["done_s"][task] = at_s
        self._end(task, at_s)

    def fail(self, task: int, at_s: float, why: str) -> None:
        """It will not be done."""
        self._enter(task, FAILED)
        self._reason[task] = why
        self._end(task, at_s)

    def cancel(self, task: int, at_s: float, why: str) -> None:
        """It is withdrawn."""
        self._enter(task, CANCELLED)
        self._reason[task] = why
        self._end(task, at_s)

    def log(self) -> TaskLog:
        times = {name: frozen(np.array(column, np.float64)) for name, column in self._times.items()}
        names, kinds = (tuple(getattr(task, key) for task in self.tasks) for key in ("name", "kind"))
        robot = frozen(np.array(self.robot, np.int64))
        return TaskLog(names, robot, **times, status=tuple(self.status), reason=tuple(self._reason), kind=kinds)

    def is_order(self, task: int) -> bool:
        """True if somebody wants it done, rather than the fleet itself."""
        return self.tasks[task].kind == ORDER

    def _know(self, task: Task) -> int:
        number = len(self.tasks)
        self.tasks.append(replace(task, id=number))
        self.status.append(RELEASED)
        self.robot.append(NOBODY)
        self.tries.append(0)
        self._reason.append("")
        for name, column in self._times.items():
            column.append(task.release_s if name == "released_s" else np.nan)
        return number

    def _enter(self, task: int, status: str) -> None:
        assert status in NEXT[self.status[task]], f"{self.status[task]} -> {status}"
        self.status[task] = status

    def _wait(self, task: int) -> None:
        self.robot[task] = NOBODY
        self.waiting.append(task)

    def _end(self, task: int, at_s: float) -> None:
        self._times["ended_s"][task] = at_s
        self._open.discard(task)
        if task in self.waiting:
            self.waiting.remove(task)
        for source in self._sources:
            source.done(task)


class _Source:
    """A stream, the task that it gives next, and how many of its tasks are known and have not ended."""

    def __init__(self, tasks: Iterator[Task], num_open: int) -> None:
        self._tasks, self.num_open = tasks, num_open  # 0: tasks have times of their own
        self._known: set[int] = set()
        self.next = next(tasks, None)

    def take(self, now_s: float, number: int) -> Task | None:
        """The next task, if it is to be known by now; `number` is what it is called."""
        task = self.next
        if task is None or (len(self._known) >= self.num_open if self.num_open else task.release_s > now_s + 1e-9):
            return None
        self._known.add(number)
        self.next = next(self._tasks, None)
        return task

    def add(self, task: Task) -> None:
        """Add one to a finite source without an open number, by its time."""
        rest = [] if self.next is None else [self.next, *self._tasks]
        self._tasks = iter(sorted([*rest, task], key=lambda each: each.release_s))
        self.next = next(self._tasks)

    def done(self, number: int) -> None:
        self._known.discard(number)
