"""The operations audit finds what cannot be, and nothing where it can: each rule fires on a change by hand, and not on its neighbour."""

from dataclasses import fields, replace
from types import SimpleNamespace

import numpy as np
import pytest
from floors import BATTERY, driven, lanes, ring, scenario, tee
from shapely import LineString
from vehicles import along, quarter, straight
from worlds import graph_of, line

from mrp_sumo.core.disturbances import BREAKS
from mrp_sumo.core.execution import Event, Outcome
from mrp_sumo.core.facilities import LIFT_STATES, FacilityLog
from mrp_sumo.core.fleet import fleet_of
from mrp_sumo.core.graph import nav_graph, plan_graph
from mrp_sumo.core.robot_states import BROKEN, IDLE, STALLED, WORKING, RobotStateLog
from mrp_sumo.core.robot_type import Loaded
from mrp_sumo.core.task import Station, Stop, StopLog, Task
from mrp_sumo.experiments.audit_work import logs_of
from mrp_sumo.metrics.operations import energy, orders, places, robots
from mrp_sumo.metrics.operations.audit import LISTED, in_words, operations_audit
from mrp_sumo.metrics.operations.places import LATER_ONES, _is_corner


@pytest.fixture(scope="module")
def logs(tmp_path_factory):
    """Two robots on the ring bring loads from A to B, and one of them charges on its way: 400 s, nothing wrong with them."""
    tasks = {
        "streams": [{"name": "o", "stops": ["A", "B"], "service": [5, 3], "arrivals": {"open": 3}, "due_after_s": 200}],
        "charging": {"stations": ["c3"], "critical_low_charging_level": 85, "minimum_desired_charging_level": 90, "start_level": [90, 90]},
    }
    file = scenario(
        ring(tmp_path_factory.mktemp("ring")), tasks, starts=["c4", "c2"], shape={"battery": BATTERY}, execution={"time_limit_s": 400.0}
    )
    result = driven(file)
    assert result.status == "completed" and not result.operations_audit["findings"], result.note
    return logs_of(result)


def changed(logs, table, column, row, value):
    """The logs with one cell of a table changed by hand."""
    part = getattr(logs.execution, table)
    cells = getattr(part, column)
    if isinstance(cells, tuple):
        cells = (*cells[:row], value, *cells[row + 1 :])
    else:
        cells = cells.copy()
        cells[row] = value
    return replace(logs, execution=replace(logs.execution, **{table: replace(part, **{column: cells})}))


def rules(logs):
    return {finding["rule"] for finding in operations_audit(logs)["findings"]}


def done(logs, nth=0):
    """The number of an order that was done."""
    return [k for k, status in enumerate(logs.tasks.status) if status == "done" and logs.tasks.is_order[k]][nth]


def first_stop(logs, task):
    return int(np.flatnonzero(logs.stops.task == task)[0])


def test_a_run_with_orders_and_charging_has_no_findings(logs):
    assert operations_audit(logs) == {"passed": True, "findings": []} and in_words(operations_audit(logs)) == ""
    assert logs.tasks.status.count("done") >= 8 and not logs.tasks.is_order.all()


@pytest.mark.parametrize(
    ("column", "by", "answer"),
    [
        ("released_s", -1.0, "released once"),
        ("assigned_s", 1.0, "Little's law"),
        ("opened_s", 0.5, "loads"),
        ("done_s", -0.5, "loads"),
        ("ended_s", 0.5, "one state"),
    ],
)
def test_a_time_of_an_order(logs, column, by, answer):
    task = done(logs, 2)
    time_s = float(getattr(logs.tasks, column)[task])
    assert answer in rules(changed(logs, "tasks", column, task, time_s + by))
    assert not rules(changed(logs, "tasks", column, task, time_s + 1e-8))


def test_an_order_is_of_one_robot(logs):
    task = done(logs)
    assert "stops in order" in rules(changed(logs, "tasks", "robot", task, 1 - logs.tasks.robot[task]))


@pytest.mark.parametrize(("before_s", "passes"), [(0.9, True), (1.1, False)])
def test_an_order_is_done_within_a_second_of_its_last_stop(logs, before_s, passes):
    """The last stop of an order that counts as picked ends so long before the run does."""
    task = done(logs)
    rows = np.flatnonzero(logs.stops.task == task).tolist()
    picked = changed(changed(logs, "tasks", "status", task, "picked"), "stops", "end_s", rows[-1], logs.end_s - before_s)
    findings = [*orders._ends(picked, task, rows[0], rows, len(rows), logs.ordered[task])]
    assert (findings == []) == passes


@pytest.mark.parametrize("status", ["assigned", "picked", "failed", "cancelled", "released", "handed over", "lost"])
def test_the_state_of_an_order_that_is_done(logs, status):
    assert "one state" in rules(changed(logs, "tasks", "status", done(logs), status))


def test_that_an_order_failed_is_said_and_why(logs):
    task = int(np.flatnonzero(np.isnan(logs.tasks.ended_s) & np.isnan(logs.tasks.opened_s))[0])
    failed = changed(changed(logs, "tasks", "status", task, "failed"), "tasks", "ended_s", task, logs.end_s)
    texts = [finding.text for finding in orders.states(failed)] + [finding.text for finding in orders.ends_are_events(failed)]
    assert any("nothing says why" in text for text in texts) and any("no event says so" in text for text in texts)
    event = Event(logs.end_s, "failed", -1, text=f"order '{logs.tasks.name[task]}': robot_0 broke down with it on board")
    said = changed(failed, "tasks", "reason", task, "robot_0 broke down with it on board")
    said = replace(said, execution=replace(said.execution, events=(*said.execution.events, event)))
    assert not [*orders.states(said), *orders.ends_are_events(said)]


def test_an_order_that_nobody_asked_for_and_one_that_is_missing(logs):
    task = done(logs)
    assert rules(changed(logs, "tasks", "name", task, "order_99")) >= {"released once"}
    assert "released twice" in " ".join(f.text for f in orders.releases(changed(logs, "tasks", "name", task + 1, logs.tasks.name[task])))


def test_orders_with_times_of_their_own_are_all_there_at_their_times(tmp_path):
    tasks = [{"name": "early", "stops": ["A"], "release_s": 3.0}, {"name": "late", "stops": ["B"], "release_s": 299.0}]
    logs = logs_of(driven(scenario(ring(tmp_path), tasks, starts=["c4"])))
    assert not list(orders.releases(logs))
    (finding,) = orders.releases(changed(logs, "tasks", "released_s", 0, 2.9))
    assert (finding.order, finding.rule) == ("early", "released once")
    shorter = replace(logs, execution=replace(logs.execution, tasks=replace(logs.tasks, name=("early", "other"))))
    assert {"never released" in f.text or "nobody asked" in f.text for f in orders.releases(shorter)} == {True}


@pytest.mark.parametrize(
    ("column", "by", "answer"),
    [
        ("begin_s", -1.0, "service"),
        ("end_s", -1.0, "service"),
        ("end_s", 1.0, "service"),
        ("due_s", 5.0, "stops in order"),
        ("stood_s", 50.0, "conservation"),
        ("queued_s", -3.0, "conservation"),
        ("since_s", 60.0, "conservation"),
    ],
)
def test_a_time_of_a_stop(logs, column, by, answer):
    row = first_stop(logs, done(logs, 1))
    assert answer in rules(changed(logs, "stops", column, row, float(getattr(logs.stops, column)[row]) + by))
    assert not rules(changed(logs, "stops", column, row, float(getattr(logs.stops, column)[row]) + 1e-8))


