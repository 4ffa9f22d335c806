"""What the array touches: walls of the scala, lips, recess, bone face, and itself; each contact with its friction.

Contacts are one-sided springs against the array's surface (08 section 3). A node's foot on the lateral wall is
followed by its arc length from where it came in, so that it never jumps to the next turn, which passes inside the
first. Normal forces lag one step in the friction, which keeps every step a minimisation.
"""

import math

from hal.kernel import kernel
from sim_backends.plant.rod.friction import curb, grip, reach
from sim_backends.plant.rod.state import POSTS
from sim_backends.plant.scala import wall_at

FOOT_PACE_MM = 0.25
"""A foot moves at most so far at a time, many times as fast as an array is ever moved."""
FOOT_UNIQUE = 0.8
"""Nearer to the wall's centre of curvature than this share of its radius a node keeps the foot it has."""
FIND_STEPS = 8
SLACK_MM = 0.3
"""A node that passes the plane of the entry this far outside the lips has still come through the hole."""
RECESS = 2
"""Posts from this one on are not lips: they have the array between them from the start."""
RIM_MM = 0.3
"""The face takes over from a lip over this length, so that no node drops off an edge."""
FREE_MM = 1.0
"""So near to the gripper the recess would meet the gripper first; from twice as far on it bears in full."""
SELF_WINDOW = 6
"""A folded tip is compared with so many edges to either side of where it should lie along the shaft."""


@kernel
def touch(rod, scala, step_s, secant):
    """Add everything the array touches to energy, gradient and band; forces and normal forces of nodes are noted.

    secant: friction with its secant as stiffness, or with its tangent.
    """
    n = rod.segments
    for i in range(n + 1):
        rod.force_n[i, 0] = rod.force_n[i, 1] = 0.0
        rod.press_n[i] = 0.0
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
        _walls(rod, scala, i, share * stiffness, share, step_s, secant)
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
    share = min(beyond / RIM_MM, 1.0)
    _push(rod, i, -ax, -ay, share * stiffness, sunk)
    rod.face_n += share * stiffness * sunk
    if share < 1.0:
        inwards = math.copysign(0.5 * stiffness * sunk * sunk / RIM_MM, -aside)
        _pull(rod, i, 2 * (rod.segments - i), -ay * inwards, ax * inwards)
    rod.touch_tangent[i, 0], rod.touch_tangent[i, 1] = -ay, ax


@kernel
def _centre(rod, i):
    """Middle of the array's body beside node i."""
    r = rod.radius_mm[i]
    return rod.node_mm[i, 0] - r * rod.normal[i, 0], rod.node_mm[i, 1] - r * rod.normal[i, 1]


@kernel
def _walls(rod, scala, i, stiffness, share, step_s, secant):
    """Both walls, floor and lid on node i, which is inside."""
    cx, cy = _centre(rod, i)
    r, foot = rod.radius_mm[i], rod.foot_mm[i]
    wx, wy, tx, ty, curvature, width, slope = wall_at(scala, foot)
    gap = (cy - wy) * tx - (cx - wx) * ty
    if curvature * gap < FOOT_UNIQUE:
        along = ((cx - wx) * tx + (cy - wy) * ty) / (1.0 - curvature * gap)
        rod.foot_mm[i] = foot + min(max(along, -FOOT_PACE_MM), FOOT_PACE_MM)
    if gap < r:
        _push(rod, i, -ty, tx, stiffness, r - gap)
        rod.lateral_n += stiffness * (r - gap)
    room = width - gap
    rod.modiolar_gap_mm[i] = room - r
    if room < r:
        # the width changes along the wall: the slope of the distance is not quite the normal
        tilt = slope / max(1.0 - curvature * gap, 1.0 - FOOT_UNIQUE)
        _push(rod, i, ty + tilt * tx, -tx + tilt * ty, stiffness, r - room)
        rod.modiolar_n += stiffness * (r - room)
    rod.touch_tangent[i, 0], rod.touch_tangent[i, 1] = tx, ty
    load = share * rod.edge_mm * scala.floor_load_n_per_mm
    if i == rod.inside_from:
        load += abs(rod.lift_n)
    dx, dy = rod.node_mm[i, 0] - rod.before_mm[i, 0], rod.node_mm[i, 1] - rod.before_mm[i, 1]
    slip = math.sqrt(dx * dx + dy * dy)
    hold = share * rod.edge_mm * scala.viscous_n_s_per_mm2 / step_s
    rod.energy_nmm += 0.5 * hold * slip * slip
    stiff = hold
    if load > 0.0:
        far = reach(slip, step_s)
        hold += scala.friction * load / far
        stiff += scala.friction * load / far * (1.0 if secant else curb(far, step_s))
        rod.energy_nmm += scala.friction * load * far
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
def _nearest(rod, edge, px, py):
    """Where edge `edge` passes a point: share of the edge, vector from the point to it."""
    ax, ay = _centre(rod, edge)
    bx, by = _centre(rod, edge + 1)
    ux, uy = bx - ax, by - ay
    t = ((px - ax) * ux + (py - ay) * uy) / (ux * ux + uy * uy)
    t = min(max(t, 0.0), 1.0)
    return t, ax + t * ux - px, ay + t * uy - py


