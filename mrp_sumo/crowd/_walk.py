"""The kernel of a crowd, in steps of at most 0.04 s.

People walk as fast as the room ahead of them lets them (Tordeux, Chraibi, Seyfried, "Collision-free speed model for pedestrian dynamics",
Traffic and Granular Flow '15, 2016), and turn to where they will have to pass others, sooner for those who come towards them, so that lanes
form (Xu, Chraibi, Seyfried, "Anticipation in a velocity-based model for pedestrian dynamics", Transportation Research Part C 133, 2021).
Walls, robots and bodies that touch push as in the social force model of Helbing and Molnar (Phys. Rev. E 51, 4282, 1995). The push of walls
never slows anybody down, since ways know of walls; nobody walks backwards for others, nor into a robot, nor through a wall. Neighbours come
from bins, so that the work grows with the number of people.
"""

import numpy as np

from mrp_sumo.crowd._floor import NO_WAY, NUM_ANGLES, THERE, distance_to_wall, from_wall
from mrp_sumo.crowd.state import ASIDE_M, BODY_M, CELL_M
from mrp_sumo.search._kernel import kernel

STEP_S = 0.04  # at most
RELAX_S = 0.5  # tau
WALL_M2PS2, WALL_M = 10.0, 0.2  # U0 and R of the walls' potential
SIGHT, BEHIND = np.cos(np.radians(100.0)), 0.5  # people see so far to the side; what they do not see counts half
FASTEST = 1.3  # of the speed that one likes
BIN_M = 2.5  # others farther away do not matter
LANE_M, ONCOMING = 0.27, 0.7  # who is ahead this far to the side; part of it for those who come towards one
AHEAD_S, ROUND, ALIKE, FADE_M, SIDE_M = 1.0, 0.5, 0.4, 0.6, 0.8  # how people turn to pass others, see `round_people`
TOUCH_M, TOUCH_PS2 = 0.4, 100.0  # distance at which two touch; push of bodies by what they are closer
KEEP_RIGHT = np.radians(3.0)
ROBOT_MPS2, ROBOT_M, ROBOT_AHEAD_S = 7.0, 0.3, 0.6  # push of a robot at its surface, how it fades; where it will be is seen so far ahead
STANDS_MPS = 0.05  # a robot that is slower stands
COMES_MPS = 0.25  # who is slower does not come towards one, but is pushed
ROUND_M, ROUND_ROOM_M = 3.0, 0.35  # people begin to walk round a robot so far before it, and so far beside
YIELD_M = 2.0  # where there is no way past a robot: how near one lets it pass
SLOWS_M = 0.7  # from there
CORNER_M, PARTS = 0.5, 4  # who has no room so far ahead is in a corner, and looks for room beside this many parts of the way to the robot
AGAINST = -0.5  # cosine of the angle between one's way and a robot's, for who meets it
CLEAR_M = 0.02  # beside a robot
AT_WALL_M = 0.15  # nobody's centre is closer to a wall
SLOW = 0.2  # of the speed that one likes: who is slower stands
BEFORE_ROBOT_M, FORGETS = 1.2, 0.25  # and waits for a robot that is no farther; how fast it forgets that if it walks there
WAITS_S, PATIENCE_S, AWAY_S = 1.5, 8.0, 12.0  # who has stood so long before a robot lets it pass; and goes back for a while


@kernel
def walk(now, dt, count, walkers, ground, robots, ways):
    """Let the first `count` people walk for `dt` seconds from `now`, among robots where these will be then.

    Parameters
    ----------
    ways
        [S, C] uint8, see `_floor.march`.

    Returns
    -------
    int
        How many are where they wanted to go.
    """
    put_in_bins(robots.x_m, robots.y_m, len(robots.x_m), ground, robots.first, robots.member)
    num_steps = max(1, int(np.ceil(dt / STEP_S - 1e-9)))
    h = dt / num_steps
    for _ in range(num_steps):
        put_in_bins(walkers.x_m, walkers.y_m, count, ground, walkers.first, walkers.member)
        for p in range(count):
            push(now, p, walkers, ground, robots, ways)
        for p in range(count):
            move(h, p, walkers, ground, robots)
    put_in_bins(walkers.x_m, walkers.y_m, count, ground, walkers.first, walkers.member)
    num_there = 0
    for p in range(count):
        look_back(now + dt, dt, p, walkers, ground, robots)
        num_there += walkers.is_there[p]
    return num_there


