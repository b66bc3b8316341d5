"""Replans come back as they were written, and the bag tells them when they are made."""

import numpy as np
import pytest
from mcap.reader import make_reader
from worlds import graph_of

from mrp_sumo.cli.main import main
from mrp_sumo.core.execution import Reply, plans_in_force
from mrp_sumo.io.replans import read_replans, write_replans
from mrp_sumo.io.run_reader import load_run

NAMES = ("robot_0", "robot_1", "robot_2")


def test_replans_come_back(tmp_path):
    graph = graph_of([(0.4 * k, 0) for k in range(5)], [(k, k + 1) for k in range(4)])
    nan, inf = np.nan, np.inf
    replies = (
        Reply(2.0, "detour", "drives around", *map(np.array, ([1], [0, 2], [3], [4, 3], [3.0, 4.0], [4.0, inf], [3.5, nan]))),
        Reply(9.5, "replan", "lacam planned anew", *map(np.array, ([0, 2], [0, 0, 1], [1, 0], [1], [10.0], [inf], [nan]))),
    )
    write_replans(tmp_path / "replans.parquet", replies, graph, NAMES)
    result = read_replans(tmp_path / "replans.parquet", graph, NAMES)
    assert len(result) == 2
    for one, other in zip(replies, result):
        for name, value in vars(one).items():
            np.testing.assert_array_equal(getattr(other, name), value, err_msg=name)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A robot breaks down in another's way for good, and the other drives around it."""
    folder = tmp_path_factory.mktemp("replans")
    scenario = folder / "around.yaml"
    scenario.write_text(
        "map: office\ndiscretisation: {kind: grid, clearance: ignore}\nrobots: {count: 9}\nseed: 102\nplanner: ecbs\n"
        "execution:\n  policy: open_loop\n  on_deadlock: resolve\n  time_limit_s: 120\n  recovery: {patience_s: 2}\n"
        "  disturbances: {stops_per_s: 0.02, speed_noise: 0.1}\n"
    )
    assert main(["run", str(scenario), "--out", str(folder / "run")]) in (0, 1)
    return folder / "run"


def messages_of(folder, topic):
    with (folder / "bag" / "bag.mcap").open("rb") as stream:
        return [message.log_time for _, _, message in make_reader(stream).iter_messages(topics=[topic])]


def test_a_run_with_replans_keeps_them_and_its_bag_tells_them_again(folder):
    run = load_run(folder)
    replies = run.execution.replies
    assert replies and (folder / "replans.parquet").is_file()
    begin = messages_of(folder, "/plan_markers")[0]
    times = [begin + round(reply.t_s * 1e9) for reply in replies]
    assert messages_of(folder, "/plan_markers") == [begin, *times]
    requested = [t for t in messages_of(folder, "/robot_path_requests") if t > begin]
    assert requested == [t for t, reply in zip(times, replies) for _ in reply.robot]
    for plan in plans_in_force(run.plan, replies):
        ends = plan.vertex[plan.first[1:] - 1]
        assert len(ends) == 9 and (np.diff(plan.first) > 0).all()
