"""Kernels: what two robots hold at once. What each holds is in order of resources, then of time."""

from mrp_sumo.search._kernel import kernel
from planners.safe_interval._table import FOREVER


@kernel(allocates=False)
def overlaps(one_resource, one_begin, one_end, other_resource, other_begin, other_end, found):
    """Write resource, first step and the step after the last, for each time that two hold one resource at once. Returns how many.

    Rows are as many as there is room for.
    """
    i, j, num = 0, 0, 0
    while num < len(found):
        k, begin, end, i, j = next_overlap(one_resource, one_begin, one_end, other_resource, other_begin, other_end, i, j)
        if k < 0:
            break
        found[num, 0], found[num, 1], found[num, 2] = one_resource[k], begin, end
        num += 1
    return num


@kernel(allocates=False)
def first_overlap(one_resource, one_begin, one_end, other_resource, other_begin, other_end):
    """The first step at which two robots hold one resource, FOREVER if never."""
    i, j, first = 0, 0, FOREVER
    while True:
        k, begin, _, i, j = next_overlap(one_resource, one_begin, one_end, other_resource, other_begin, other_end, i, j)
        if k < 0:
            return first
        first = min(first, begin)


@kernel(allocates=False)
def next_overlap(one_resource, one_begin, one_end, other_resource, other_begin, other_end, i, j):
    """The next time that both hold one resource, from entries i and j on.

    Returns
    -------
    k
        The entry of the first robot; -1 where there is no such time.
    begin, end
        The first step, and the one after the last.
    i, j
        Where to go on.
    """
    while i < len(one_resource) and j < len(other_resource):
        if one_resource[i] != other_resource[j]:
            if one_resource[i] < other_resource[j]:
                i += 1
            else:
                j += 1
            continue
        k, begin, end = i, max(one_begin[i], other_begin[j]), min(one_end[i], other_end[j])
        if one_end[i] < other_end[j]:
            i += 1
        else:
            j += 1
        if begin < end:
            return k, begin, end, i, j
    return -1, 0, 0, i, j
