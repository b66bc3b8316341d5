"""Whom robots with work send on, on graphs that fit into a line."""

from worlds import corridor, on_a_circle

from mrp_sumo.drive.clearing import cleared


def ring(num):
    """One way round."""
    return on_a_circle([(v, (v + 1) % num) for v in range(num)], num)


def corridor_with(num, *sides):
    """Vertices 0 to num - 1, both ways, and side roads."""
    pairs = [*((v, v + 1) for v in range(num - 1)), *sides]
    return on_a_circle([lane for a, b in pairs for lane in ((a, b), (b, a))], num + len(sides))


def sent(graph, ways, idle, closed=(), taken=(), near=lambda v, others: False, passable=lambda n, v: False):
    taken = {*taken, *(route[-1] for route in ways), *closed}
    return cleared(graph, ways, dict(enumerate(idle)), set(closed), taken, near, passable)


def test_robots_on_a_ring_are_pushed_beyond_the_goal_in_their_order():
    assert sent(ring(12), [range(0, 6)], [2, 4]) == {0: 6, 1: 7}
    assert sent(ring(12), [range(0, 6)], [4, 2]) == {0: 7, 1: 6}


def test_who_rests_beyond_the_goal_is_pushed_on_only_if_others_need_the_room():
    assert sent(ring(12), [range(0, 6)], [6]) == {}
    assert sent(ring(12), [range(0, 6)], [6, 3]) == {0: 7, 1: 6}


def test_who_goes_ahead_pushes_first_and_leaves_room_behind():
    assert sent(ring(12), [[0, 1, 2, 3], [3, 4, 5, 6, 7]], [2]) == {0: 4}  # the second has left 4 by then, and stops at 7


def test_nobody_is_sent_on_where_there_is_a_way_round():
    assert sent(corridor(6), [range(0, 5)], [2], passable=lambda n, v: True) == {}
    assert sent(corridor(6), [range(0, 5)], [2]) == {0: 5}
    assert sent(corridor(6), [range(0, 5)], [3], passable=lambda n, v: True) == {}
    assert sent(corridor(6), [range(0, 5)], [4], passable=lambda n, v: True) == {0: 5}  # at the end of the way


def test_a_side_road_is_taken_where_it_is_nearer_and_far_enough_from_who_passes():
    graph = corridor_with(6, (2, 6), (6, 7))
    assert sent(graph, [range(0, 5)], [2]) == {0: 6}
    assert sent(graph, [range(0, 5)], [2], near=lambda v, others: v == 6) == {0: 7}


def beside_two(v, others):
    """A robot at 6 is in the way of one at 2."""
    return v == 6 and 2 in others


def test_who_rests_beside_a_way_and_in_its_way_is_sent_where_it_is_clear_of_it():
    graph = corridor_with(6, (2, 6), (6, 7))
    assert sent(graph, [range(0, 5)], [6]) == {}
    assert sent(graph, [range(0, 5)], [6], near=beside_two) == {0: 7}
    assert sent(graph, [range(0, 5)], [6], near=beside_two, passable=lambda n, v: True) == {}
    assert sent(graph, [range(3, 6)], [6], near=beside_two) == {}  # which does not come by 2
    assert sent(corridor_with(5, (2, 5)), [range(0, 5)], [5], near=lambda v, others: v == 5 and 2 in others) == {}  # there is no room


def test_out_of_a_dead_end_behind_who_comes_if_there_is_no_room_ahead():
    assert sent(corridor_with(5, (1, 5)), [range(0, 5)], [3]) == {0: 5}


def test_who_cannot_move_on_stays():
    assert sent(corridor(3), [range(0, 3)], [1], closed=[]) == {}
    assert sent(ring(4), [[0, 1, 2]], [1], closed=[3]) == {}
    assert sent(ring(4), [[0, 1, 2]], [1]) == {0: 3}