def test_a_stop_at_another_place_by_another_robot_or_out_of_turn(logs):
    row = first_stop(logs, done(logs, 1))
    elsewhere = int(logs.stops.vertex[row + 1])
    assert {"stops in order", "service"} <= rules(changed(logs, "stops", "vertex", row, elsewhere))
    assert "stops in order" in rules(changed(logs, "stops", "station", row, "B"))
    assert "service" in rules(changed(logs, "stops", "robot", row, 1 - logs.stops.robot[row]))
    assert "stops in order" in rules(changed(logs, "stops", "task", row, int(logs.stops.task[row + 2])))


def test_findings_name_places_as_people_know_them(logs):
    row = first_stop(logs, done(logs, 1))
    elsewhere = int(logs.stops.vertex[row + 1])
    moved = changed(changed(logs, "stops", "vertex", row, elsewhere), "stops", "station", row, "")
    known = [dict(options) for options in logs.graph.vertex_options]
    known[elsewhere]["station"] = "Storage 01"
    findings = operations_audit(replace(moved, graph=replace(logs.graph, vertex_options=tuple(known))))["findings"]
    assert {f["place"] for f in findings if f["rule"] == "stops in order"} == {"Storage 01"}
    assert any("at Storage 01, expected" in f["text"] for f in findings)


def test_a_place_serves_one_robot_at_a_time(logs):
    one = first_stop(logs, done(logs))
    other = next(k for k in np.argsort(logs.stops.begin_s).tolist() if logs.stops.begin_s[k] > logs.stops.end_s[one] and k != one)
    both = changed(logs, "stops", "vertex", other, int(logs.stops.vertex[one]))
    at_once = changed(both, "stops", "begin_s", other, float(logs.stops.end_s[one]) - 0.1)
    after = changed(both, "stops", "begin_s", other, float(logs.stops.end_s[one]))
    assert [f.place for f in places.places(at_once) if f.order == logs.tasks.name[int(logs.stops.task[other])]]
    assert not [f for f in places.places(after) if f.t_s == logs.stops.end_s[one]]


def test_a_robot_that_leaves_while_it_is_served(logs):
    row = first_stop(logs, done(logs))
    robot, k = int(logs.stops.robot[row]), int(logs.stops.begin_s[row] / logs.period_s) + 20
    for away_m, answer in ((0.2, ["service"]), (0.02, [])):
        x = np.array(logs.execution.x_m)
        x[k, robot] += away_m
        moved = replace(logs, execution=replace(logs.execution, x_m=x))
        assert [f.rule for f in places.service(moved)] == answer


def test_a_second_load_on_board(logs):
    tasks, stops = logs.tasks, logs.stops
    row = first_stop(logs, done(logs))
    other = next(k for k in range(len(stops.task)) if stops.robot[k] == stops.robot[row] and stops.task[k] != stops.task[row])
    between_s = float(stops.end_s[row]) + 0.5
    mixed = changed(changed(logs, "stops", "begin_s", other, between_s), "stops", "end_s", other, between_s)
    assert any("on board" in f.text for f in orders.loads(mixed)) and tasks.is_order.any()
    assert not list(orders.loads(logs))


@pytest.mark.parametrize(
    ("station", "is_lost", "num_findings"),
    [("beside robot_{}", True, 0), ("beside robot_{}", False, 1), ("A", True, 0), ("B", True, 1)],
    ids=("fetches the load", "nobody was lost", "begins anew", "elsewhere"),
)
def test_another_robot_goes_on_with_what_a_lost_one_began_where_it_fetches_the_load(logs, station, is_lost, num_findings):
    task = done(logs)
    pick, drop = np.flatnonzero(logs.stops.task == task).tolist()
    robot = int(logs.stops.robot[pick])
    rows, begin_s = [pick, pick, drop], float(logs.stops.end_s[pick])
    columns = {key: getattr(logs.stops, key)[rows] for key in StopLog.__dataclass_fields__ if key != "station"}
    columns["robot"] = np.array([robot, 1 - robot, 1 - robot])
    columns["begin_s"] = np.array([logs.stops.begin_s[pick], begin_s + 1.0, logs.stops.begin_s[drop]])
    columns["end_s"] = np.array([begin_s, begin_s + 6.0, logs.stops.end_s[drop]])
    stops = StopLog(**columns, station=(logs.stops.station[pick], station.format(robot), logs.stops.station[drop]))
    states = RobotStateLog(
        np.array([robot, 1 - robot]),
        np.array([BROKEN if is_lost else WORKING, WORKING]),
        np.full(2, begin_s),
        np.full(2, logs.end_s),
        np.full(2, -1),
    )
    tasks = replace(logs.tasks, robot=np.where(np.arange(len(logs.tasks.name)) == task, 1 - robot, logs.tasks.robot))
    fetched = replace(logs, execution=replace(logs.execution, stops=stops, robot_states=states, tasks=tasks))
    findings = [f for f in orders.stops_in_order(fetched) if f.order == logs.tasks.name[task]]
    assert len(findings) == num_findings, [f.text for f in findings]


@pytest.mark.parametrize(
    ("open_orders", "sources", "goes_on", "may_end"), [(0, 1, False, True), (1, 0, False, True), (1, 1, True, True), (1, 1, False, False)]
)
def test_a_run_is_completed_with_open_orders_only_where_more_would_come(monkeypatch, open_orders, sources, goes_on, may_end):
    monkeypatch.setattr(orders, "_goes_on", lambda source, num: goes_on)
    tasks = SimpleNamespace(ended_s=np.array([9.0, np.nan if open_orders else 9.0]), is_order=np.ones(2, bool))
    known = SimpleNamespace(tasks=tasks, terms=SimpleNamespace(sources=(None,) * sources), known=((),) * sources)
    assert orders._all_open_end(known) == may_end


@pytest.mark.parametrize(
    ("spans", "ended_s", "since_s"),
    [
        ([(10.0, 40.0)], 40.0, None),
        ([(10.0 + robots.SETS_OUT_S, 40.0)], 40.0, None),  # it sets out a little later
        ([(10.1 + robots.SETS_OUT_S, 40.0)], 40.0, 10.0 + robots.SETS_OUT_S),
        ([(5.0, 20.0), (20.0, 40.0)], 40.0, None),
        ([(5.0, 20.0), (21.0, 40.0)], 40.0, 20.0),
        ([(5.0, 20.0)], np.nan, 20.0),  # to the end of the run
        ([(5.0, 50.0)], np.nan, None),
        ([(0.0, 5.0)], 40.0, 10.0 + robots.SETS_OUT_S),
    ],
)
def test_a_robot_with_several_orders_has_work_as_long_as_it_has_one(spans, ended_s, since_s):
    """The order is its from 10 s on; the run is over at 50 s."""
    known = SimpleNamespace(
        tasks=SimpleNamespace(robot=np.array([0]), assigned_s=np.array([10.0]), ended_s=np.array([ended_s])),
        terms=SimpleNamespace(waits_s=0.0),
        end_s=50.0,
        times_in=lambda states, robot: spans,
        of_order=lambda rule, task, text, t_s: t_s,
    )
    assert list(robots._has_work(known, 0)) == ([] if since_s is None else [since_s])


