"""What the array touches: walls of the scala, lips, recess, bone face, and itself; each contact with its friction.

Contacts are one-sided springs against the array's surface (08 section 3). A node's foot on the lateral wall is
followed by its arc length from where it came in, so that it never jumps to the next turn, which passes inside the
first. Normal forces lag one step in the friction, which keeps every step a minimisation.
"""

import math

from hal.kernel import kernel
from sim_backends.plant.rod.friction import REST_MM_PER_S, coefficient, curb, grip, reach
from sim_backends.plant.rod.state import POSTS
from sim_backends.plant.scala import wall_at

FOOT_PACE_MM = 0.25
"""A foot moves at most so far at a time, many times as fast as an array is ever moved."""
LEAST_OPEN = 0.2
"""1 - curvature * gap, by which a foot runs ahead of its node: not less, for at the kink of the wall it would not be."""
FOOT_NEAR_MM = 5e-3
"""Less than this along the wall is left to a series of second order: what it leaves out is below 1e-8 mm."""
FOOT_STEPS = 6
FIND_STEPS = 8
ASIDE_MM = 0.5
"""A post further from the array than this does not touch it, in whatever way the array moves in one step."""
LOOK_MM = 0.02
"""A node that has moved so far looks at the walls again, however far they were."""
LEAST_MM = 1e-9
ROUND_MM = 0.05
"""Nearer to a post's middle its push turns so fast with the place that the Hessian leaves it at that."""
RECESS = 2
"""Posts from this one on are not lips: they have the array between them from the start."""
RIM_MM = 0.3
"""The face takes over from a lip over this length, so that no node drops off an edge."""
OVER_MM = 0.1
"""A tip that comes in over a lip, into which it is pressed, may still lie so far beside the hole."""
FREE_MM = 1.0
"""So near to the gripper the recess would meet the gripper first; from twice as far on it bears in full."""
NEAR_MM = 0.2
"""A folded tip comes no further towards the shaft in one step."""
SELF_WINDOW = 6
"""A folded tip is compared with so many edges to either side of where it should lie along the shaft."""


@kernel
def touch(rod, scala, step_s, secant):
    """Add everything the array touches to energy, gradient and band; forces and normal forces of nodes are noted.

    secant: friction with its secant as stiffness, or with its tangent.
    """
    n = rod.segments
    rod.force_n[: n + 1] = 0.0
    rod.press_n[: n + 1] = 0.0
    rod.modiolar_n = rod.lateral_n = rod.face_n = rod.self_n = 0.0
    ex, ey, ax, ay = scala.entry_mm[0], scala.entry_mm[1], scala.axis[0], scala.axis[1]
    stiffness = scala.stiffness_n_per_mm2 * rod.edge_mm
    rim = scala.hole_radius_mm + scala.lip_radius_mm
    for i in range(2, min(rod.inside_from, n + 1)):
        cx, cy = _centre(rod, i)
        sunk = (cx - ex) * ax + (cy - ey) * ay + rod.radius_mm[i]
        if sunk > 0.0:
            _face(rod, i, ax, ay, (cy - ey) * ax - (cx - ex) * ay, rim, stiffness, sunk)
    for i in range(rod.inside_from, n + 1):
        share = 1.0
        if i <= rod.inside_from + 1:  # nodes come in smoothly
            depth = (rod.before_mm[i, 0] - ex) * ax + (rod.before_mm[i, 1] - ey) * ay
            share = min(max(depth / rod.edge_mm, 0.0), 1.0)
        dx, dy = rod.node_mm[i, 0] - rod.before_mm[i, 0], rod.node_mm[i, 1] - rod.before_mm[i, 1]
        if abs(dx) + abs(dy) >= rod.clear_mm[i]:
            _walls(rod, scala, i, share * stiffness)
        _floor(rod, scala, i, dx, dy, share * rod.edge_mm, step_s, secant)
    for i in range(2, n + 1):
        if rod.grip_n[i] > 0.0:
            _rub(rod, i, step_s, secant)
    for post in range(POSTS):
        _post(rod, scala, post)
        if rod.post_grip_n[post] > 0.0:
            _rub_post(rod, post, step_s, secant)
    if rod.folded:
        _itself(rod, stiffness)


