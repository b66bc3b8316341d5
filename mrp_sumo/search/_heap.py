"""A binary heap of int64 keys in a flat array: the smallest key on top. The caller keeps the count."""

from mrp_sumo.search._kernel import kernel


@kernel
def push(heap, count, key):
    """Add a key to the first `count`; the array has room for one more."""
    k = count
    while k > 0:
        up = (k - 1) >> 1
        if heap[up] <= key:
            break
        heap[k] = heap[up]
        k = up
    heap[k] = key


@kernel
def pop(heap, count):
    """Take the smallest of `count` keys away and return it."""
    top = heap[0]
    last = count - 1
    key = heap[last]
    k = 0
    while True:
        down = 2 * k + 1
        if down >= last:
            break
        if down + 1 < last and heap[down + 1] < heap[down]:
            down += 1
        if heap[down] >= key:
            break
        heap[k] = heap[down]
        k = down
    heap[k] = key
    return top