@pytest.mark.parametrize(("assigned_s", "ended_s", "robot", "says"), [
    (10.0, 11.0 + 2.0, 0, None), (10.0, 11.1 + 2.0, 0, "from 10.00 to 13.10 s"), (10.0, np.nan, 0, "from 10.00 to 50.00 s"),
    (47.5, np.nan, 0, None), (46.5, np.nan, 0, "from 46.50 to 50.00 s"), (10.0, 40.0, -1, None),
])  # fmt: skip
def test_a_robot_has_its_order_once_planners_have_had_their_time(assigned_s, ended_s, robot, says):
    """Planners take 2 s, and a robot 1 s more to set out; nobody has the order in the table of robots. The run is over at 50 s."""
    column = np.zeros(0, np.int64)
    tasks = SimpleNamespace(name=("order",), robot=np.array([robot]), is_order=np.ones(1, bool), assigned_s=np.array([assigned_s]))
    tasks.ended_s = np.array([ended_s])
    known = SimpleNamespace(
        tasks=tasks,
        terms=SimpleNamespace(waits_s=2.0),
        end_s=50.0,
        capacity=(1,),
        execution=SimpleNamespace(robot_states=SimpleNamespace(state=column, task=column, robot=column, begin_s=column, end_s=column)),
        of_order=lambda rule, task, text, t_s: text,
    )
    assert [text.partition(", but")[0] for text in robots.had(known)] == ([] if says is None else [f"is assigned {says}"])


@pytest.mark.parametrize(
    ("begin_s", "end_s", "fits"), [(10.0, 40.0, True), (13.0, 40.0, True), (13.1, 40.0, False), (9.9, 40.0, False), (10.0, 39.9, False)]
)
def test_a_robot_has_its_order_from_when_it_sets_out_to_its_end(begin_s, end_s, fits):
    """The order is assigned at 10 s and done at 40 s; planners take 2 s, and a robot 1 s more to set out."""
    zero = np.zeros(1, np.int64)
    log = SimpleNamespace(state=zero + WORKING, task=zero, robot=zero, begin_s=zero + begin_s, end_s=zero + end_s)
    tasks = SimpleNamespace(name=("order",), robot=zero, is_order=np.ones(1, bool), assigned_s=zero + 10.0, ended_s=zero + 40.0)
    known = SimpleNamespace(tasks=tasks, terms=SimpleNamespace(waits_s=2.0), end_s=50.0, capacity=(1,))
    known.execution, known.of_order = SimpleNamespace(robot_states=log), lambda rule, task, text, t_s: text
    assert len(list(robots.had(known))) == (not fits)


def test_a_robot_that_is_broken_at_a_charger_is_not_charged():
    """It stands there from 10 to 40 s, where orders are not charged, and is broken before, in between, and to the end."""
    stops = SimpleNamespace(station=("c", "c"), task=np.array([0, 1]), robot=np.zeros(2, int), begin_s=np.array([10.0, 60.0]))
    stops.end_s = np.array([40.0, 80.0])
    known = SimpleNamespace(
        stops=stops,
        tasks=SimpleNamespace(is_order=np.array([False, True])),
        terms=SimpleNamespace(charges=()),
        fleet=SimpleNamespace(num_robots=1),
        times_in=lambda states, robot: [(0.0, 10.0), (15.0, 20.0), (30.0, 40.0), (65.0, 70.0)],
    )
    assert energy.charges(known) == [(0, 10.0, 15.0), (0, 20.0, 30.0), (0, 40.0, 40.0)]
    known.terms.charges = ("c",)
    assert energy.charges(known)[3:] == [(0, 60.0, 65.0), (0, 70.0, 80.0)]
    assert energy.charged_s(known, np.array([5.0, 12.0, 25.0, 75.0]))[:, 0].tolist() == [0.0, 2.0, 10.0, 25.0]


def test_who_is_beside_a_door_when_the_run_ends_has_not_passed_it():
    """A robot drives along x, a metre in a second, and stands in the line of the door between the last two looks."""
    t_s = np.arange(4.0)
    run = SimpleNamespace(t_s=t_s, x_m=t_s[:, None], y_m=np.zeros((4, 1)))
    known = SimpleNamespace(execution=run, fleet=SimpleNamespace(num_robots=1))
    for x, passed in ((2.5, [(0, 2.0)]), (0.5, [(0, 0.0)]), (3.5, []), (-0.5, [])):
        for half_m in (1.0, 0.4):
            assert list(places._passes(known, np.array([[x, -half_m], [x, half_m]]))) == passed


def test_visits_are_where_robots_are(logs):
    reply = next(k for k, reply in enumerate(logs.execution.replies) if np.isfinite(reply.arrived_s).sum() > 1)
    arrived_s = logs.execution.replies[reply].arrived_s
    k = int(np.flatnonzero(np.isfinite(arrived_s))[1])
    for by, count in ((3.0, 1), (0.01, 0)):
        other = arrived_s.copy()
        other[k] += by
        replies = list(logs.execution.replies)
        replies[reply] = replace(replies[reply], arrived_s=other)
        assert len(list(robots.visits(replace(logs, execution=replace(logs.execution, replies=tuple(replies)))))) == count


def test_visits_of_a_plan_of_which_not_all_are_logged_are_left_out(logs):
    plan = SimpleNamespace(num_visits=3, vertex=np.array([0, 1, 2]), robot=np.zeros(3, int))
    wrong_s = np.array([0.0, 10.0, 20.0])  # the robot is not there then
    for arrived_s, count in ((wrong_s[:0], 0), (wrong_s[:2], 0), (wrong_s, 3)):
        run = replace(logs.execution, replies=(), arrived_s=arrived_s)
        assert len(list(robots.visits(replace(logs, plan=plan, execution=run)))) in (count, count - 1)


def test_states_of_robots_have_no_gaps_and_fit_their_stops(logs):
    log = logs.execution.robot_states
    row = int(np.flatnonzero(log.end_s - log.begin_s > 5)[1])
    assert "states" in rules(changed(logs, "robot_states", "end_s", row, float(log.end_s[row]) - 1))
    assert "states" in rules(changed(logs, "robot_states", "state", int(np.flatnonzero(log.task == done(logs))[0]), IDLE))
    assert "states" in rules(changed(logs, "robot_states", "task", int(np.flatnonzero(log.task == done(logs))[0]), done(logs, 3)))
    row, stop = int(np.flatnonzero(log.task == done(logs))[-1]), int(np.flatnonzero(logs.stops.task == done(logs))[-1])
    for change in (("task", row, done(logs, 3)), ("end_s", row, float(logs.stops.begin_s[stop]))):
        says = [finding.text for finding in robots.states(changed(logs, "robot_states", *change))]
        assert any("is served, but at" in text for text in says)
    assert not [*robots.states(logs)]


def test_batteries_balance(logs):
    level = logs.execution.batteries.level
    for by, answer in ((-0.01, True), (0.01, True), (1e-5, False)):
        assert bool(list(energy.batteries(changed(logs, "batteries", "level", (5, 0), level[5, 0] + by)))) == answer
    assert "batteries" in rules(changed(logs, "batteries", "used_j", 0, logs.execution.batteries.used_j[0] * 1.1))
    assert "batteries" in rules(changed(logs, "batteries", "charged_j", 0, logs.execution.batteries.charged_j[0] + 500))
    begin, *_, end = level[:, 0].tolist()
    unused = changed(logs, "batteries", "used_j", 0, logs.execution.batteries.charged_j[0])
    says = f"robot_0 ends with {100 * end:.4f} %, but what was drawn and charged leaves {100 * begin:.4f} %"
    assert begin != end and says in [finding.text for finding in energy.batteries(unused)]
    begins = next(energy.batteries(replace(logs, terms=replace(logs.terms, start_level=(0.5, 0.6)))))
    assert begins.text == "robot_0 begins with 90.00 %, expected 50 to 60 %"


@pytest.mark.parametrize(("ends", "num_findings"), [(0.8, 0), (0.85, 2)])
def test_a_battery_that_was_looked_at_twice_balances(logs, ends, num_findings):
    """A tenth was drawn in between, and all in all."""
    level, drawn, none = np.array([0.9, ends]), np.array([0.0, 0.1]), np.zeros(2)
    assert len(list(energy._balance(logs, 0, level, drawn, none, (0.0, none)))) == num_findings


