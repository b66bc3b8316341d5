"""State that changes while robots drive, by its owner: every array is written in one module, which `OWNERS` names.

The ledger's visits are in `core.visits`, its needs here; distances are along each robot's way since its start. Tables whose columns are
of one length are `packed`: Python sees their columns, kernels their records, which for the compiler are one array instead of many.
"""

from collections.abc import Mapping
from typing import Any, NamedTuple, TypeVar

import numpy as np

from mrp_sumo.core.execution import BOOKINGS
from mrp_sumo.core.graph import BoolArray, FloatArray, IntArray
from mrp_sumo.core.visits import Visits

NEVER = 2**62
Table = TypeVar("Table", bound=tuple[Any, ...])  # a NamedTuple of arrays


class VisitNeeds(NamedTuple):
    """Resources that visits need, [M] unless said."""

    first: IntArray  # [N + 1] CSR: visit k needs first[k]:first[k + 1]
    resource: IntArray
    on_lane: BoolArray  # whether only the lane to the visit's vertex needs it
    left_at_m: FloatArray  # where along the robot's way the need ends, inf: never
    freed: BoolArray
    passage: IntArray  # place in the order of its resource
    closes: BoolArray  # whether it ends its passage
    passing: IntArray  # [E] robot of each passage; empty where nobody keeps an order


class Motion(NamedTuple):
    """Places and speeds of robots, [R]."""

    s_m: FloatArray  # driven
    moved_m: FloatArray  # in the last step
    speed_mps: FloatArray
    yaw_rad: FloatArray
    turning: BoolArray  # whether the robot turned in the last step


class Grants(NamedTuple):
    """Permissions to drive, and at which speed, [R]."""

    allowed_m: FloatArray  # how far
    on_lane: BoolArray  # whether it may enter the lane after its last granted visit without having won its end
    ahead: IntArray  # the robot that it follows there, -1: none
    turned_back: BoolArray  # whether it turned round on the lane it is on: nobody follows it there, SUMO would not see it
    oldest: IntArray  # first visit that may still hold something
    cause: IntArray  # why it is granted nothing more
    other: IntArray  # the robot it waits for, -1: none
    wanted: IntArray  # the visit it waits for
    asked_s: FloatArray  # since when it asks for its next visit, inf: it does not
    queue: IntArray  # the robots in the order in which they may claim, where nobody keeps an order
    command_mps: FloatArray  # speed for the next step; negative: to be sent again


class Holds(NamedTuple):
    """Holders of resources, [Q]."""

    holder: IntArray  # robot, -1: none
    held: IntArray  # by how many of its needs
    turn: IntArray  # the passage whose turn it is


class Claims(NamedTuple):
    """Robots that may enter lanes and have not arrived at their ends, [L]."""

    number: IntArray
    claimer: IntArray  # the last of them


class Waits(NamedTuple):
    """Uses of each robot's time, [R]."""

    category: IntArray  # how the last step is booked
    waiting: BoolArray  # whether it was spent on waiting for another robot
    booked_s: FloatArray  # [R, 8] see `core.execution.BOOKINGS`
    mark_m: FloatArray  # at the last progress by a cell
    mark_s: FloatArray
    stuck: BoolArray  # no progress by a cell within the window
    since_s: FloatArray  # inf: does not wait
    cause: IntArray
    other: IntArray
    where: IntArray  # visit
    goal_s: FloatArray  # when it came to stand where its tasks end, NaN: not yet


class Yielding(NamedTuple):
    """Robots that let others pass, [R]."""

    pause: IntArray  # rank of the visit beyond which a robot that gives way claims nothing; NEVER where it does not
    pause_for: IntArray  # the robot it lets pass, -1: none
    gives_way: BoolArray  # from when it sets out to give way until it may go on


class State(NamedTuple):
    """All of it, as kernels take it."""

    motion: Motion
    grants: Grants
    holds: Holds
    claims: Claims
    waits: Waits
    yielding: Yielding
    home: BoolArray  # [R] whether the robot's way ends where its tasks do
    facing_rad: FloatArray  # [R] how the robot is to stay at the end of its way, NaN: as it comes


class Kinematics(NamedTuple):
    """Limits of the robots, [R]."""

    speed_mps: FloatArray
    decel_mps2: FloatArray
    turn_rate_rad_s: FloatArray
    reach_m: FloatArray  # before the end of its grant at which a robot asks for more, first come first served or where the order may change
    radius_m: FloatArray  # of the circle around each
    gap_m: FloatArray  # that each keeps
    behind_m: FloatArray  # that trailers reach back along its path


