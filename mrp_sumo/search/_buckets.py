"""Queues of a search's states by bucket: each bucket is a list, the last state put in comes out first."""

from mrp_sumo.search._constraints import BEFORE, BELOW, LABEL, STEP, VERTEX
from mrp_sumo.search._kernel import kernel


@kernel(inline="always", allocates=False)
def put(state, top, k, vertex, step, before, label, bucket):
    """Write state k, and put it on top of a bucket.

    Parameters
    ----------
    state, top
        See `Scratch`.
    k
        The state's number.
    vertex, step, before, label
        What is written; `before` is the state that it was reached from.
    bucket
        Where it goes.
    """
    state[k, VERTEX], state[k, STEP], state[k, BEFORE] = vertex, step, before
    state[k, LABEL], state[k, BELOW] = label, top[bucket]
    top[bucket] = k