@kernel
def put_in_bins(x, y, count, ground, first, member):
    """Sort people or robots into bins; NaN: into none."""
    first[:] = 0
    for p in range(count):
        if x[p] == x[p]:
            first[bin_of(x[p], y[p], ground) + 1] += 1
    for b in range(1, len(first)):
        first[b] += first[b - 1]
    total = first[len(first) - 1]
    for p in range(count - 1, -1, -1):
        if x[p] == x[p]:
            b = bin_of(x[p], y[p], ground) + 1
            first[b] -= 1
            member[first[b]] = p
    for b in range(len(first) - 1):  # each is where its bin begins
        first[b] = first[b + 1]
    first[len(first) - 1] = total


@kernel(inline="always")
def within(distance, size, count):
    """The one of so many parts of a size that lies so far from the first one's edge; the first or last for what is beyond."""
    return min(max(int(distance / size), 0), count - 1)


@kernel(inline="always")
def bin_of(x, y, ground):
    """The bin of a place; those beyond the edge count as at it."""
    return within(y - ground.y_m, BIN_M, ground.rows) * ground.columns + within(x - ground.x_m, BIN_M, ground.columns)


@kernel(inline="always")
def bins_around(x, y, ground):
    """Rows and columns of the bins where neighbours are: from one up to, without, the other."""
    row, column = within(y - ground.y_m, BIN_M, ground.rows), within(x - ground.x_m, BIN_M, ground.columns)
    return max(row - 1, 0), min(row + 2, ground.rows), max(column - 1, 0), min(column + 2, ground.columns)


@kernel(inline="always")
def cell_of(x, y, ground):
    """The cell of a place, at the edge for those beyond."""
    return within(y - ground.y_m, CELL_M, ground.height) * ground.width + within(x - ground.x_m, CELL_M, ground.width)


@kernel
def push(now, p, walkers, ground, robots, ways):
    """The force that drives a person, and those that push it."""
    x, y, vx, vy = walkers.x_m[p], walkers.y_m[p], walkers.vx_mps[p], walkers.vy_mps[p]
    wish, cell = walkers.wish_mps[p], cell_of(walkers.x_m[p], walkers.y_m[p], ground)
    is_away = now < walkers.away_until_s[p]
    code = ways[walkers.home[p] if is_away else walkers.goal[p], cell]
    if code == NO_WAY:
        code = ground.back[cell]
    if code == THERE and not is_away:
        walkers.is_there[p] = True
    ex, ey = 0.0, 0.0
    if code < NUM_ANGLES:
        angle = code * (2.0 * np.pi / NUM_ANGLES)
        ex, ey = np.cos(angle - KEEP_RIGHT), np.sin(angle - KEEP_RIGHT)
    is_stuck = walkers.stuck_s[p] > WAITS_S
    tx, ty = round_robots(p, ex, ey, is_stuck, walkers, ground, robots)
    meets = False
    if tx == ex and ty == ey:  # robots come first
        tx, ty, meets = round_people(p, ex, ey, walkers, ground)
    ax, ay, gap = push_of_people(p, tx, ty, walkers, ground)
    if meets and gap < walkers.spacing_m[p] + wish * walkers.headway_s[p]:  # who is slowed there goes straight on if that leads farther
        sx, sy, straight = push_of_people(p, ex, ey, walkers, ground)
        if straight > max(gap, walkers.spacing_m[p]):
            tx, ty, ax, ay, gap = ex, ey, sx, sy, straight
    rx, ry, away = push_of_robots(x, y, ex, ey, is_stuck or is_away, ground, robots)
    wx, wy = push_of_walls(x, y, ex, ey, ground, cell) if away > YIELD_M else (0.0, 0.0)
    goes = min(wish, max(gap - walkers.spacing_m[p], 0.0) / walkers.headway_s[p])
    back = min(ax * ex + ay * ey + goes / RELAX_S, 0.0)  # nobody walks backwards for others
    ax, ay = ax - back * ex, ay - back * ey
    walkers.ax_mps2[p] = (goes * tx - vx) / RELAX_S + ax + rx + wx
    walkers.ay_mps2[p] = (goes * ty - vy) / RELAX_S + ay + ry + wy