@kernel
def _face(rod, i, ax, ay, aside, rim, stiffness, sunk):
    """The bone beside the entry on node i, which is `sunk` in it; it begins softly where the lips end."""
    beyond = abs(aside) - rim
    if beyond <= 0.0:
        return
    row, u = 2 * (rod.segments - i), min(beyond / RIM_MM, 1.0)
    share = u * u * (3.0 - 2.0 * u)
    _push(rod, i, -ax, -ay, share * stiffness, sunk)
    rod.face_n += share * stiffness * sunk
    if u < 1.0:
        slope = 6.0 * u * (1.0 - u) / RIM_MM * stiffness * sunk
        inwards = math.copysign(0.5 * slope * sunk, -aside)
        _pull(rod, i, row, -ay * inwards, ax * inwards)
        _stiffen(rod, row, -ay, ax, (3.0 - 6.0 * u) / (RIM_MM * RIM_MM) * stiffness * sunk * sunk)
        cross = math.copysign(slope, aside)
        rod.band[row, 0] -= 2.0 * cross * ax * ay
        rod.band[row, 1] += cross * (ax * ax - ay * ay)
        rod.band[row + 1, 0] += 2.0 * cross * ax * ay
    rod.touch_tangent[i, 0], rod.touch_tangent[i, 1] = -ay, ax


@kernel
def _centre(rod, i):
    """Middle of the array's body beside node i."""
    r = rod.radius_mm[i]
    return rod.node_mm[i, 0] - r * rod.normal[i, 0], rod.node_mm[i, 1] - r * rod.normal[i, 1]


@kernel
def _walls(rod, scala, i, stiffness):
    """Both walls on node i, which is inside."""
    cx, cy = _centre(rod, i)
    r, foot = rod.radius_mm[i], rod.foot_before_mm[i]
    for _ in range(FOOT_STEPS):
        wx, wy, tx, ty, curvature, width, slope = wall_at(scala, foot)
        gap = (cy - wy) * tx - (cx - wx) * ty
        along = (cx - wx) * tx + (cy - wy) * ty
        open_share = max(1.0 - curvature * gap, LEAST_OPEN)
        ahead = min(max(along / open_share, -FOOT_PACE_MM), FOOT_PACE_MM)
        foot += ahead
        if abs(ahead) < FOOT_NEAR_MM:
            break
    rod.foot_mm[i] = foot
    # what little is left of the way to the foot, to second order
    turn = curvature * ahead
    gap -= 0.5 * turn * along
    width += slope * ahead
    tx, ty = tx - turn * ty, ty + turn * tx
    room = width - gap
    rod.modiolar_gap_mm[i] = room - r
    rod.free_mm[i] = min(gap, room) - r
    if rod.free_mm[i] >= 0.0:
        return
    per_open = 1.0 / max(1.0 - curvature * gap, LEAST_OPEN)
    bend = curvature * per_open
    row = 2 * (rod.segments - i)
    if gap < r:
        _push(rod, i, -ty, tx, stiffness, r - gap)
        _stiffen(rod, row, tx, ty, stiffness * (r - gap) * bend)
        rod.lateral_n += stiffness * (r - gap)
    if room < r:
        # the width changes along the wall: the slope of the distance is not quite the normal
        tilt = slope * per_open
        _push(rod, i, ty + tilt * tx, -tx + tilt * ty, stiffness, r - room)
        _stiffen(rod, row, tx, ty, -stiffness * (r - room) * bend)
        rod.modiolar_n += stiffness * (r - room)
    rod.touch_tangent[i, 0], rod.touch_tangent[i, 1] = tx, ty