@pytest.mark.parametrize(("slack", "num_findings"), [((0.0, 0.0, 0.06), 0), ((0.0, 0.06, 0.0), 1), ((0.0, 0.0, 0.0), 2)])
def test_a_lift_shortly_before_the_end_may_be_drawn_after_it(logs, slack, num_findings):
    """A twentieth more was to be drawn at last: a lift before the end may be that, one before the look before it all but the whole."""
    level, drawn, none = np.array([0.9, 0.85, 0.8]), np.array([0.0, 0.05, 0.15]), np.zeros(3)
    assert len(list(energy._balance(logs, 0, level, drawn, none, (0.0, np.array(slack))))) == num_findings


def test_a_robot_draws_by_its_weight_with_a_load_while_it_has_one(logs):
    light, t_s = logs.terms.fleet.types[0], logs.execution.t_s[-1:]
    heavy = replace(light, battery=replace(light.battery, mass_kg=2 * light.battery.mass_kg))
    by_load = replace(light, loaded=Loaded(mass_kg=2 * light.battery.mass_kg))

    def drawn_j(of, loads):
        fleet = fleet_of(of, 2)
        changed = replace(logs, terms=replace(logs.terms, fleet=fleet), execution=replace(logs.execution, loads=loads))
        return energy.drawn_j(changed, (fleet.batteries[0],) * 2, t_s)[0]

    without = np.zeros(logs.execution.x_m.shape, np.int64)
    assert (drawn_j(heavy, None) > 1.5 * drawn_j(light, None)).all()
    assert (drawn_j(by_load, without + 1) == drawn_j(heavy, None)).all()
    assert (drawn_j(by_load, without) == drawn_j(by_load, None)).all() and (drawn_j(by_load, None) == drawn_j(light, None)).all()


def test_robots_are_on_straight_lines_between_two_samples_and_nowhere_outside_the_run(logs):
    run = logs.execution
    few = replace(logs, execution=replace(run, t_s=run.t_s[:2], x_m=np.array([[0.0], [1.0]]), y_m=np.array([[5.0], [5.0]])))
    assert few.period_s == logs.period_s
    at = few.xy_at(np.zeros(5, np.int64), few.period_s * np.array([-1.0, 0.0, 0.25, 1.0, 2.5]))
    assert at == pytest.approx(np.array([[np.nan] * 2, [0.0, 5.0], [0.25, 5.0], [1.0, 5.0], [np.nan] * 2]), nan_ok=True)


@pytest.mark.parametrize(("at", "x_m"), [(0.0, np.nan), (0.5, np.nan), (1.0, 1.0), (1.5, 1.5), (2.0, 2.0), (2.5, np.nan), (3.0, np.nan)])
def test_a_robot_that_comes_or_goes_is_where_a_sample_has_it(logs, at, x_m):
    """It is not on the floor at the first sample and the last; samples are a tenth of a second apart."""
    x = np.array([np.nan, 1.0, 2.0, np.nan])[:, None]
    few = replace(logs, execution=replace(logs.execution, t_s=np.arange(4) * 0.1, x_m=x, y_m=x))
    assert few.xy_at(np.zeros(1, np.int64), np.array([at * 0.1]))[0] == pytest.approx([x_m] * 2, nan_ok=True)


def test_a_robot_that_begins_at_a_charger_is_charged_once_the_planner_has_had_its_time(tmp_path):
    tasks = {
        "list": [{"stops": ["A"], "release_s": 100.0}],
        "charging": {"stations": ["c3"], "critical_low_charging_level": 40, "start_level": [20, 20]},
    }
    file = scenario(ring(tmp_path), tasks, starts=["c3"], shape={"battery": BATTERY}, execution={"planning": {"budget_s": 3.0}})
    result = driven(file)
    run = result.execution
    row = int(np.flatnonzero(~run.tasks.is_order[run.stops.task])[0])
    begin_s, end_s = float(run.stops.begin_s[row]), float(run.stops.end_s[row])
    assert begin_s == pytest.approx(3.0, abs=0.11) and end_s - begin_s == pytest.approx(0.8 * 60.0, abs=0.3)
    assert result.status == "completed" and not result.operations_audit["findings"]


def test_charging_needs_a_charger(logs):
    row = int(np.flatnonzero(~logs.tasks.is_order[logs.stops.task])[0])
    never = changed(logs, "stops", "end_s", row, float(logs.stops.begin_s[row]))
    assert any("from a charger" in f.text for f in energy.batteries(never))


def test_nobody_drives_with_an_empty_battery(tmp_path):
    tasks = {"streams": [{"name": "o", "stops": ["A", "B"], "service": [5], "arrivals": {"open": 2}}]}
    result = driven(scenario(ring(tmp_path), tasks, starts=["A"], shape={"battery": BATTERY}, execution={"time_limit_s": 700.0}))
    logs = logs_of(result)
    assert result.metrics["robots_battery_empty"] == 1 and not result.operations_audit["findings"]
    empty = int((logs.execution.batteries.level[:, 0] <= 0).argmax())
    sooner = changed(logs, "batteries", "level", (empty - 12, 0), 0.0)
    assert any("drives at" in f.text for f in energy.empty(sooner)) and not list(energy.empty(logs))


def test_counts_and_shares_that_are_recorded(logs):
    metrics = dict(logs.metrics)
    assert rules(replace(logs, metrics=metrics | {"tasks_done": metrics["tasks_done"] + 1})) == {"conservation"}
    assert rules(replace(logs, metrics=metrics | {"station_utilisation_max": 1.249})) == {"utilisation"}
    assert not rules(replace(logs, metrics=metrics | {"station_utilisation_max": 1.0}))


@pytest.fixture(scope="module")
def queue(tmp_path_factory):
    """Two robots take turns at A of the ring, where each waits for the other."""
    tasks = {"streams": [{"name": "o", "stops": ["A"], "service": [60], "arrivals": {"open": 4}}]}
    return logs_of(driven(scenario(ring(tmp_path_factory.mktemp("queue")), tasks, starts=["c4", "B"], execution={"time_limit_s": 400.0})))


def test_who_waits_first_is_served_first(queue):
    stops = queue.stops
    assert not list(places.waits(queue)) and len(stops.task) > 4
    waits = int(
        np.argmax(np.where(stops.begin_s < 250, stops.begin_s - stops.since_s, 0))
    )  # it waited for one, and the next came behind it
    later = changed(queue, "stops", "begin_s", waits, queue.end_s)
    run, robot = later.execution, int(stops.robot[waits])
    still = (run.t_s[:, None] >= stops.begin_s[waits] - 10.0) & (np.arange(run.x_m.shape[1]) == robot)
    columns = {key: np.where(still, getattr(run, key)[still][0], getattr(run, key)) for key in ("x_m", "y_m")}
    later = replace(later, execution=replace(run, **columns))  # and stays where it waits
    (finding,) = (f for f in places.waits(later) if f.order == queue.tasks.name[int(stops.task[waits])])
    assert finding.rule == "first come, first served" and "set out later are served" in finding.text and finding.place == "A"
    urgent, number = replace(later), int(stops.task[waits])
    orders_of = {task: replace(order, priority=0 if task == number else 1) for task, order in later.ordered.items()}
    urgent.__dict__["ordered"] = orders_of
    assert finding.order not in [f.order for f in places.waits(urgent)]


