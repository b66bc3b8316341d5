"""Machine code of kernels by the types of arrays."""

import numpy as np

from mrp_sumo.search._heap import push
from mrp_sumo.search.entries import enter, entries_of


def test_arrays_of_another_type_have_machine_code_of_their_own():
    whole, real, locked = np.zeros(4, np.int64), np.zeros(4), np.zeros(4, np.int64)
    locked.setflags(write=False)
    assert entries_of((whole, True)) is entries_of((whole.copy(), False))
    others = [entries_of(values) for values in ((real, True), (locked, True), (np.zeros(8, np.int64)[::2], True), (whole, 1), (whole,))]
    assert len({id(each) for each in (entries_of((whole, True)), *others)}) == 6


def test_a_kernel_is_entered_as_it_is_called():
    by_entry, called = np.zeros(8, np.int64), np.zeros(8, np.int64)
    entries = entries_of((by_entry,))
    for number, key in enumerate((5, 3, 4)):
        assert enter(entries, push, by_entry, number, key) == push(called, number, key)
    assert by_entry.tolist() == called.tolist() and by_entry[0] == 3