@kernel
def _floor(rod, scala, i, dx, dy, length_mm, step_s, secant):
    """Friction of floor and lid on node i, which is inside with this length of the array and has moved by (dx, dy)."""
    load = length_mm * scala.floor_load_n_per_mm
    if i == rod.inside_from:
        load += abs(rod.lift_n)
    slip = dx * dx + dy * dy
    hold = length_mm * scala.viscous_n_s_per_mm2 / step_s
    rod.energy_nmm += 0.5 * hold * slip
    stiff = hold
    if load > 0.0:
        rest = step_s * REST_MM_PER_S
        far = math.sqrt(slip + rest * rest)
        drag = rod.floor_friction * load / far
        hold += drag
        stiff += drag if secant else drag * curb(far, step_s)
        rod.energy_nmm += drag * far * far
    row = 2 * (rod.segments - i)
    rod.band[row, 0] += stiff
    rod.band[row + 1, 0] += stiff
    _pull(rod, i, row, -hold * dx, -hold * dy)


@kernel
def _rub(rod, i, step_s, secant):
    """Friction of node i, along the tangent of what it touched in the step before."""
    tx, ty = rod.tangent[i, 0], rod.tangent[i, 1]
    slip = (rod.node_mm[i, 0] - rod.before_mm[i, 0]) * tx + (rod.node_mm[i, 1] - rod.before_mm[i, 1]) * ty
    far = reach(slip, step_s)
    hold = rod.grip_n[i] / far
    rod.energy_nmm += rod.grip_n[i] * far
    row = 2 * (rod.segments - i)
    _stiffen(rod, row, tx, ty, hold if secant else hold * curb(far, step_s))
    _pull(rod, i, row, -hold * slip * tx, -hold * slip * ty)


@kernel
def _push(rod, i, nx, ny, stiffness, sunk_mm):
    """A surface pushes node i back along n from `sunk_mm` inside."""
    row = 2 * (rod.segments - i)
    _stiffen(rod, row, nx, ny, stiffness)
    _pull(rod, i, row, stiffness * sunk_mm * nx, stiffness * sunk_mm * ny)
    rod.press_n[i] += stiffness * sunk_mm
    rod.energy_nmm += 0.5 * stiffness * sunk_mm * sunk_mm


@kernel
def _pull(rod, i, row, fx, fy):
    """A force on node i."""
    rod.gradient[row] -= fx
    rod.gradient[row + 1] -= fy
    rod.force_n[i, 0] += fx
    rod.force_n[i, 1] += fy


@kernel
def _stiffen(rod, row, nx, ny, stiffness):
    """A spring along n at the node of `row`."""
    rod.band[row, 0] += stiffness * nx * nx
    rod.band[row, 1] += stiffness * nx * ny
    rod.band[row + 1, 0] += stiffness * ny * ny


@kernel
def _toward(rod, edge, px, py):
    """How a point lies beside an edge: its share along it, clamped; unit vector to it and distance; left (1) or right (-1).

    At an end of the edge the vector points from that end.
    """
    ax, ay = _centre(rod, edge)
    bx, by = _centre(rod, edge + 1)
    ux, uy, dx, dy = bx - ax, by - ay, px - ax, py - ay
    square = ux * ux + uy * uy
    along, across = dx * ux + dy * uy, ux * dy - uy * dx
    side = 1.0 if across >= 0.0 else -1.0
    if 0.0 < along < square:
        inverse = 1.0 / math.sqrt(square)
        return along * inverse * inverse, -side * uy * inverse, side * ux * inverse, abs(across) * inverse, side
    t = 0.0
    if along > 0.0:
        t, dx, dy = 1.0, px - bx, py - by
    distance = max(math.sqrt(dx * dx + dy * dy), LEAST_MM)
    return t, dx / distance, dy / distance, distance, side


@kernel
def _foremost(rod, edge, px, py):
    """From `edge` on along the line to an edge that has the point beside it, or the first of two that have it between."""
    up = False
    while True:
        t, _, _, _, _ = _toward(rod, edge, px, py)
        if t <= 0.0 and edge > 1:
            if up:
                return edge - 1
            edge -= 1
            t, _, _, _, _ = _toward(rod, edge, px, py)
            if t >= 1.0:
                return edge
        elif t >= 1.0 and edge < rod.segments - 1:
            edge += 1
            up = True
        else:
            return edge