class Rules(NamedTuple):
    """Figures of an execution that do not change but for the policy's."""

    step_s: float  # length of a step
    books: bool  # whether somebody wants to know what robots' time is spent on
    cell_m: float  # progress by less is none
    window_s: float  # without progress in it a robot is blocked
    wait_least_s: float  # shorter waits are booked, but are no events
    look_ahead: int  # how many visits ahead of its position a robot may claim at most, with those that it needs to brake
    paced: bool  # whether a robot that is early drives slower
    asks_late: bool  # whether robots claim no more than they need to drive on, so that the order of more passages may change


class Lifts(NamedTuple):
    """Lifts, [F], and of people who want to ride the next of each."""

    resource: IntArray  # what who is in the cabin holds
    call_s: FloatArray  # how long a robot before it is there a lift is called
    recall: IntArray  # the level to which it goes when there is a fire
    mode: IntArray
    car: IntArray  # the level at which the cabin is
    target: IntArray  # and to which it comes
    until_s: FloatArray  # when it is there, with open doors
    session: IntArray  # the robot for which it comes or that is in it, -1: none, -2: people
    caller: IntArray  # the robot that is next, and
    visit: IntArray  # its visit in the cabin, -1: none
    since_s: FloatArray  # when it asked, below 0: it may enter
    service: IntArray  # whether it is in service
    ride_since_s: FloatArray  # when people asked, inf: nobody
    ride_begin: IntArray  # level
    ride_end: IntArray  # level
    ride_hold_s: FloatArray  # for which they keep its doors open when they board, and when they leave
    ride_stage: IntArray


class Doors(NamedTuple):
    """Doors, [D]."""

    move_s: FloatArray  # to open or close
    manual: BoolArray  # whether only people open it
    mode: IntArray
    until_s: FloatArray
    called: BoolArray  # whether a robot is near
    soon: BoolArray  # whether one comes before it could close and open again
    robot: IntArray  # for whom it is open: a robot, or people
    service: IntArray  # whether it is locked
    held_until_s: FloatArray  # people keep it open


class Facilities(NamedTuple):
    """F lifts and D doors, K levels."""

    any: bool  # whether there are facilities at all; else all below is empty, but for `shut`
    lifts: Lifts
    doors: Doors
    shut: BoolArray  # [L] lanes on which nobody may set out before a lift or a door is open
    level: IntArray  # [V] of vertices
    vertex_lift: IntArray  # [V] the lift in whose cabin a vertex is, -1: none
    vertex_door: IntArray  # [V] the door near which a vertex is, -1: none
    lane_lift: IntArray  # [L] the lift that one enters on a lane, -1: none
    lane_door: IntArray  # [L] the door that a lane leads through or near, -1: none
    gate_lane: IntArray  # [G] lanes by which one enters lifts, with these and their levels
    gate_lift: IntArray  # [G]
    gate_level: IntArray  # [G]
    through: IntArray  # [H] the lanes that need doors, with their doors
    through_door: IntArray  # [H]
    ride_s: FloatArray  # [F, K, K] from level to level: doors close, the cabin travels, doors open
    close_s: FloatArray  # [F, K]
    open_s: FloatArray  # [F, K]
    longest_s: float  # of `call_s`, and of a door's closing and opening


class AmongPeople(NamedTuple):
    """Shapes of robots, and what people cost them, [R]."""

    since_s: FloatArray  # since when somebody has been in its protective field
    free_since_s: FloatArray  # since when the field is free again, inf: it is not
    in_motion: BoolArray  # whether the robot was in motion then
    lost_s: FloatArray  # time that people have cost it: 1 s for each second at a standstill, half a second for one at half its speed
    lost_share: FloatArray  # and what they cost it in this step
    cap_mps: FloatArray  # the speed drawn for the lane it is on, inf: none
    half_length_m: FloatArray
    half_width_m: FloatArray
    body_x: FloatArray  # where the middles of vehicles are that cannot turn in place, and how they face; NaN: it can
    body_y: FloatArray
    body_yaw: FloatArray


class FloorLanes(NamedTuple):
    """Lanes on the floor, [L]."""

    head_x: FloatArray  # where they end
    head_y: FloatArray
    along_x: FloatArray  # for each metre of them
    along_y: FloatArray
    is_ride: BoolArray


