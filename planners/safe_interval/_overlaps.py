"""Kernel: what two robots hold at once."""

from mrp_sumo.search._kernel import kernel


@kernel(allocates=False)
def overlaps(one_resource, one_begin, one_end, other_resource, other_begin, other_end, found):
    """Write resource, first step and the step after the last, for each time that two hold one resource at once. Returns how many.

    Both are in order of resources, then of time. Rows are as many as there is room for.
    """
    i, j, num = 0, 0, 0
    while i < len(one_resource) and j < len(other_resource) and num < len(found):
        if one_resource[i] != other_resource[j]:
            if one_resource[i] < other_resource[j]:
                i += 1
            else:
                j += 1
            continue
        begin, end = max(one_begin[i], other_begin[j]), min(one_end[i], other_end[j])
        if begin < end:
            found[num, 0], found[num, 1], found[num, 2] = one_resource[i], begin, end
            num += 1
        if one_end[i] < other_end[j]:
            i += 1
        else:
            j += 1
    return num