@kernel
def _post(rod, scala, post):
    """One lip of the entry or side of the recess against the edge that is nearest to it, and those beside."""
    px, py = scala.post_mm[post, 0], scala.post_mm[post, 1]
    edge = rod.post_edge[post]
    t, dx, dy = _nearest(rod, edge, px, py)
    square = dx * dx + dy * dy
    for way in (-1, 1):  # walk downhill to the nearest edge
        while 1 <= edge + way <= rod.segments - 1:
            t2, dx2, dy2 = _nearest(rod, edge + way, px, py)
            if dx2 * dx2 + dy2 * dy2 >= square:
                break
            edge, t, dx, dy, square = edge + way, t2, dx2, dy2, dx2 * dx2 + dy2 * dy2
    rod.post_edge[post] = edge
    rod.post_press_n[post] = 0.0
    distance = math.sqrt(square)
    if distance >= rod.post_reach_mm[post]:
        if dx * scala.post_normal[post, 0] + dy * scala.post_normal[post, 1] > 0.0:
            rod.post_met[post] = 1
        return
    if not rod.post_met[post] or distance == 0.0:
        return  # until the array lies between the posts it is being threaded through by hand
    touch = rod.post_touch[post]
    touch[0], touch[1], touch[2], touch[3] = edge, t, -dy / distance, dx / distance
    _press_post(rod, scala, post, edge)
    for way in (-1, 1):
        e = edge + way
        while 1 <= e <= rod.segments - 1 and _press_post(rod, scala, post, e):
            e += way