@kernel
def _post(rod, scala, post):
    """One lip of the entry or side of the recess against the edges it is in.

    The distance to a line of edges has a kink where two of them are equally near. So every edge that has the post
    beside it presses, and so does a corner that has it in front, while a corner between two such edges, which both of
    them count, presses back once. That is one spring along a straight line, and has no kinks.
    """
    rod.post_press_n[post] = 0.0
    if not rod.post_met[post]:
        return
    px, py, reach = scala.post_mm[post, 0], scala.post_mm[post, 1], rod.post_reach_mm[post]
    edge = rod.post_edge[post]
    dx, dy = px - rod.node_mm[edge, 0], py - rod.node_mm[edge, 1]
    far = reach + 2.0 * rod.edge_mm + ASIDE_MM
    if dx * dx + dy * dy > far * far:
        return
    edge = _foremost(rod, edge, px, py)
    _, _, _, distance, left = _toward(rod, edge, px, py)
    stiffness = rod.post_share[post] * scala.stiffness_n_per_mm2 * reach
    if rod.post_side[post] * left < 0.0:
        _press_through(rod, post, edge, px, py, stiffness)
    elif distance < reach + rod.edge_mm:
        _press_chain(rod, post, edge, px, py, stiffness)


@kernel
def _press_chain(rod, post, edge, px, py, stiffness):
    """A post beside `edge` pushes away everything it is in."""
    reach = rod.post_reach_mm[post]
    first, last = edge, edge
    distance = 0.0
    while first > 1 and (distance < reach or first == edge):
        first -= 1
        _, _, _, distance, _ = _toward(rod, first, px, py)
    distance = 0.0
    while last < rod.segments - 1 and (distance < reach or last == edge):
        last += 1
        _, _, _, distance, _ = _toward(rod, last, px, py)
    at_end = True  # nothing comes before the first edge
    for e in range(first, last + 1):
        t, nx, ny, distance, _ = _toward(rod, e, px, py)
        if (e == 1 and t <= 0.0) or (e > first and at_end == (t <= 0.0)):
            cx, cy = _centre(rod, e)
            dx, dy = px - cx, py - cy
            d = max(math.sqrt(dx * dx + dy * dy), LEAST_MM)
            _press_corner(rod, post, e, dx / d, dy / d, d, 1.0 if t <= 0.0 else -1.0, stiffness)
        at_end = t >= 1.0
        if 0.0 < t < 1.0:
            _press_edge(rod, post, e, t, nx, ny, distance, stiffness)
        elif at_end and e == rod.segments - 1:
            _press_corner(rod, post, e + 1, nx, ny, distance, 1.0, stiffness)


@kernel
def _press_through(rod, post, edge, px, py, stiffness):
    """The line has been pressed past the post's middle: what is nearest is pushed back the way it came."""
    nearest, least = edge, math.inf
    for e in range(max(edge - 1, 1), min(edge + 2, rod.segments)):
        _, _, _, distance, _ = _toward(rod, e, px, py)
        if distance < least:
            nearest, least = e, distance
    t, nx, ny, distance, _ = _toward(rod, nearest, px, py)
    if 0.0 < t < 1.0:
        _press_edge(rod, post, nearest, t, -nx, -ny, -distance, stiffness)
    else:
        _press_corner(rod, post, nearest + (1 if t >= 1.0 else 0), -nx, -ny, -distance, 1.0, stiffness)


@kernel
def _press_corner(rod, post, i, nx, ny, distance, weight, stiffness):
    """A post at a signed distance along n from the body beside node i pushes it away, or with weight -1 takes that back."""
    sunk = rod.post_reach_mm[post] - distance
    if sunk <= 0.0:
        return
    k, row = weight * stiffness, 2 * (rod.segments - i)
    rod.post_press_n[post] += k * sunk
    rod.energy_nmm += 0.5 * k * sunk * sunk
    _stiffen(rod, row, nx, ny, k)
    _stiffen(
        rod, row, -ny, nx, -k * sunk / (distance if abs(distance) > ROUND_MM else math.copysign(ROUND_MM, distance))
    )
    _pull(rod, i, row, -k * sunk * nx, -k * sunk * ny)