@kernel
def round_people(p, tx, ty, walkers, ground):
    """The direction, as long as it was, turned to where there is less of others ahead; True as well if anybody comes towards one.

    Those who come towards one count more than those who go the same way (`ALIKE`), as near as they will be in `AHEAD_S`, and less the
    farther ahead and aside they are.
    """
    size, x, y = np.hypot(tx, ty), walkers.x_m[p], walkers.y_m[p]
    if size < 1e-6:
        return tx, ty, False
    ex, ey, turn, meets = tx / size, ty / size, 0.0, False  # to the left
    row0, row1, column0, column1 = bins_around(x, y, ground)
    for row in range(row0, row1):
        for k in range(walkers.first[row * ground.columns + column0], walkers.first[row * ground.columns + column1]):
            q = walkers.member[k]
            dx, dy = walkers.x_m[q] - x, walkers.y_m[q] - y
            ahead, left, away = dx * ex + dy * ey, dy * ex - dx * ey, np.hypot(dx, dy)
            if q == p or ahead <= 0.0 or away > BIN_M:
                continue
            ox, oy = walkers.vx_mps[q], walkers.vy_mps[q]
            closing_mps = ((walkers.vx_mps[p] - ox) * dx + (walkers.vy_mps[p] - oy) * dy) / max(away, 1e-3)
            soon_m = max(away - max(closing_mps, 0.0) * AHEAD_S, 0.0)
            against = (1.0 - (ox * ex + oy * ey) / max(np.hypot(ox, oy), 0.1)) / 2.0
            weight = ROUND * (ALIKE + against) * np.exp((TOUCH_M - soon_m) / FADE_M - (left / SIDE_M) ** 2)
            turn += weight if left < 0.0 else -weight  # to the right of who is right ahead
            meets |= ox * ex + oy * ey < -COMES_MPS
    bx, by = ex - turn * ey, ey + turn * ex
    scale = size / np.hypot(bx, by)
    return scale * bx, scale * by, meets


@kernel
def push_of_people(p, ex, ey, walkers, ground):
    """The push of bodies, and how far ahead the next one is."""
    x, y, ax, ay, gap = walkers.x_m[p], walkers.y_m[p], 0.0, 0.0, np.inf
    row0, row1, column0, column1 = bins_around(x, y, ground)
    for row in range(row0, row1):
        for k in range(walkers.first[row * ground.columns + column0], walkers.first[row * ground.columns + column1]):
            q = walkers.member[k]
            dx, dy = x - walkers.x_m[q], y - walkers.y_m[q]
            away = np.hypot(dx, dy)
            if q == p or away > BIN_M:
                continue
            ahead, aside = -(dx * ex + dy * ey), abs(dx * ey - dy * ex)
            is_alike = ex * walkers.vx_mps[q] + ey * walkers.vy_mps[q] > 0.0
            if ahead > 0.0 and aside < (LANE_M if is_alike else ONCOMING * LANE_M):
                gap = min(gap, ahead)
            if away < TOUCH_M:
                size = TOUCH_PS2 * (TOUCH_M / max(away, 1e-3) - 1.0)
                along = max(size * -ahead, 0.0) if is_alike else 0.0  # followers do not push forward
                ax += size * dx - along * ex
                ay += size * dy - along * ey
    return ax, ay, gap


@kernel
def push_of_walls(x, y, ex, ey, ground, cell):
    """The push of the nearest wall, to the side only: a way through a door leads through it."""
    away, nx, ny = nearest_wall(x, y, ground, cell)
    if away == np.inf:
        return 0.0, 0.0
    size = WALL_M2PS2 / WALL_M * np.exp(-away / WALL_M)
    fx, fy = size * nx, size * ny
    back = min(fx * ex + fy * ey, 0.0)
    return fx - back * ex, fy - back * ey


@kernel
def nearest_wall(x, y, ground, cell):
    """Distance of the nearest wall, inf where none is near, and the direction away from it."""
    best, nearest = np.inf, -1
    for k in range(ground.first[cell], ground.first[cell + 1]):
        w = ground.near[k]
        away = distance_to_wall(x, y, ground.walls[w, 0], ground.walls[w, 1], ground.walls[w, 2], ground.walls[w, 3])
        if away < best:
            best, nearest = away, w
    if nearest < 0:
        return best, 0.0, 0.0
    nx, ny = from_wall(x, y, ground.walls[nearest, 0], ground.walls[nearest, 1], ground.walls[nearest, 2], ground.walls[nearest, 3])
    size = max(np.hypot(nx, ny), 1e-9)
    return best, nx / size, ny / size