@kernel
def _press_post(rod, scala, post, edge):
    """A post pushes away an edge that is in it; whether it is."""
    t, dx, dy = _nearest(rod, edge, scala.post_mm[post, 0], scala.post_mm[post, 1])
    distance = math.sqrt(dx * dx + dy * dy)
    if distance == 0.0:
        return False
    if post < RECESS and rod.inside_from <= rod.segments and _in_bone(scala, post, dx, dy):
        distance = -distance
    sunk = rod.post_reach_mm[post] - distance
    if sunk <= 0.0:
        return False
    stiffness = rod.post_share[post] * scala.stiffness_n_per_mm2 * rod.post_reach_mm[post]
    rod.post_press_n[post] += stiffness * sunk
    rod.energy_nmm += 0.5 * stiffness * sunk * sunk
    _share(rod, edge, t, dx / distance, dy / distance, stiffness, stiffness * sunk)
    return True


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
def _in_bone(scala, post, dx, dy):
    """Whether the way from a lip's middle to the array leads into the bone behind it instead of into the hole."""
    deeper = dx * scala.axis[0] + dy * scala.axis[1] > 0.0
    return deeper and dx * scala.post_normal[post, 0] + dy * scala.post_normal[post, 1] < 0.0


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
        if rod.post_press_n[post] > 0.0:
            rub, touched = rod.post_rub[post], rod.post_touch[post]
            for k in range(4):
                rub[k] = touched[k]
            slip = _slip(rod, int(rub[0]), rub[1], rub[2], rub[3])
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
    """A folded tip lies against the shaft. Both sides get twice the stiffness, which bounds their coupling."""
    n = rod.segments
    apex, sharpest = n, 0.0
    for i in range(max(rod.inside_from, 2), n):
        if abs(rod.turn_rad[i]) > sharpest:
            apex, sharpest = i, abs(rod.turn_rad[i])
    for i in range(apex + 3, n + 1):
        cx, cy = _centre(rod, i)
        best, where, share, bx, by = math.inf, -1, 0.0, 0.0, 0.0
        for edge in range(max(2 * apex - i - SELF_WINDOW, 2), min(2 * apex - i + SELF_WINDOW, apex - 3)):
            t, dx, dy = _nearest(rod, edge, cx, cy)
            if dx * dx + dy * dy < best:
                best, where, share, bx, by = dx * dx + dy * dy, edge, t, dx, dy
        distance = math.sqrt(best)
        sunk = 2.0 * rod.radius_mm[i] - distance
        if where >= 0 and sunk > 0.0 and distance > 0.0:
            ux, uy = bx / distance, by / distance
            rod.self_n += stiffness * sunk
            row = 2 * (n - i)
            rod.energy_nmm += 0.5 * stiffness * sunk * sunk
            _stiffen(rod, row, ux, uy, 2.0 * stiffness)
            _pull(rod, i, row, -stiffness * sunk * ux, -stiffness * sunk * uy)
            _share(rod, where, share, ux, uy, 2.0 * stiffness, stiffness * sunk)


@kernel
def enter(rod, scala):
    """Before a step: which nodes are beyond the entry, and the foot of each that has come in; posts near the gripper."""
    for post in range(POSTS):
        place = (rod.post_edge[post] + 0.5) * rod.edge_mm
        rod.post_reach_mm[post] = scala.post_radius_mm[post] + rod.radius_mm[rod.post_edge[post]]
        rod.post_share[post] = min(max((place - FREE_MM) / FREE_MM, 0.0), 1.0) if post >= RECESS else 1.0
    n = rod.segments
    ex, ey, ax, ay = scala.entry_mm[0], scala.entry_mm[1], scala.axis[0], scala.axis[1]
    reach = scala.hole_radius_mm + scala.lip_radius_mm + SLACK_MM
    while rod.inside_from <= n:
        i = rod.inside_from
        if (rod.node_mm[i, 0] - ex) * ax + (rod.node_mm[i, 1] - ey) * ay >= 0.0:
            break
        rod.grip_n[i] = 0.0
        rod.inside_from += 1
    while rod.inside_from > 2:
        i = rod.inside_from - 1
        depth = (rod.node_mm[i, 0] - ex) * ax + (rod.node_mm[i, 1] - ey) * ay
        aside = (rod.node_mm[i, 1] - ey) * ax - (rod.node_mm[i, 0] - ex) * ay
        if depth < 0.0 or abs(aside - rod.radius_mm[i]) > reach:
            break
        rod.inside_from = i
        rod.grip_n[i] = 0.0
        rod.foot_mm[i] = scala.entry_arc_mm if i == n else rod.foot_mm[i + 1] - rod.edge_mm
        _find_foot(rod, scala, i)


@kernel
def _find_foot(rod, scala, i):
    """Newton's method for the foot of a node that has just come in."""
    cx, cy = _centre(rod, i)
    for _ in range(FIND_STEPS):
        wx, wy, tx, ty, curvature, _, _ = wall_at(scala, rod.foot_mm[i])
        gap = (cy - wy) * tx - (cx - wx) * ty
        if curvature * gap < FOOT_UNIQUE:
            rod.foot_mm[i] += ((cx - wx) * tx + (cy - wy) * ty) / (1.0 - curvature * gap)