@kernel
def _press_edge(rod, post, edge, t, nx, ny, distance, stiffness):
    """A post at a signed distance along n from share t of an edge pushes it away; all of its Hessian.

    distance = n (post - near node): its second derivatives are those of n, which turns with the edge, and of t.
    """
    sunk = rod.post_reach_mm[post] - distance
    if sunk <= 0.0:
        return
    force, u = stiffness * sunk, 1.0 - t
    rod.post_press_n[post] += force
    rod.energy_nmm += 0.5 * force * sunk
    ex, ey = rod.node_mm[edge + 1, 0] - rod.node_mm[edge, 0], rod.node_mm[edge + 1, 1] - rod.node_mm[edge, 1]
    ex -= rod.radius_mm[edge + 1] * rod.normal[edge + 1, 0] - rod.radius_mm[edge] * rod.normal[edge, 0]
    ey -= rod.radius_mm[edge + 1] * rod.normal[edge + 1, 1] - rod.radius_mm[edge] * rod.normal[edge, 1]
    square = ex * ex + ey * ey
    ex, ey, lever = ex / square, ey / square, force / square * distance
    near, far, band = 2 * (rod.segments - edge), 2 * (rod.segments - edge - 1), rod.band
    # k c c^T - f (a b^T + b a^T) + f d b b^T with c = (u n, t n), a = (u e, t e) / |e|^2, b = (-n, n), d = distance / |e|^2
    xx, xy, yy = nx * nx, nx * ny, ny * ny
    exx, exy, eyx, eyy = ex * nx, ex * ny, ey * nx, ey * ny
    k = u * u * stiffness + lever
    f = -force * u
    band[near, 0] += k * xx - 2.0 * f * exx
    band[near, 1] += k * xy - f * (exy + eyx)
    band[near + 1, 0] += k * yy - 2.0 * f * eyy
    k = t * t * stiffness + lever
    g = force * t
    band[far, 0] += k * xx - 2.0 * g * exx
    band[far, 1] += k * xy - g * (exy + eyx)
    band[far + 1, 0] += k * yy - 2.0 * g * eyy
    # far row, near column: a_far b_near^T + b_far a_near^T = -t e n^T + u n e^T
    k = t * u * stiffness - lever
    p, q = force * t, force * u
    band[far, 2] += k * xx + p * exx - q * exx
    band[far, 3] += k * xy + p * exy - q * eyx
    band[far + 1, 1] += k * xy + p * eyx - q * exy
    band[far + 1, 2] += k * yy + p * eyy - q * eyy
    _pull(rod, edge, near, -u * force * nx, -u * force * ny)
    _pull(rod, edge + 1, far, -t * force * nx, -t * force * ny)


@kernel
def _rub_post(rod, post, step_s, secant):
    """Friction at a post, where it touched the array in the step before."""
    edge, t, tx, ty = int(rod.post_rub[post, 0]), rod.post_rub[post, 1], rod.post_rub[post, 2], rod.post_rub[post, 3]
    slip = _slip(rod, edge, t, tx, ty)
    far = reach(slip, step_s)
    hold = rod.post_grip_n[post] / far
    rod.energy_nmm += rod.post_grip_n[post] * far
    _share(rod, edge, t, tx, ty, hold if secant else hold * curb(far, step_s), -hold * slip)


@kernel
def _slip(rod, edge, t, tx, ty):
    """How far a point of an edge has moved along a tangent in this step."""
    u = 1.0 - t
    x, before = rod.node_mm, rod.before_mm
    sx = u * (x[edge, 0] - before[edge, 0]) + t * (x[edge + 1, 0] - before[edge + 1, 0])
    sy = u * (x[edge, 1] - before[edge, 1]) + t * (x[edge + 1, 1] - before[edge + 1, 1])
    return sx * tx + sy * ty


@kernel
def keep_clear(rod):
    """After a step: how far the nodes inside can move before they may touch a wall. A width does not change faster."""
    for i in range(rod.inside_from, rod.segments + 1):
        moved = abs(rod.node_mm[i, 0] - rod.before_mm[i, 0]) + abs(rod.node_mm[i, 1] - rod.before_mm[i, 1])
        if rod.free_mm[i] >= 0.0:  # it has looked
            rod.clear_mm[i] = 0.5 * min(rod.free_mm[i], LOOK_MM)
        else:
            rod.clear_mm[i] -= moved
        rod.free_mm[i] = -1.0