@kernel(inline="always")
def from_robot(x, y, robot, robots, reach_s):
    """Distance of a point from a robot's footprint, negative inside, and the direction away from it.

    The footprint is stretched by what the robot drives in `reach_s`.
    """
    cos, sin = np.cos(robots.yaw_rad[robot]), np.sin(robots.yaw_rad[robot])
    dx, dy = x - robots.x_m[robot], y - robots.y_m[robot]
    stretch = robots.along_mps[robot] * reach_s / 2.0
    u, v = cos * dx + sin * dy - stretch, cos * dy - sin * dx
    a, b = robots.half_length_m[robot] + abs(stretch), robots.half_width_m[robot]
    out_u, out_v = abs(u) - a, abs(v) - b
    if out_u <= 0.0 and out_v <= 0.0:
        if out_u > out_v:
            away, mx, my = out_u, np.sign(u), 0.0
        else:
            away, mx, my = out_v, 0.0, 1.0 if v >= 0.0 else -1.0
    else:
        mx, my = max(out_u, 0.0) * np.sign(u), max(out_v, 0.0) * np.sign(v)
        away = max(np.hypot(mx, my), 1e-9)
        mx, my = mx / away, my / away
    return away, cos * mx - sin * my, sin * mx + cos * my


@kernel
def robot_away_m(x, y, ground, robots):
    """Distance of a point from the nearest robot, inf where none is near."""
    nearest = np.inf
    row0, row1, column0, column1 = bins_around(x, y, ground)
    for row in range(row0, row1):
        for k in range(robots.first[row * ground.columns + column0], robots.first[row * ground.columns + column1]):
            away, _, _ = from_robot(x, y, robots.member[k], robots, 0.0)
            nearest = min(nearest, away)
    return nearest


@kernel
def push_of_robots(x, y, ex, ey, is_stuck, ground, robots):
    """The push of robots and of where they will soon be, and how near the nearest is. Those that stand push nobody who is stuck."""
    ax, ay, nearest = 0.0, 0.0, np.inf
    row0, row1, column0, column1 = bins_around(x, y, ground)
    for row in range(row0, row1):
        for k in range(robots.first[row * ground.columns + column0], robots.first[row * ground.columns + column1]):
            away, nx, ny = from_robot(x, y, robots.member[k], robots, ROBOT_AHEAD_S)
            if away > BIN_M:
                continue
            nearest = min(nearest, away)
            size = ROBOT_MPS2 * np.exp(-max(away - BODY_M, 0.0) / ROBOT_M)
            if -(ex * nx + ey * ny) < SIGHT:
                size *= BEHIND
            if is_stuck and abs(robots.along_mps[robots.member[k]]) < STANDS_MPS:
                size = 0.0
            ax += size * nx
            ay += size * ny
    return ax, ay, nearest


@kernel
def round_robots(p, ex, ey, is_stuck, walkers, ground, robots):
    """The direction that leads past the robots that stand or come in the way, on a side with room. Where there is none, where one has
    made no way, or where the robot stands for people before it, one lets it pass: out of its path, and then (0, 0).
    """
    x, y, tx, ty, nearest = walkers.x_m[p], walkers.y_m[p], ex, ey, ROUND_M
    row0, row1, column0, column1 = bins_around(x, y, ground)
    for row in range(row0, row1):
        for k in range(robots.first[row * ground.columns + column0], robots.first[row * ground.columns + column1]):
            i = robots.member[k]
            dx, dy = robots.x_m[i] - x, robots.y_m[i] - y
            is_met = is_before(x, y, i, robots)
            fx, fy = ex, ey
            if is_met and ex * np.cos(robots.yaw_rad[i]) + ey * np.sin(robots.yaw_rad[i]) < AGAINST:  # ways lead off walls: not its line
                fx, fy = -np.cos(robots.yaw_rad[i]), -np.sin(robots.yaw_rad[i])
            ahead, left = dx * fx + dy * fy, dy * fx - dx * fy
            beside = np.hypot(robots.half_length_m[i], robots.half_width_m[i]) + BODY_M + ROUND_ROOM_M / 2.0
            if ex == 0.0 and ey == 0.0 and robots.is_halted[i] and np.hypot(dx, dy) < YIELD_M:
                tx, ty = out_of_path(p, i, walkers, ground, robots)
            if ahead <= 0.0 or ahead >= nearest or abs(left) >= beside:
                continue
            side, has_room = -1.0 if left > -0.05 else 1.0, False  # to the right of a robot that is right ahead
            lets_pass = ahead < YIELD_M and (is_stuck or (robots.is_halted[i] and is_met))
            for _ in range(0 if lets_pass else 2):
                bx, by = dx - side * fy * beside, dy + side * fx * beside  # the point to pass
                if is_free_way(x, y, bx, by, ground):
                    size = np.hypot(bx, by)
                    tx, ty, nearest, has_room = bx / size, by / size, ahead, True
                    break
                side = -side
            if not has_room and ahead < YIELD_M:
                nearest = ahead
                tx, ty = out_of_path(p, i, walkers, ground, robots)
    return tx, ty


