"""Kernel of a constraint tree's step: one robot replanned under more constraints, and whom it is in conflict with then."""

import numpy as np

from mrp_sumo.search._conflicts import conflicts_of
from mrp_sumo.search._kernel import kernel
from mrp_sumo.search._occupancy import install_all
from mrp_sumo.search._records import CONSTRAINT, OK, RECORDS, STORE_FULL, add_record
from mrp_sumo.search._space_time import replan


@kernel(allocates=True)
def branch(tables, records, conflicts, robot, rows, effort):
    """Replan a robot of a node with constraints on top of those it has.

    Parameters
    ----------
    records
        [R] of the node, -1 for robots that do not count yet.
    conflicts
        [K] CONFLICT of the node.
    rows
        The first of the constraints to add, and the one after the last.
    effort
        See `ReplanEffort`.

    Returns
    -------
    code, record, conflicts
        OK, the new record of the robot, the conflicts of the node with it; nothing is kept otherwise.
    """
    instance, store, occupancy, _ = tables
    record = add_record(store, records[robot], robot, rows[0], rows[1])
    if record < 0:
        return STORE_FULL, record, conflicts
    code = install_all(store, occupancy, records, robot)
    if code == OK:
        code = replan(tables, record, effort)
    if code != OK:
        store.used[RECORDS] -= 1
        return code, np.int64(-1), conflicts
    return OK, record, conflicts_of(instance, store, occupancy, robot, record, conflicts)


@kernel(allocates=True)
def all_rows(store, record):
    """[N] CONSTRAINT, those that a record's chain adds up to."""
    count = 0
    link = record
    while link >= 0:
        count += store.meta[link].row1 - store.meta[link].row0
        link = store.meta[link].parent
    rows = np.empty(count, CONSTRAINT)
    count = 0
    link = record
    while link >= 0:
        for k in range(store.meta[link].row0, store.meta[link].row1):
            rows[count] = store.rows[k]
            count += 1
        link = store.meta[link].parent
    return rows


@kernel
def same_path(store, record, robot, path_of, like, row0, row1):
    """A record on the path of another one; -1 when there is no room.

    Parameters
    ----------
    record
        Whose constraints it continues, -1 for none.
    path_of
        Whose path it takes.
    like
        A record with the same constraints, whose MDD serves; -1 for none.
    row0, row1
        Constraints that the path keeps already.
    """
    new = add_record(store, record, robot, row0, row1)
    if new >= 0:
        store.meta[new].path0, store.meta[new].cost = store.meta[path_of].path0, store.meta[path_of].cost
        store.meta[new].bound = store.meta[path_of].bound
        if like >= 0:
            store.meta[new].origin = store.meta[like].origin
            store.meta[new].mdd0 = store.meta[like].mdd0
            store.meta[new].bound = min(store.meta[like].bound, store.meta[path_of].cost)
    return new