@pytest.mark.parametrize(
    ("away_m", "lasts_s", "since_s"), [(1.9, 1.1, 10), (1.9, 0.9, np.inf), (2.1, 1.1, np.inf), (2.1, 47, 10), (2.1, 46, np.inf)]
)
def test_who_stands_near_its_place_for_a_second_waits_from_then_on_and_farther_away_for_most_of_its_time(away_m, lasts_s, since_s):
    """It sets out at 2 s, and stands from 10 s on; until 60 s. Two robots keep 0.4 m, of which five are near."""
    logs = SimpleNamespace(
        standing=[np.array([[10.0, 10.0 + lasts_s]])],
        graph=SimpleNamespace(xy=np.zeros((1, 2))),
        fleet=SimpleNamespace(apart_m=np.array([[0.4]])),
        xy_at=lambda robots, t_s: np.tile([away_m, 0.0], (len(t_s), 1)),
        was_in=lambda *_: False,
    )
    assert places._waits_since_s(logs, places.Wish(0, 0, "A", [0], 2.0, np.inf, np.inf), 60.0) == since_s


def starved(queue, since_s=0.0, at_m=(2.0, 0.0), state=WORKING, urgent=(), others_m=None):
    """The rows of robot_1's stops are gone, as if it had driven, and stood from then on 3 m before A, or elsewhere.

    Orders of `urgent` robots are more urgent. The others are where they were, or at `others_m`.
    """
    stops, run = queue.stops, queue.execution
    rest, others = stops.robot != 1, np.arange(run.x_m.shape[1]) != 1
    of_stops = {key: getattr(stops, key)[rest] for key in StopLog.__dataclass_fields__ if key != "station"}
    some = replace(stops, station=tuple(name for name, keep in zip(stops.station, rest.tolist()) if keep), **of_stops)
    mine = int(np.flatnonzero(queue.tasks.robot == 1)[0])
    ended_s = queue.tasks.ended_s.copy()
    ended_s[mine] = np.nan
    speed_mps = np.where(run.t_s[:, None] < since_s, 0.5, 0.0) + np.zeros(run.x_m.shape)
    tasks = replace(queue.tasks, ended_s=ended_s)
    states = RobotStateLog(np.arange(2), np.array([WORKING, state]), np.zeros(2), np.full(2, queue.end_s), np.array([0, mine]))
    columns = {"stops": some, "tasks": tasks, "speed_mps": speed_mps, "robot_states": states}
    for key, mine_m, theirs_m in zip(("x_m", "y_m"), at_m, others_m or (None, None)):
        columns[key] = np.where(others, getattr(run, key) if theirs_m is None else np.full_like(run.x_m, theirs_m), mine_m)
    logs = replace(queue, execution=replace(run, **columns))
    robot = queue.tasks.robot.tolist()
    logs.__dict__["ordered"] = {task: replace(order, priority=int(robot[task] in urgent)) for task, order in queue.ordered.items()}
    return [f.robot for f in places.waits(logs) if f.order == queue.tasks.name[mine]]


@pytest.mark.parametrize(("state", "findings"), [(WORKING, ["robot_1"]), (BROKEN, [])])
def test_who_is_never_served_waits_to_the_end_unless_it_is_broken(queue, state, findings):
    assert starved(queue, state=state) == findings


@pytest.mark.parametrize(("reason", "waiting"), [("", [0, 1]), ("robot_0 is lost", [1])])
def test_stops_of_an_order_that_was_handed_over_are_left_to_nobody(reason, waiting):
    """Two open orders of two robots, neither of which has made a stop."""
    none, stop = np.zeros(0), SimpleNamespace(station=SimpleNamespace(name="A"), places=(7,))
    tasks = SimpleNamespace(ended_s=np.full(2, np.nan), robot=np.arange(2), reason=(reason, ""), assigned_s=np.array([3.0, 5.0]))
    known = SimpleNamespace(
        stops=SimpleNamespace(task=none, robot=none, end_s=none), tasks=tasks, ordered={k: SimpleNamespace(stops=(stop,)) for k in (0, 1)}
    )
    assert list(places._left(known)) == [places.Wish(k, k, "A", [7], (3.0, 5.0)[k], np.inf, np.inf) for k in waiting]


@pytest.mark.parametrize(("served_after", "findings"), [(3, ["robot_1"]), (2, [])])
def test_who_sets_out_first_and_comes_later_is_served_later(queue, served_after, findings):
    """Three that set out after it has come are too many, from wherever it stands."""
    since_s = np.sort(queue.stops.since_s[queue.stops.robot == 0])[-served_after] - 2.0
    assert starved(queue, since_s, at_m=(100.0, 0.0)) == findings


@pytest.mark.parametrize(("x_m", "findings"), [(4.0, []), (1.0, ["robot_1"]), (5.0, ["robot_1"])], ids=("between", "behind", "at A"))
def test_who_stands_between_on_the_only_way_has_to_go_first(queue, x_m, findings):
    """robot_0 sets out for A again and again from there, and robot_1, 3 m before A, could not pass it; there is no room on the ring."""
    assert starved(queue, others_m=(x_m, 0.0)) == findings


@pytest.mark.parametrize(("two_way", "findings"), [(False, []), (True, ["robot_1"])])
def test_who_drives_on_where_nobody_can_pass_has_come_anew(tmp_path, two_way, findings):
    """robot_1 waits 3 m before A, drives away and comes back, while four that set out later are served: three each time are too many."""
    xy = {"A": (5.0, 0.0), "c1": (10.0, 0.0), "c2": (10.0, 5.0), "B": (5.0, 5.0), "c3": (0.0, 5.0), "c4": (0.0, 0.0)}
    floor = lanes(tmp_path / "floor.csv", xy, zip(xy, [*list(xy)[1:], "A"]), two_way)
    tasks = {"streams": [{"name": "o", "stops": ["A"], "service": [60], "arrivals": {"open": 4}}]}
    run = logs_of(driven(scenario(floor, tasks, starts=["c4", "B"], execution={"time_limit_s": 600.0})))
    t_s = run.execution.t_s[:, None]
    assert starved(run) == ["robot_1"]
    assert starved(run, at_m=(np.where((t_s > 100) & (t_s < 120), 100.0, 2.0), 0.0)) == findings


def test_who_stands_between_can_get_off_where_there_is_room(tmp_path):
    """As before, on a dead end from the west over 'mid' to X: whoever is at 'mid' can go east."""
    tasks = {"streams": [{"name": "o", "stops": ["X"], "service": [60], "arrivals": {"open": 4}}]}
    run = logs_of(driven(scenario(tee(tmp_path), tasks, starts=["west", "east"], execution={"time_limit_s": 500.0})))
    assert starved(run, at_m=(4.0, 0.0), others_m=(5.0, 0.0)) == ["robot_1"]
    assert starved(run, at_m=(5.0, 1.0), others_m=(5.0, 2.0)) == []  # beyond 'mid'


@pytest.mark.parametrize(("robot", "since_s"), [(0, 40.0), (1, 10.0)])
def test_one_with_several_orders_sets_out_for_a_stop_when_it_has_made_another(robot, since_s):
    """robot_0 has had order 0 since 10 s and not begun it; a stop of order 1 was over at 40 s."""
    stop = SimpleNamespace(station=None, vertex=3, places=(3,))
    logs = SimpleNamespace(
        stops=SimpleNamespace(task=np.array([1]), robot=np.array([robot]), end_s=np.array([40.0])),
        tasks=SimpleNamespace(
            ended_s=np.array([np.nan, 40.0]), robot=np.array([0, robot]), reason=["", ""], assigned_s=np.array([10.0, 20.0])
        ),
        ordered={0: SimpleNamespace(stops=[stop])},
        graph=SimpleNamespace(known_as=str),
    )
    assert list(places._left(logs)) == [places.Wish(0, 0, "3", [3], since_s, np.inf, np.inf)]


@pytest.mark.parametrize(("x_m", "findings"), [(2.0, ["robot_1"]), (100.0, [])])
def test_a_robot_that_stalls_far_away_is_in_no_line(queue, x_m, findings):
    assert starved(queue, at_m=(x_m, 0.0), state=STALLED) == findings