@kernel(inline="always")
def is_before(x, y, i, robots):
    """True if one is where a robot faces."""
    return np.cos(robots.yaw_rad[i]) * (x - robots.x_m[i]) + np.sin(robots.yaw_rad[i]) * (y - robots.y_m[i]) > 0.0


@kernel
def is_free_way(x, y, dx, dy, ground):
    """True if the cells on the way to a point are free, but for the first ones: people are pushed to walls."""
    is_free = True
    for part in range(3, 9):
        is_free &= ground.free[cell_of(x + dx * part / 8.0, y + dy * part / 8.0, ground)]
    return is_free


@kernel
def out_of_path(p, i, walkers, ground, robots):
    """The direction that leads out of a robot's path, shorter than 1 for who is nearly out of it, (0, 0) for who is beside it.

    Who is beside or behind one that stands for people goes back from it, to where it has room to turn. Where there is no room to the sides
    one goes before it; from a corner towards it, to where there is room beside its way.
    """
    x, y, cos, sin = walkers.x_m[p], walkers.y_m[p], np.cos(robots.yaw_rad[i]), np.sin(robots.yaw_rad[i])
    dx, dy = x - robots.x_m[i], y - robots.y_m[i]
    ahead, left, beside = cos * dx + sin * dy, cos * dy - sin * dx, robots.half_width_m[i] + robots.side_m + BODY_M + ASIDE_M
    if ahead <= 0.0 or abs(left) >= beside:
        away = np.hypot(dx, dy)
        turns_m = np.hypot(robots.half_length_m[i], robots.half_width_m[i]) + robots.side_m + BODY_M + ASIDE_M
        return (dx / away, dy / away) if robots.is_halted[i] and away < turns_m else (0.0, 0.0)
    ax, ay, code = x + CORNER_M * cos, y + CORNER_M * sin, ground.back[cell_of(x, y, ground)]
    if code < NUM_ANGLES:  # along a wall to which one has been pushed
        angle = code * (2.0 * np.pi / NUM_ANGLES)
        ax, ay = ax + CELL_M * np.cos(angle), ay + CELL_M * np.sin(angle)
    is_corner = not ground.free[cell_of(ax, ay, ground)]
    for part in range(1 + is_corner * PARTS):
        back, side = part * ahead / PARTS, 1.0 if left >= 0.0 else -1.0
        for _ in range(2):
            step = beside - side * left
            far = np.hypot(step, back)
            tx, ty = -side * sin * (step / far) - cos * (back / far), side * cos * (step / far) - sin * (back / far)
            if can_stand_at(p, x + tx * far, y + ty * far, walkers, ground, robots):
                share = min(far / SLOWS_M, 1.0)
                return tx * share, ty * share
            side = -side
    return cos, sin


