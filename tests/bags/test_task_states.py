"""Task states in bags: what Open-RMF would report of each task, at each change."""

import json
from dataclasses import replace

import numpy as np
from rosbags.highlevel import AnyReader
from worlds import record_of_four

from mrp_sumo.bags.messages import EPOCH_NS
from mrp_sumo.bags.writer import write_bag
from mrp_sumo.core.task import CHARGE, NOBODY, ORDER, StopLog, log_of_times

NAN = np.nan
TASKS = log_of_times(
    ("done", "open", "waits", "charge_0"),
    np.array([1, 2, NOBODY, 0]),
    released_s=np.array([0.0, 1.0, 4.0, 2.0]),
    assigned_s=np.array([0.5, 1.5, NAN, 2.0]),
    opened_s=np.array([3.0, 5.0, NAN, NAN]),
    done_s=np.array([7.0, NAN, NAN, NAN]),
    kind=(ORDER, ORDER, ORDER, CHARGE),
)
STOPS = StopLog(
    task=np.array([0, 0, 1]),
    robot=np.array([1, 1, 2]),
    station=("pick", "pack", "pick"),
    vertex=np.array([0, 1, 0]),
    since_s=np.array([0.5, 4.0, 1.5]),
    begin_s=np.array([3.0, 6.0, 5.0]),
    end_s=np.array([4.0, 7.0, 99.0]),  # after the end of the run
    stood_s=np.zeros(3),
    queued_s=np.zeros(3),
    due_s=np.full(3, np.inf),
)


def states_in(bag):
    """[(s, state)] of all messages of /task_states."""
    with AnyReader([bag]) as reader:
        messages = [(ns, reader.deserialize(raw, c.msgtype)) for c, ns, raw in reader.messages() if c.topic == "/task_states"]
    return [((ns - EPOCH_NS) / 1e9, json.loads(message.data)) for ns, message in messages]


def test_each_change_of_a_task_is_said_once_with_what_is_known_by_then(tmp_path):
    record = record_of_four()
    write_bag(tmp_path / "bag", replace(record, execution=replace(record.execution, tasks=TASKS, stops=STOPS)))
    states = states_in(tmp_path / "bag")
    assert [t_s for t_s, _ in states] == sorted(t_s for t_s, _ in states)
    by_task = {name: [(t_s, s["status"]) for t_s, s in states if s["booking"]["id"] == name] for name in TASKS.name}
    assert by_task == {
        "done": [(0.0, "queued"), (0.5, "standby"), (3.0, "underway"), (4.0, "underway"), (6.0, "underway"), (7.0, "completed")],
        "open": [(1.0, "queued"), (1.5, "standby"), (5.0, "underway")],
        "waits": [(4.0, "queued")],
        "charge_0": [(2.0, "standby")],
    }
    at_six = next(s for t_s, s in states if t_s == 6.0)
    assert at_six["assigned_to"] == {"group": "mrp_sumo", "name": "robot_1"}
    assert (at_six["completed"], at_six["active"]) == ([0], 1)
    assert at_six["phases"]["0"]["detail"] == "pick" and "unix_millis_finish_time" not in at_six["phases"]["1"]
    last = next(s for t_s, s in states if t_s == 7.0)
    assert last["unix_millis_finish_time"] - last["booking"]["unix_millis_request_time"] == 7000


def test_bags_of_runs_without_tasks_have_no_task_states(tmp_path):
    write_bag(tmp_path / "bag", record_of_four())
    assert states_in(tmp_path / "bag") == []