@kernel
def keep_grip(rod, scala, step_s):
    """After a step: where every contact rubs in the next one, and the friction it may take."""
    for i in range(2, rod.segments + 1):
        rod.grip_n[i] = 0.0
        if rod.press_n[i] > 0.0:
            tx, ty = rod.touch_tangent[i, 0], rod.touch_tangent[i, 1]
            slip = (rod.node_mm[i, 0] - rod.before_mm[i, 0]) * tx + (rod.node_mm[i, 1] - rod.before_mm[i, 1]) * ty
            rod.grip_n[i] = grip(scala, rod.press_n[i], slip, step_s)
            rod.tangent[i, 0], rod.tangent[i, 1] = tx, ty
    for post in range(POSTS):
        rod.post_grip_n[post] = 0.0
        if rod.post_press_n[post] <= 0.0:
            rod.post_side[post] = 0
        else:
            edge = _foremost(rod, rod.post_edge[post], scala.post_mm[post, 0], scala.post_mm[post, 1])
            t, nx, ny, _, _ = _toward(rod, edge, scala.post_mm[post, 0], scala.post_mm[post, 1])
            rub = rod.post_rub[post]
            rub[0], rub[1], rub[2], rub[3] = edge, t, -ny, nx
            slip = _slip(rod, edge, t, -ny, nx)
            rod.post_grip_n[post] = grip(scala, rod.post_press_n[post], slip, step_s)


@kernel
def _share(rod, edge, t, nx, ny, stiffness, force_n):
    """A spring along n with a force now, at share t of an edge: both of its nodes bear it."""
    u = 1.0 - t
    near, far = 2 * (rod.segments - edge), 2 * (rod.segments - edge - 1)
    _stiffen(rod, near, nx, ny, u * u * stiffness)
    _stiffen(rod, far, nx, ny, t * t * stiffness)
    cross = t * u * stiffness
    rod.band[far, 2] += cross * nx * nx
    rod.band[far, 3] += cross * nx * ny
    rod.band[far + 1, 1] += cross * ny * nx
    rod.band[far + 1, 2] += cross * ny * ny
    _pull(rod, edge, near, u * force_n * nx, u * force_n * ny)
    _pull(rod, edge + 1, far, t * force_n * nx, t * force_n * ny)


@kernel
def _itself(rod, stiffness):
    """A folded tip lies against the shaft: either side presses against where the other one was before the step.

    The two are far apart in the band, which could not hold what one does to the other. In equilibrium it is the same.
    """
    n = rod.segments
    for i in range(rod.self_from, n + 1):
        edge = rod.self_edge[i]
        if edge == 0:
            continue
        t, nx, ny, width = rod.self_at[i, 0], rod.self_at[i, 1], rod.self_at[i, 2], rod.self_at[i, 3]
        row = 2 * (n - i)
        moved = (rod.node_mm[i, 0] - rod.before_mm[i, 0]) * nx + (rod.node_mm[i, 1] - rod.before_mm[i, 1]) * ny
        sunk = width - moved
        if sunk > 0.0:
            rod.self_n += stiffness * sunk
            rod.energy_nmm += 0.5 * stiffness * sunk * sunk
            _stiffen(rod, row, nx, ny, stiffness)
            _pull(rod, i, row, stiffness * sunk * nx, stiffness * sunk * ny)
        sunk = width + _slip(rod, edge, t, nx, ny)
        if sunk > 0.0:
            rod.energy_nmm += 0.5 * stiffness * sunk * sunk
            _share(rod, edge, t, nx, ny, stiffness, -stiffness * sunk)


@kernel
def _face_itself(rod):
    """Before a step: which edge of the shaft each node of a folded tip lies against, and how deep it is in it."""
    n = rod.segments
    apex, sharpest = n, 0.0
    for i in range(max(rod.inside_from, 2), n):
        if abs(rod.turn_rad[i]) > sharpest:
            apex, sharpest = i, abs(rod.turn_rad[i])
    rod.self_from = apex + 3
    for i in range(apex + 3, n + 1):
        cx, cy = _centre(rod, i)
        least = 2.0 * rod.radius_mm[i] + NEAR_MM
        rod.self_edge[i] = 0
        for edge in range(max(2 * apex - i - SELF_WINDOW, 2), min(2 * apex - i + SELF_WINDOW, apex - 3)):
            t, nx, ny, distance, _ = _toward(rod, edge, cx, cy)
            if distance < least:
                least, rod.self_edge[i] = distance, edge
                rod.self_at[i, 0], rod.self_at[i, 1], rod.self_at[i, 2] = t, nx, ny
                rod.self_at[i, 3] = 2.0 * rod.radius_mm[i] - distance