@pytest.mark.parametrize(("takes_s", "findings"), [(0.5, ["robot_1"]), (0.0, [])])
def test_nobody_is_in_line_for_a_stop_that_takes_no_time(queue, takes_s, findings):
    stops = replace(queue.stops, end_s=queue.stops.begin_s + takes_s)
    assert starved(replace(queue, execution=replace(queue.execution, stops=stops))) == findings


def test_who_stands_before_a_more_urgent_one_goes_first(tmp_path):
    """robot_0 and robot_2 come to A in turn, each behind the other, while robot_1 stands before it."""
    tasks = {"streams": [{"name": "o", "stops": ["A"], "service": [40], "arrivals": {"open": 6}}]}
    run = driven(scenario(ring(tmp_path), tasks, starts=["c4", "B", "c3"], execution={"time_limit_s": 600.0}))
    for urgent, findings in (((2,), []), ((), ["robot_1"]), ((0, 2), [])):
        assert starved(logs_of(run), urgent=urgent) == findings, urgent


def test_nobody_is_idle_beside_work_for_long_unsaid(logs):
    """Both robots are idle for all the time, and nobody has the orders that are there."""
    idle = RobotStateLog(np.arange(2), np.full(2, IDLE), np.zeros(2), np.full(2, logs.end_s), np.full(2, -1))
    none = np.full(len(logs.tasks.name), np.nan)
    tasks = replace(logs.tasks, assigned_s=none, ended_s=none, released_s=np.zeros(len(none)))
    lazy = replace(logs, execution=replace(logs.execution, robot_states=idle, tasks=tasks))
    (finding,) = robots.idle(lazy)
    assert finding.rule == "idle beside work" and finding.robot in ("robot_0", "robot_1")
    said = replace(lazy, execution=replace(lazy.execution, events=(Event(1.0, "unresolved", -1, text="no plan"),)))
    stalled = replace(lazy, execution=replace(lazy.execution, outcome=Outcome.PLANNER_STALLED))
    soon = replace(lazy, execution=replace(lazy.execution, tasks=replace(tasks, released_s=np.full(len(none), 300.0))))
    assert not [*robots.idle(said), *robots.idle(stalled), *robots.idle(soon)]


def test_robots_may_be_idle_beside_orders_to_whose_stations_four_others_are_bound(logs):
    """Robots are idle, and others have orders for A and B all the time and make no stop: three of them, or four."""
    idle = RobotStateLog(np.arange(2), np.full(2, IDLE), np.zeros(2), np.full(2, logs.end_s), np.full(2, -1))
    ordered, none = sorted(logs.ordered), np.full(len(logs.tasks.name), np.nan)
    no_stops = replace(logs.stops, **{each.name: getattr(logs.stops, each.name)[:0] for each in fields(logs.stops)})
    for bound, passes in ((3, False), (4, True)):
        has = np.isin(np.arange(len(none)), ordered[:bound])
        tasks = replace(logs.tasks, assigned_s=np.where(has, 0.0, none), ended_s=none, released_s=np.zeros(len(none)))
        lazy = replace(logs, execution=replace(logs.execution, robot_states=idle, tasks=tasks, stops=no_stops))
        assert ([*robots.idle(lazy)] == []) == passes


def test_orders_of_one_robot_are_done_by_it_and_neither_wait_for_others_nor_are_passed_over_by_them(logs):
    """The stream's orders as if they were all for one robot; then one of them, which waits, for the robot that others keep busy."""
    ours = {k: replace(order, robot=int(logs.tasks.robot[k])) for k, order in logs.ordered.items()}
    assert operations_audit(_ordered(logs, ours))["passed"]
    task = done(logs, 2)
    wrong = _ordered(logs, {**ours, task: replace(ours[task], robot=1 - ours[task].robot)})
    assert {(finding.rule, finding.order) for finding in orders.stops_in_order(wrong)} == {("stops in order", logs.tasks.name[task])}
    waits = changed(changed(logs, "tasks", "assigned_s", done(logs, 1), 5.0), "tasks", "opened_s", done(logs, 0), np.nan)
    bound = _ordered(waits, {**logs.ordered, done(logs, 0): replace(logs.ordered[done(logs, 0)], robot=0)})
    assert [*robots.passed_over(waits)] and not [*robots.passed_over(bound)]
    idle = RobotStateLog(np.arange(2), np.full(2, IDLE), np.zeros(2), np.full(2, logs.end_s), np.full(2, -1))
    none = np.full(len(logs.tasks.name), np.nan)
    tasks = replace(logs.tasks, assigned_s=none, ended_s=none, released_s=np.zeros(len(none)))
    lazy = replace(logs, execution=replace(logs.execution, robot_states=idle, tasks=tasks))
    for robot in (0, 1):
        (finding,) = robots.idle(_ordered(lazy, {k: replace(order, robot=robot) for k, order in logs.ordered.items()}))
        assert finding.robot == f"robot_{robot}"


def _ordered(logs, ordered):
    """The logs of a scenario that asked for these orders."""
    logs = replace(logs)
    logs.__dict__["ordered"] = ordered
    return logs


def test_an_order_is_not_passed_over_again_and_again_by_those_that_are_alike(logs):
    """An early order is still to be begun at the end, where three others were begun that came later than it takes to fetch it."""
    task = done(logs, 0)
    logs = changed(logs, "tasks", "assigned_s", done(logs, 1), 5.0)  # and has to be fetched by 5 + 120 + 2 + 2 * 40 s
    waits = changed(logs, "tasks", "opened_s", task, np.nan)
    (finding,) = robots.passed_over(waits)
    assert (finding.rule, finding.order) == ("oldest first", logs.tasks.name[task])
    third_s = np.sort(logs.tasks.opened_s[(logs.tasks.assigned_s > 207.0) & logs.tasks.is_order])[2]
    assert [*robots.passed_over(changed(logs, "tasks", "opened_s", task, third_s + 1.0))]
    assert not [*robots.passed_over(changed(logs, "tasks", "opened_s", task, third_s))]
    said = replace(waits, execution=replace(waits.execution, events=(Event(1.0, "unresolved", -1, text="no plan"),)))
    stops = (replace(waits.ordered[task].stops[0], service_s=5.1), *waits.ordered[task].stops[1:])
    longer = _ordered(waits, {**waits.ordered, task: replace(waits.ordered[task], stops=stops)})
    urgent = _ordered(waits, {k: replace(order, priority=int(k > task)) for k, order in waits.ordered.items()})
    assert not [*robots.passed_over(logs), *robots.passed_over(said), *robots.passed_over(longer), *robots.passed_over(urgent)]


def test_a_run_without_samples_has_robots_nowhere(logs):
    nothing = replace(
        logs, execution=replace(logs.execution, **{name: getattr(logs.execution, name)[:0] for name in ("t_s", "x_m", "y_m")})
    )
    assert nothing.xy_at(np.array([0, 1]), np.array([0.0, 1.0])) == pytest.approx(np.full((2, 2), np.nan), nan_ok=True)


def riding(*lifts):
    """A robot changes levels after 1 s, when each lift is in some state, for it or another."""
    zeros = np.zeros(len(lifts), np.int64)
    robot, state = (np.array(column) for column in zip(*((robot, LIFT_STATES.index(state)) for robot, state in lifts)))
    whole = [np.arange(len(lifts)), state, zeros, zeros, robot, zeros, zeros, zeros]
    none = np.zeros(0, np.int64)
    return FacilityLog(tuple("ab"[: len(lifts)]), np.zeros(len(lifts)), *whole, (), np.zeros(0), none, none, none)


