"""Binary heaps in flat arrays, of int64 keys or of entries by key: the smallest key on top. The caller keeps the count."""

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


@kernel
def push_by(keys, entries, count, key, entry):
    """Add an entry with its key to the first `count`; both arrays have room for one more."""
    k = count
    while k > 0:
        up = (k - 1) >> 1
        if keys[up] <= key:
            break
        keys[k], entries[k] = keys[up], entries[up]
        k = up
    keys[k], entries[k] = key, entry


@kernel
def pop_by(keys, entries, count):
    """Take the entry with the smallest of `count` keys away and return it."""
    top, last = entries[0], count - 1
    key, entry = keys[last], entries[last]
    k = 0
    while True:
        down = 2 * k + 1
        if down >= last:
            break
        if down + 1 < last and keys[down + 1] < keys[down]:
            down += 1
        if keys[down] >= key:
            break
        keys[k], entries[k] = keys[down], entries[down]
        k = down
    keys[k], entries[k] = key, entry
    return top