class PeopleState(NamedTuple):
    """N people whom R robots see, on V vertices, in B bins; where people are is written by the crowd."""

    any: bool  # whether there are people, or speeds drawn for lanes; else all below is empty, but for what is by robot
    watches: bool  # whether robots have fields
    halted: BoolArray  # [R] whether somebody is in the robot's protective field, or was just now
    robots: AmongPeople
    lanes: FloorLanes
    vertex_xy: FloatArray  # [V, 2]
    x_m: FloatArray  # [N] people
    y_m: FloatArray  # [N]
    first: IntArray  # [B + 1] CSR: people by bin
    member: IntArray
    low_x: float  # of the lower left bin
    low_y: float
    bin_m: float
    columns: int
    rows: int
    body_m: float  # radius of people
    reaction_s: float  # of fields, see `crowd.model.Fields`
    extra_m: float
    side_m: float
    slowest_mps: float
    restart_s: float


class Margin(NamedTuple):
    """Time by which what robots leave is later free for others; rings of the last P steps. Used to find out the times of a plan."""

    steps: IntArray  # [K] after 0, 1, ... visits; they never decrease. Empty: it is free at once
    step: IntArray  # [1] how many have been observed
    past_m: FloatArray  # [P, R] where robots were in the last steps
    past_steps: IntArray  # [P, R] how long what they had left then has to stay theirs
    seen: IntArray  # [R] the last step that is as long ago as that
    left_m: FloatArray  # [R] and where robots were then


class Conditions(NamedTuple):
    """Conditions that the world sets robots."""

    factor: FloatArray  # [R] on their speed
    hold_until_s: FloatArray  # [R] before which they stand still
    told_m: FloatArray  # [R] how far they know they may drive
    closed: BoolArray  # [L] lanes nobody may set out on
    prompt: bool  # whether robots know at once what they are granted
    facilities: Facilities
    people: PeopleState
    margin: Margin


class Entries(NamedTuple):
    """Happenings of one step, [E]."""

    kind: IntArray
    robot: IntArray
    cause: IntArray
    visit: IntArray
    other: IntArray
    begin_s: FloatArray
    end_s: FloatArray


class Log(NamedTuple):
    """Entries of one step, and how many there are."""

    num_entries: IntArray  # [1]
    entries: Entries


class Notices(NamedTuple):
    """Robots the engine has to hear of, [R] each, filled up to the counts that `advance` returns."""

    changed: IntArray  # whose speed is another
    due: IntArray  # whose route ends soon


class StepArrays(NamedTuple):
    """All that the kernels of a step look at and change.

    They take it apart where they begin: each look into it in a loop costs the compiler all of its arrays.
    """

    kinematics: Kinematics
    rules: Rules
    visits: Visits
    needs: VisitNeeds
    state: State
    conditions: Conditions
    log: Log
    notices: Notices


class Tape(NamedTuple):
    """Record of steps in which nothing else happened, and when somebody has to look at robots though nothing does."""

    filled: IntArray  # [2] how many samples and grants are on it
    sample_every: int  # steps
    samples: FloatArray  # [K, 3, R] distance, heading, speed
    known: IntArray  # [R] twice the rank of the last visit that each robot is known to have been granted, one more where it enters a
    # lane; empty: nobody wants to know
    grant_s: FloatArray  # [G] when robots were granted more
    grant_robot: IntArray  # [G]
    granted: IntArray  # [G] what they were granted then, as in `known`
    before: IntArray  # [2, R] visits that robots had reached before the step, and had been granted
    left_s: FloatArray  # [N] when robots set out from visits; empty: nobody wants to know
    look_every: int  # steps, at which somebody looks at robots
    rests: BoolArray  # [R] robots that may stand
    held: BoolArray  # [R] robots that are to stand
    watched: IntArray  # [R] the visits of robots from which they must not go on unseen, -1: they may


def packed(table: Table) -> Table:
    """A copy of a table of columns of one length that lie side by side: a record a row."""
    columns: dict[str, Any] = dict(zip(table._fields, table))  # type: ignore[attr-defined]
    kinds = np.dtype([(name, column.dtype, column.shape[1:]) for name, column in columns.items()], align=True)
    records = np.empty(len(table[0]), np.dtype((np.record, kinds)))
    for name, column in columns.items():
        records[name] = column
    return type(table)(*(records[name] for name in columns))


def for_kernels(state: Any) -> Any:
    """State as kernels take it: records in the place of packed tables."""
    if not hasattr(state, "_fields"):
        return state
    records = getattr(state[0], "base", None)
    if isinstance(records, np.ndarray) and records.dtype.names == state._fields:
        return records.view(np.recarray)
    return type(state)(*map(for_kernels, state))