@pytest.mark.parametrize(
    ("lifts", "count"),
    [
        ([(0, "taken")], 0),
        ([(1, "taken")], 1),
        ([(0, "coming")], 1),
        ([(0, "taken"), (1, "coming")], 0),
        ([(1, "coming"), (0, "taken")], 0),
        ([(1, "taken"), (0, "coming")], 1),
    ],
)
def test_who_changes_levels_has_a_lift(logs, lifts, count):
    level = np.zeros(logs.execution.x_m.shape, np.int64)
    level[10:, 0] = 1
    rides = replace(logs, execution=replace(logs.execution, level=level, facilities=riding(*lifts)))
    assert len(list(places.lifts(rides))) == count


@pytest.mark.parametrize(("state", "count"), [(2, 0), (1, 1), (0, 1)])
def test_who_drives_through_a_door_finds_it_open(logs, state, count):
    nav = nav_graph(name="door", xy=[(0.0, 0.0), (10.0, 0.0)], lanes=[(0, 1)], lane_options=[{"door": "gate"}])
    graph = plan_graph(nav, kind="roadmap", cell_m=1.0)
    none, zero = np.zeros(0, np.int64), np.zeros(1, np.int64)
    log = FacilityLog((), np.zeros(0), none, none, none, none, none, none, none, none, ("gate",), np.zeros(1), zero, zero + state, zero)
    x = np.full(logs.execution.x_m.shape, 20.0)
    x[:, 0] = np.minimum(np.arange(len(x)) * 0.05, 10)
    run = replace(logs.execution, x_m=x, y_m=np.zeros(x.shape), facilities=log)
    terms = replace(logs.terms, doors_xy=np.array([[(5.02, -1.0), (5.02, 1.0)]]))
    assert len(list(places.doors(replace(logs, execution=run, graph=graph, terms=terms)))) == count


def test_findings_of_a_rule_are_listed_up_to_a_limit(logs):
    late = replace(logs, execution=replace(logs.execution, stops=replace(logs.stops, due_s=logs.stops.due_s + 1.0)))
    answer = operations_audit(late)
    assert len(answer["findings"]) == min(LISTED, int(logs.tasks.is_order[logs.stops.task].sum()))
    assert in_words(answer).startswith("robot_") and f"and {len(answer['findings']) - 1} more findings" in in_words(answer)


def test_a_load_is_dropped_before_one_is_picked_at_the_same_instant(tmp_path):
    """The order that is listed first begins where the more urgent one ends, and nothing takes time there."""
    listed = [{"name": "later", "stops": ["B", "A"]}, {"name": "urgent", "stops": ["A", "B"], "priority": 1}]
    logs = logs_of(driven(scenario(ring(tmp_path), {"list": listed}, starts=["c4"])))
    row, other = (first_stop(logs, k) for k in (0, 1))
    assert logs.stops.begin_s[row] == logs.stops.end_s[other + 1]
    assert not list(orders.loads(logs))


@pytest.mark.parametrize(("charger", "findings"), [("c", 0), ("d", 1)])
def test_a_robot_that_another_one_cuts_off_is_passed_over_by_nobody(tmp_path, charger, findings):
    """On a line A, b, c, e with a dead end d off b, robot_1 charges at c, between A and robot_0 at e, or at d, beside the way."""
    xy = {"A": (0.0, 0.0), "b": (4.0, 0.0), "c": (8.0, 0.0), "e": (12.0, 0.0), "d": (4.0, 4.0)}
    floor = lanes(tmp_path / "floor.csv", xy, [("A", "b"), ("b", "c"), ("c", "e"), ("b", "d")], True)
    tasks = {"streams": [{"name": "o", "stops": ["A"], "service": [5], "arrivals": {"open": 1}}]}
    run = driven(scenario(floor, tasks, starts=["A", charger, "e"], execution={"time_limit_s": 100.0}))
    logs = logs_of(run)
    stops, names = logs.stops, logs.graph.vertex_name
    served = np.flatnonzero(stops.robot == 0)
    assert len(served) > LATER_ONES + 2
    columns = {key: getattr(stops, key).copy() for key in StopLog.__dataclass_fields__ if key != "station"}
    first, charges = served[0], served[1]
    # by hand: the robot at e is to come from the start, and the other one charges all the time
    columns["robot"][[first, charges]] = 2, 1
    columns["since_s"][first], columns["begin_s"][first] = 0.0, logs.end_s
    columns["vertex"][charges] = names.index(charger)
    columns["begin_s"][charges], columns["end_s"][charges] = 0.0, logs.end_s
    cut = replace(logs, execution=replace(logs.execution, stops=replace(stops, **columns)))
    waits = [finding for finding in places.waits(cut) if finding.robot == "robot_2"]
    assert len(waits) == findings


@pytest.mark.parametrize(("later_at", "found_s", "cut_off"), [(0, 600.0, True), (4, 600.0, False), (0, 376.0, True), (0, 374.0, False)])
def test_who_is_cut_off_by_a_lost_robot_is_so_where_it_waits_then(later_at, found_s, cut_off):
    """On a row of six, with the place at 5, a robot is lost at 2 from 100 s on: another waits at 4 at first, and then there or at 0.

    What counts is most of its 550 s.
    """
    graph, none = line(6), np.zeros(0)

    def xy_at(robot, t_s):
        return graph.xy[np.where(robot == 1, 2, np.where(t_s < 100.0, 4, later_at))]

    logs = SimpleNamespace(
        stops=SimpleNamespace(vertex=none, robot=none, begin_s=none, end_s=none),
        graph=graph,
        fleet=SimpleNamespace(num_robots=2),
        times_in=lambda states, robot: [(100.0, found_s)] * robot,
        xy_at=xy_at,
    )
    assert places._is_cut_off(logs, places.Wish(0, 0, "at 5", [5], 0.0, np.inf, np.inf), 50.0, 600.0) == cut_off


@pytest.mark.parametrize(("until_s", "cut_off"), [((600.0, 600.0), True), ((600.0, 300.0), False), ((300.0, 600.0), False)])
def test_who_is_shut_in_by_two_that_are_served_is_cut_off(until_s, cut_off):
    """On a ring of six, with the place at 5, others are served at 0 and at 3 for most of the time of one at 1, or only one of them is."""
    pairs = [(k, (k + 1) % 6) for k in range(6)]
    graph = graph_of([(0.0, 0.0), (1.0, 0.0), (2.0, 0.0), (2.0, 1.0), (1.0, 1.0), (0.0, 1.0)], pairs, 1.0)
    logs = SimpleNamespace(
        stops=SimpleNamespace(vertex=np.array([0, 3]), robot=np.array([1, 2]), begin_s=np.zeros(2), end_s=np.array(until_s)),
        graph=graph,
        fleet=SimpleNamespace(num_robots=3),
        times_in=lambda states, robot: [],
        xy_at=lambda robot, t_s: graph.xy[np.where(robot == 0, 1, 0)],
    )
    assert places._is_cut_off(logs, places.Wish(0, 0, "at 5", [5], 0.0, np.inf, np.inf), 50.0, 600.0) == cut_off


@pytest.mark.parametrize(("at", "two_way", "cut_off"), [(0, False, True), (4, False, False), (0, True, False)])
def test_on_a_one_way_ring_a_lost_robot_cuts_off_who_has_yet_to_pass_it(at, two_way, cut_off):
    """On a ring of six, with the place at 5 and a robot lost at 2: from 0 the way over 2 is the only one, unless it leads back, too."""
    pairs, none = [(k, (k + 1) % 6) for k in range(6)], np.zeros(0)
    xy = [(0.0, 0.0), (1.0, 0.0), (2.0, 0.0), (2.0, 1.0), (1.0, 1.0), (0.0, 1.0)]
    graph = graph_of(xy, pairs if two_way else [], 1.0, [] if two_way else pairs)
    logs = SimpleNamespace(
        stops=SimpleNamespace(vertex=none, robot=none, begin_s=none, end_s=none),
        graph=graph,
        fleet=SimpleNamespace(num_robots=2),
        times_in=lambda states, robot: [(0.0, 600.0)] * robot,
        xy_at=lambda robot, t_s: graph.xy[np.where(robot == 1, 2, at)],
    )
    assert places._is_cut_off(logs, places.Wish(0, 0, "at 5", [5], 0.0, np.inf, np.inf), 50.0, 600.0) == cut_off