@kernel
def enter(rod, scala, period_s):
    """Before a step: which nodes are beyond the entry, and the foot of each that has come in; posts near the gripper."""
    for post in range(POSTS):
        _follow(rod, scala, post)
    if rod.folded:
        _face_itself(rod)
    pace = math.sqrt(rod.pace_mm[1, 0] ** 2 + rod.pace_mm[1, 1] ** 2)
    rod.floor_friction = coefficient(scala, pace / period_s)
    n = rod.segments
    ex, ey, ax, ay = scala.entry_mm[0], scala.entry_mm[1], scala.axis[0], scala.axis[1]
    reach = scala.hole_radius_mm + scala.lip_radius_mm + OVER_MM
    while rod.inside_from <= n:
        i = rod.inside_from
        if (rod.node_mm[i, 0] - ex) * ax + (rod.node_mm[i, 1] - ey) * ay >= 0.0:
            break
        rod.grip_n[i] = 0.0
        rod.inside_from += 1
    while rod.inside_from > 2:
        i = rod.inside_from - 1
        depth = (rod.node_mm[i, 0] - ex) * ax + (rod.node_mm[i, 1] - ey) * ay
        cx, cy = _centre(rod, i)
        if depth < 0.0 or abs((cy - ey) * ax - (cx - ex) * ay) > reach:
            break
        rod.inside_from = i
        rod.grip_n[i] = rod.clear_mm[i] = 0.0
        rod.free_mm[i] = -1.0
        rod.foot_mm[i] = scala.entry_arc_mm if i == n else rod.foot_mm[i + 1] - rod.edge_mm
        _find_foot(rod, scala, i)
    _remember_feet(rod)


@kernel
def _remember_feet(rod):
    """Each try at a step follows the feet from where they were, so that its energy is a function of the nodes alone."""
    for i in range(rod.inside_from, rod.segments + 1):
        rod.foot_before_mm[i] = rod.foot_mm[i]


@kernel
def _follow(rod, scala, post):
    """Before a step: the edge a post is beside, on which side, and how far and how hard it presses all through the step."""
    px, py = scala.post_mm[post, 0], scala.post_mm[post, 1]
    edge = rod.post_edge[post] = _foremost(rod, rod.post_edge[post], px, py)
    rod.post_reach_mm[post] = scala.post_radius_mm[post] + rod.radius_mm[edge]
    place = (edge + 0.5) * rod.edge_mm
    rod.post_share[post] = min(max((place - FREE_MM) / FREE_MM, 0.0), 1.0) if post >= RECESS else 1.0
    t, _, _, distance, left = _toward(rod, edge, px, py)
    side = 1 if left > 0.0 else -1
    ahead = edge == rod.segments - 1 and t >= 1.0
    if distance >= rod.post_reach_mm[post] and (post < RECESS or side == 1 - 2 * (post % 2)):
        rod.post_met[post] = 1  # until the array lies between the sides of the recess it is threaded through by hand
    if ahead or not rod.post_met[post]:
        rod.post_side[post] = 0  # it can still pass the tip on either side
    elif rod.post_side[post] == 0:
        rod.post_side[post] = side


@kernel
def _find_foot(rod, scala, i):
    """Newton's method for the foot of a node that has just come in."""
    cx, cy = _centre(rod, i)
    for _ in range(FIND_STEPS):
        wx, wy, tx, ty, curvature, _, _ = wall_at(scala, rod.foot_mm[i])
        gap = (cy - wy) * tx - (cx - wx) * ty
        rod.foot_mm[i] += ((cx - wx) * tx + (cy - wy) * ty) / max(1.0 - curvature * gap, LEAST_OPEN)