def state_at_rest(num_robots: int, num_resources: int, num_lanes: int, first: IntArray) -> State:
    """Robots that stand on their first visits [R] and hold nothing yet."""

    def of(value: float) -> FloatArray:
        return np.full(num_robots, value)

    def index(value: int) -> IntArray:
        return np.full(num_robots, value, np.int64)

    def flags() -> BoolArray:
        return np.zeros(num_robots, np.bool_)

    return State(
        motion=packed(Motion(of(0.0), of(0.0), of(0.0), of(0.0), flags())),
        grants=packed(
            Grants(
                allowed_m=of(0.0),
                on_lane=flags(),
                ahead=index(-1),
                turned_back=flags(),
                oldest=first.copy(),
                cause=index(0),
                other=index(-1),
                wanted=first.copy(),
                asked_s=of(np.inf),
                queue=np.arange(num_robots),
                command_mps=of(0.0),
            )
        ),
        holds=packed(Holds(np.full(num_resources, -1), np.zeros(num_resources, np.int64), np.zeros(num_resources, np.int64))),
        claims=packed(Claims(np.zeros(num_lanes, np.int64), np.full(num_lanes, -1))),
        waits=packed(
            Waits(
                category=index(0),
                waiting=flags(),
                booked_s=np.zeros((num_robots, len(BOOKINGS))),
                mark_m=of(0.0),
                mark_s=of(0.0),
                stuck=flags(),
                since_s=of(np.inf),
                cause=index(0),
                other=index(-1),
                where=index(-1),
                goal_s=of(np.nan),
            )
        ),
        yielding=packed(Yielding(index(NEVER), index(-1), flags())),
        home=flags(),
        facing_rad=of(np.nan),
    )


def empty_log(num_robots: int) -> Log:
    """Room for what can happen in a step: at most a blocking, a wait, a departure and an arrival a robot."""
    room = 4 * num_robots
    kind, robot, cause, visit, other = (np.zeros(room, np.int64) for _ in range(5))
    return Log(np.zeros(1, np.int64), packed(Entries(kind, robot, cause, visit, other, np.zeros(room), np.zeros(room))))


def empty_notices(num_robots: int) -> Notices:
    """Room for all robots."""
    return Notices(np.zeros(num_robots, np.int64), np.zeros(num_robots, np.int64))


def margin_of(steps: IntArray, num_robots: int) -> Margin:
    """Steps [K] by which what robots leave is free later, after 0, 1, ... visits."""
    num_past = int(steps[-1]) + 1 if len(steps) else 0
    past_steps, seen = np.zeros((num_past, num_robots), np.int64), np.zeros(num_robots, np.int64)
    return Margin(steps, np.zeros(1, np.int64), np.zeros((num_past, num_robots)), past_steps, seen, np.zeros(num_robots))


def tape_for(num_robots: int, num_grants: int, sample_every: int) -> Tape:
    """Room for so many grants; samples, and when somebody has to look, are yet to be said."""
    robot, granted, before = np.zeros(num_grants, np.int64), np.zeros(num_grants, np.int64), np.zeros((2, num_robots), np.int64)
    none = np.zeros(0, np.int64)
    return Tape(
        filled=np.zeros(2, np.int64),
        sample_every=sample_every,
        samples=np.zeros((0, 3, num_robots)),
        known=none,
        grant_s=np.zeros(num_grants),
        grant_robot=robot,
        granted=granted,
        before=before,
        left_s=np.zeros(0),
        look_every=1,
        rests=np.zeros(0, np.bool_),
        held=np.zeros(0, np.bool_),
        watched=none,
    )


OBSERVER, CONTROLLER, LEDGER, WORLD = "_observe", "_grants", "ledger", "world"
OWNERS: Mapping[str, str | Mapping[str, str]] = {  # the module of `drive` that writes the arrays of a record, or each of them
    "Visits": {"reached": OBSERVER, "arrived_s": OBSERVER, "granted": CONTROLLER, "": LEDGER},
    "VisitNeeds": {"freed": CONTROLLER, "": LEDGER},
    "Motion": OBSERVER,
    **dict.fromkeys(("Grants", "Holds", "Claims"), CONTROLLER),
    "Waits": OBSERVER,
    "Yielding": LEDGER,
    "State": LEDGER,
    "Margin": "_cycle",
    "Conditions": WORLD,
    "Lifts": {"service": WORLD, "": "_facilities"},
    "Doors": {"service": WORLD, "held_until_s": "visitors", "": "_facilities"},
    "Facilities": "_facilities",
    "PeopleState": "_people",
    "Machines": "_people",  # of `crowd.state`
    "AmongPeople": {**dict.fromkeys(("cap_mps", "body_x", "body_y", "body_yaw"), "people"), "": "_people"},
    **dict.fromkeys(("Log", "Entries"), OBSERVER),
}
