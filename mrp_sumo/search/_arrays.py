"""Copying array into array, element by element: `into[:] = values` compiles the words of an error, which takes seconds."""

from mrp_sumo.search._kernel import kernel


@kernel
def write_over(into, values):
    """Write as many values as `into` [n] has places."""
    for k in range(len(into)):
        into[k] = values[k]