@kernel
def can_stand_at(p, sx, sy, walkers, ground, robots):
    """True if one can go to a point (sx, sy) and stand there: no wall is too near, no robot, and there nobody else."""
    x, y = walkers.x_m[p], walkers.y_m[p]
    if leads_through_wall(x, y, sx, sy, ground):
        return False
    for part in range(1, 5):
        mx, my = x + (sx - x) * part / 4.0, y + (sy - y) * part / 4.0
        away, _, _ = nearest_wall(mx, my, ground, cell_of(mx, my, ground))
        if away < AT_WALL_M - 1e-6 or robot_away_m(mx, my, ground, robots) <= BODY_M:
            return False
    row0, row1, column0, column1 = bins_around(sx, sy, ground)
    for row in range(row0, row1):
        for k in range(walkers.first[row * ground.columns + column0], walkers.first[row * ground.columns + column1]):
            q = walkers.member[k]
            if q != p and np.hypot(walkers.x_m[q] - sx, walkers.y_m[q] - sy) < TOUCH_M:
                return False
    return True


@kernel
def move(h, p, walkers, ground, robots):
    """A step: no faster than a person walks, not into robots, not through walls."""
    x, y = walkers.x_m[p], walkers.y_m[p]
    vx, vy = walkers.vx_mps[p] + h * walkers.ax_mps2[p], walkers.vy_mps[p] + h * walkers.ay_mps2[p]
    speed, most = np.hypot(vx, vy), FASTEST * walkers.wish_mps[p]
    if speed > most:
        vx, vy = vx * most / speed, vy * most / speed
    nx, ny = x + h * vx, y + h * vy
    row0, row1, column0, column1 = bins_around(x, y, ground)
    for row in range(row0, row1):
        for k in range(robots.first[row * ground.columns + column0], robots.first[row * ground.columns + column1]):
            away, ox, oy = from_robot(nx, ny, robots.member[k], robots, 0.0)
            short = BODY_M + CLEAR_M - away
            if short > 0.0:
                nx, ny = nx + short * ox, ny + short * oy
    away, ox, oy = nearest_wall(nx, ny, ground, cell_of(nx, ny, ground))
    if away < AT_WALL_M:
        nx, ny = nx + (AT_WALL_M - away) * ox, ny + (AT_WALL_M - away) * oy
    if leads_through_wall(x, y, nx, ny, ground):
        nx, ny = x, y
    walkers.vx_mps[p], walkers.vy_mps[p] = (nx - x) / h, (ny - y) / h
    speed = np.hypot(nx - x, ny - y) / h
    if speed > most:  # it was pushed
        walkers.vx_mps[p], walkers.vy_mps[p] = (nx - x) / h * most / speed, (ny - y) / h * most / speed
    walkers.x_m[p], walkers.y_m[p] = nx, ny


@kernel
def leads_through_wall(x, y, nx, ny, ground):
    """True if a step crosses a wall."""
    cell = cell_of(x, y, ground)
    for k in range(ground.first[cell], ground.first[cell + 1]):
        w = ground.near[k]
        x0, y0, x1, y1 = ground.walls[w, 0], ground.walls[w, 1], ground.walls[w, 2], ground.walls[w, 3]
        a, b = (x1 - x0) * (y - y0) - (y1 - y0) * (x - x0), (x1 - x0) * (ny - y0) - (y1 - y0) * (nx - x0)
        c, d = (nx - x) * (y0 - y) - (ny - y) * (x0 - x), (nx - x) * (y1 - y) - (ny - y) * (x1 - x)
        if a * b <= 0.0 and c * d <= 0.0 and (a != 0.0 or b != 0.0):
            return True
    return False


@kernel
def look_back(now, dt, p, walkers, ground, robots):
    """Count how long a person has stood, and before a robot; who has stood for long goes back a little.

    Beside a robot, where people may walk to and fro, what they have stood is forgotten slowly.
    """
    walks = np.hypot(walkers.vx_mps[p], walkers.vy_mps[p]) >= SLOW * walkers.wish_mps[p]
    if walks and walkers.stuck_s[p] == 0.0:
        return
    nearest = robot_away_m(walkers.x_m[p], walkers.y_m[p], ground, robots)
    if walks:
        walkers.stuck_s[p] = max(walkers.stuck_s[p] - (dt if nearest > BEFORE_ROBOT_M else FORGETS * dt), 0.0)
        return
    if nearest <= BEFORE_ROBOT_M:
        walkers.waited_s[p] += dt
    walkers.stuck_s[p] = 0.0 if now < walkers.away_until_s[p] else walkers.stuck_s[p] + dt
    if walkers.stuck_s[p] >= PATIENCE_S:
        walkers.stuck_s[p] = 0.0
        walkers.away_until_s[p] = now + AWAY_S