@pytest.mark.parametrize(
    ("place", "at", "too_far_back"), [(2, [3, 0, 1, 4], True), (2, [4, 0, 5, 3], False), (5, [3, 0, 1, 4], False), (0, [5, 3, 0, 1], True)]
)
def test_on_a_line_nobody_gets_to_a_place_beyond_which_there_is_no_room_for_all_before(place, at, too_far_back):
    """robot_3 is in a row of six: on 0 and 1 there is room for one of the others, not for three, and none beyond the ends."""
    graph = line(6)
    logs = SimpleNamespace(graph=graph, fleet=SimpleNamespace(num_robots=4), xy_at=lambda robot, t_s: graph.xy[np.array(at)[robot]])
    wish = places.Wish(0, 3, f"at {place}", [place], 0.0, np.inf, np.inf)
    assert places._is_too_far_back(logs, wish) == too_far_back


def test_on_a_ring_everybody_gets_everywhere(queue):
    assert not places._is_too_far_back(queue, places.Wish(0, 1, "at 0", [0], 0.0, np.inf, np.inf))


@pytest.mark.parametrize(("moves_s", "is_fine"), [(20.0, True), (19.5, False)])
def test_a_broken_robot_may_be_pushed_so_long_after_it_broke_down_and_not_before(logs, moves_s, is_fine):
    """It breaks down at 30 s, which is noted 0.5 s later."""
    run = logs.execution
    x_m, y_m = run.x_m.copy(), run.y_m.copy()
    y_m[:, 0], x_m[:, 0] = 0.0, 0.5 * np.clip(run.t_s - 30.0 - moves_s, 0.0, None)
    names = RobotStateLog(*(np.array([value]) for value in (0, BROKEN, 30.5, 90.0, -1)))
    breaks = Event(30.0, "disturbed", 0, duration_s=60.0, text=BREAKS)
    broken = replace(run, x_m=x_m, y_m=y_m, robot_states=names, events=(*run.events, breaks))
    towed = tuple(replace(each, mtbf_h=1.0, mttr_h=1.0, tow_s=20.0) for each in logs.terms.fleet.types)
    terms = replace(logs.terms, fleet=replace(logs.terms.fleet, types=towed))
    answer = [*robots.stands(replace(logs, execution=broken, terms=terms))]
    assert bool(answer) == (not is_fine)


def test_vehicles_may_stand_aside_at_the_ends_of_curves_and_nowhere_on_a_straight_line():
    """From v0 straight to v1, round to v2, and straight on over v3 to v4, where no lane turns at v2 but the axle is on the curve still."""
    graph = along(straight((0, 0), (4, 0)), quarter(4.0, (4, 0)), straight((8, 4), (8, 8)), straight((8, 8), (8, 12)), cell_m=9.0)
    assert _is_corner(graph)[:5].tolist() == [False, True, True, False, False]


SHELF, OTHER = Station("shelf", (5,), holds=1), Station("other", (6,))
BRINGS, FETCHES = (Stop(6, station=OTHER), Stop(5, station=SHELF)), (Stop(5, station=SHELF), Stop(6, station=OTHER))


@pytest.mark.parametrize(
    ("orders_made", "end_s", "reason", "rows"),
    [
        ([BRINGS, BRINGS], 99.0, "", [3]),
        ([BRINGS, FETCHES, BRINGS], 99.0, "", []),
        ([BRINGS, BRINGS, FETCHES, BRINGS], 99.0, "", [3, 7]),
        ([FETCHES, BRINGS, BRINGS], 99.0, "", [5]),  # what was there before is not known
        ([BRINGS, BRINGS], 3.5, "", []),  # over before it is set down
        ([BRINGS, BRINGS], 99.0, "robot_0 broke down", []),
    ],
)
def test_a_place_holds_no_more_than_it_has_room_for(orders_made, end_s, reason, rows):
    """Each order takes two seconds: a stop a second."""
    num = len(orders_made)
    vertex = [stop.places[0] for stops in orders_made for stop in stops]
    known = SimpleNamespace(
        stops=SimpleNamespace(task=np.repeat(np.arange(num), 2), end_s=np.arange(1.0, 2 * num + 1), vertex=np.array(vertex)),
        tasks=SimpleNamespace(reason=(reason,) * num),
        ordered={k: Task(k, stops) for k, stops in enumerate(orders_made)},
        end_s=end_s,
        graph=SimpleNamespace(known_as=str),
        of_stop=lambda rule, row, text, t_s: (row, text),
    )
    findings = list(places.held(known))
    assert [row for row, _ in findings] == rows
    assert {text for _, text in findings} <= {"sets down load 2 at 5, which holds 1"}


def test_ways_cross_a_door_where_lines_do():
    chance = np.random.default_rng(2)
    a, b, door = chance.uniform(-1, 1, (200, 2)), chance.uniform(-1, 1, (200, 2)), chance.uniform(-1, 1, (2, 2))
    lines = [LineString([one, other]).crosses(LineString(door)) for one, other in zip(a, b)]
    assert 20 < sum(lines) < 180 and places._cross(a, b, door).tolist() == lines
    to_it, from_it = np.array([[0.0, -1.0]]), np.array([[0.0, 0.0]])  # who ends on it has crossed it, who begins on it does not again
    for ways, crosses in (((to_it, from_it), True), ((from_it, to_it), False)):
        assert places._cross(*ways, np.array([[-1.0, 0.0], [1.0, 0.0]])).tolist() == [crosses]


@pytest.mark.parametrize(
    ("capacity", "done_s", "shown", "reason", "findings"),
    [
        (2, (20.0, 30.0), [1, 2, 1, 0], "", []),
        (1, (20.0, 30.0), [1, 2, 1, 0], "", ["robot_0 has 2 orders on board from 10.00 s on, and can carry 1"]),
        (1, (10.0, 30.0), [1, 1, 1, 0], "", []),  # the first is set down as the second is picked up
        (1, (20.0, 30.0), [1, 2, 1, 0], "robot_0 broke down", []),  # it was lost
        (2, (20.0, 30.0), [1, 1, 1, 0], "", ["robot_0 has 1 loads on board at 15.00 s, expected 2 after its stops"]),
        (2, (20.0, 30.0), None, "", []),
    ],
)
def test_a_robot_carries_what_its_stops_put_on_board_and_no_more_than_it_can(capacity, done_s, shown, reason, findings):
    """Two orders of two stops each are picked at 5 s and at 10 s; the trajectory is looked at 7.5, 15, 25 and 35 s."""
    task, end_s = np.array([0, 1, 0, 1]), np.array([5.0, 10.0, *done_s])
    known = SimpleNamespace(
        tasks=SimpleNamespace(reason=(reason, ""), done_s=np.array(done_s), status=("done", "done")),
        stops=SimpleNamespace(task=task, robot=np.zeros(4, int), end_s=end_s),
        execution=SimpleNamespace(loads=None if shown is None else np.array(shown)[:, None], t_s=np.array([7.5, 15.0, 25.0, 35.0])),
        ordered={k: Task(k, BRINGS) for k in range(2)},
        capacity=[capacity],
        terms=SimpleNamespace(waits_s=0.0),
        robot=lambda r: f"robot_{r}",
    )
    assert [finding.text for finding in orders.on_board(known)] == findings
