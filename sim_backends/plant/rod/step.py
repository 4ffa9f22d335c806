"""One step of the rod: overdamped, implicit, as a minimisation by Newton's method (08 section 3).

A step that does not converge is cut into halves, those again, up to eight times. What still fails leaves the rod where
it last was in equilibrium, and says so.
"""

import math

from hal.kernel import kernel
from sim_backends.plant.rod.band import eliminate, substitute
from sim_backends.plant.rod.contact import enter, keep_clear, keep_grip, touch
from sim_backends.plant.rod.elastic import assemble
from sim_backends.plant.rod.events import look
from sim_backends.plant.rod.state import POSTS
from sim_backends.plant.rod.stylet import remember, set_stylet

ITERATIONS = 40
SECANTS, ROUND = 1, 2
"""Of every two solves the first takes friction's secant, which lands on what sticks, the other its tangent, which slips."""
TOLERANCE_MM = 1e-4
"""A Newton step this short is the last: what remains after it is its square, below 1e-4 N in the stiffest spring."""
REACH_MM = 0.1
"""No node moves further in one iteration."""
SLACK_NMM = 1e-8
JUMP_MM = 0.02
CUTS, LEAST_CUT, MOST_CUT = 8, 0.1, 0.5
"""A Newton step that leads uphill is shortened so often, each time to a share between these."""
NOISE_NMM = 1e-9
"""A Newton step that would gain no more than twice this is the last, however long."""
SMALLEST = 1.0 / 256.0
BUDGET = 100
"""Iterations a tick may cost, so that it stays below a millisecond."""


@kernel
def lift(rod):
    """Take the array out of the gripper; what the next one has been through is nothing."""
    n = rod.segments
    rod.placed = rod.folded = rod.buckled = rod.failed = 0
    rod.inside_from = n + 1
    rod.depth_mm = rod.lift_n = rod.set_per_mm = 0.0
    rod.modiolar_n = rod.lateral_n = rod.face_n = rod.self_n = 0.0
    for i in range(n + 1):
        rod.stylet_set_per_mm[i] = rod.array_set_per_mm[i] = 0.0
        rod.press_n[i] = rod.grip_n[i] = 0.0
        rod.force_n[i, 0] = rod.force_n[i, 1] = 0.0
    for k in range(3):
        rod.wrench[k] = 0.0
    for k in range(6):
        rod.stiffness[k] = 0.0
    for post in range(POSTS):
        rod.post_press_n[post] = rod.post_grip_n[post] = 0.0
        rod.post_edge[post], rod.post_met[post], rod.post_side[post] = n - 1, 0, 0


@kernel
def place(rod, pose, stylet_mm):
    """A fresh array in the gripper, free: its shape is that of its rest curvature."""
    set_stylet(rod, stylet_mm)
    n = rod.segments
    for k in range(3):
        rod.pose[k] = pose[k]
    _clamp(rod, pose)
    angle = pose[2] + rod.grip_angle_rad
    for i in range(1, n):
        angle += rod.rest_turn_rad[i]
        rod.turn_rad[i] = rod.rest_turn_rad[i]
        rod.node_mm[i + 1, 0] = rod.node_mm[i, 0] + rod.edge_mm * math.cos(angle)
        rod.node_mm[i + 1, 1] = rod.node_mm[i, 1] + rod.edge_mm * math.sin(angle)
    for i in range(n + 1):
        for k in range(2):
            rod.before_mm[i, k] = rod.node_mm[i, k]
            rod.pace_mm[i, k] = 0.0
    _turn_normals(rod)
    rod.placed = 1


@kernel
def advance(rod, scala, pose, stylet_mm, step_s):
    """One tick: gripper to `pose` (x mm, y mm, phi rad in {B}), stylet to its withdrawal. False if it did not converge.

    `rod.wrench` becomes what the array does to the gripper, `rod.stiffness` how fast that changes with the pose. If it
    fails, the rod is as it was after the last part of the step that converged.
    """
    if not abs(pose[0] + pose[1] + pose[2] + stylet_mm) < math.inf:
        rod.failed = 1
        return False
    if not rod.placed:
        place(rod, pose, stylet_mm)
    x0, y0, p0, q0 = rod.pose[0], rod.pose[1], rod.pose[2], rod.stylet_mm
    rod.iterations = 0
    done, part = 0.0, 1.0
    rod.failed = 0
    while done < 1.0:
        x, y, p, q = rod.pose[0], rod.pose[1], rod.pose[2], rod.stylet_mm
        share = done + part
        rod.pose[0] = x0 + share * (pose[0] - x0)
        rod.pose[1] = y0 + share * (pose[1] - y0)
        rod.pose[2] = p0 + share * (pose[2] - p0)
        enter(rod, scala, step_s)
        set_stylet(rod, q0 + share * (stylet_mm - q0))
        if _settle(rod, scala, part, part * step_s):
            done = share
            _commit(rod, scala, part, part * step_s)
            part = min(2.0 * part, 1.0 - done)
        else:
            rod.retries += 1
            part *= 0.5
            rod.pose[0], rod.pose[1], rod.pose[2] = x, y, p
            set_stylet(rod, q)
            _go_back(rod, scala, step_s)
            if part < SMALLEST or rod.iterations > BUDGET:
                rod.failed = 1
                return False
    look(rod, scala)
    return True


@kernel
def _go_back(rod, scala, step_s):
    """All nodes where they were, and what they touch there."""
    for i in range(rod.segments + 1):
        rod.node_mm[i, 0], rod.node_mm[i, 1] = rod.before_mm[i, 0], rod.before_mm[i, 1]
        rod.foot_mm[i] = rod.foot_before_mm[i]
    touch(rod, scala, step_s, True)


@kernel
def _clamp(rod, pose):
    """The gripper holds the first edge by its middle."""
    c, s = math.cos(pose[2] + rod.grip_angle_rad), math.sin(pose[2] + rod.grip_angle_rad)
    half = 0.5 * rod.edge_mm
    rod.node_mm[0, 0], rod.node_mm[0, 1] = pose[0] - half * c, pose[1] - half * s
    rod.node_mm[1, 0], rod.node_mm[1, 1] = pose[0] + half * c, pose[1] + half * s


@kernel
def _settle(rod, scala, part, step_s):
    """Newton's method from where the nodes would be at their last pace; True once a step is short or gains nothing."""
    n = rod.segments
    x, rows = rod.node_mm, 2 * n - 2
    for i in range(2, n + 1):
        x[i, 0] = rod.before_mm[i, 0] + part * rod.pace_mm[i, 0]
        x[i, 1] = rod.before_mm[i, 1] + part * rod.pace_mm[i, 1]
    _clamp(rod, rod.pose)
    last, scale, gain, cuts, solves = math.inf, 0.0, 0.0, 0, 0
    for _ in range(ITERATIONS):
        rod.iterations += 1
        assemble(rod, step_s)
        touch(rod, scala, step_s, solves % ROUND < SECANTS)
        rise = rod.energy_nmm - last
        if not rise <= SLACK_NMM and cuts < CUTS:  # NaN, too, leads uphill
            # too far: back to where a parabola through both energies and the slope has its least
            keep = 0.5 * gain * scale / (rise + gain * scale)
            keep = min(max(keep, LEAST_CUT), MOST_CUT) if keep == keep else LEAST_CUT
            _move(rod, (keep - 1.0) * scale)
            scale *= keep
            cuts += 1
            continue
        last = rod.energy_nmm
        gradient, move = rod.gradient, rod.move_mm
        for r in range(rows):
            move[r] = gradient[r]
        eliminate(rod.band, gradient, rows)
        substitute(rod.band, gradient, rows)
        largest, gain = 0.0, 0.0  # gain: by how much the energy falls along the step, at first sight
        for r in range(rows):
            gain += move[r] * gradient[r]
            move[r] = -gradient[r]
            size = abs(move[r])
            if not size <= largest:  # NaN, too, is larger
                largest = size
        if not largest < math.inf:
            return False
        scale = min(1.0, REACH_MM / max(largest, TOLERANCE_MM))
        cuts = 0
        solves += 1
        _move(rod, scale)
        if largest < TOLERANCE_MM or (gain < NOISE_NMM and largest < 10.0 * TOLERANCE_MM):
            return True
    return False


@kernel
def _move(rod, scale):
    """All free nodes by a share of the last Newton step."""
    n = rod.segments
    for i in range(2, n + 1):
        r = 2 * (n - i)
        rod.node_mm[i, 0] += scale * rod.move_mm[r]
        rod.node_mm[i, 1] += scale * rod.move_mm[r + 1]


@kernel
def _commit(rod, scala, part, step_s):
    """The step is done: note what the gripper feels, and what is remembered."""
    _feel(rod)
    _turn_joints(rod)
    keep_grip(rod, scala, step_s)
    keep_clear(rod)
    x, before, pace = rod.node_mm, rod.before_mm, rod.pace_mm
    for i in range(rod.segments + 1):
        px, py = x[i, 0] - before[i, 0], x[i, 1] - before[i, 1]
        goes_on = part == 1.0 and max(abs(px), abs(py)) < JUMP_MM  # a jump does not
        pace[i, 0], pace[i, 1] = (px, py) if goes_on else (0.0, 0.0)
        before[i, 0], before[i, 1] = x[i, 0], x[i, 1]
    _turn_normals(rod)
    remember(rod)


@kernel
def _feel(rod):
    """Wrench and stiffness at the gripper from the last four rows, by virtual work of the clamped edge."""
    n = rod.segments
    band, gradient, wrench, stiffness = rod.band, rod.gradient, rod.wrench, rod.stiffness
    for k in range(3):
        wrench[k] = 0.0
    for k in range(6):
        stiffness[k] = 0.0
    first = 2 * n - 2
    for a in range(4):
        ax, ay, ap = _lever(rod, a)
        f = gradient[first + a]
        wrench[0] -= ax * f
        wrench[1] -= ay * f
        wrench[2] -= ap * f
        for b in range(4):
            bx, by, bp = _lever(rod, b)
            k = band[first + min(a, b), abs(a - b)]
            stiffness[0] += k * ax * bx
            stiffness[1] += k * ax * by
            stiffness[2] += k * ax * bp
            stiffness[3] += k * ay * by
            stiffness[4] += k * ay * bp
            stiffness[5] += k * ap * bp


@kernel
def _lever(rod, a):
    """How coordinate `a` of the clamped edge (x_1, y_1, x_0, y_0) moves with the gripper's x, y, phi."""
    i = 1 - a // 2
    if a % 2 == 0:
        return 1.0, 0.0, rod.pose[1] - rod.node_mm[i, 1]
    return 0.0, 1.0, rod.node_mm[i, 0] - rod.pose[0]


@kernel
def _turn_joints(rod):
    """Turning angles after the last Newton step, which was so short that they follow it linearly."""
    n, x, move = rod.segments, rod.node_mm, rod.move_mm
    ux = mx = my = 0.0  # of the edge and the node before; the gripper's do not move
    for i in range(1, n):
        ex, ey = x[i + 1, 0] - x[i, 0], x[i + 1, 1] - x[i, 1]
        r = 2 * (n - i - 1)
        fx, fy = move[r], move[r + 1]
        turned = (ex * (fy - my) - ey * (fx - mx)) / (ex * ex + ey * ey)
        rod.turn_rad[i] = rod.turning_rad[i] + turned - ux
        ux, mx, my = turned, fx, fy


@kernel
def _turn_normals(rod):
    """Left normals of the line at its nodes."""
    n, x, normal = rod.segments, rod.node_mm, rod.normal
    _turn_normal(x[0], x[1], normal[0])
    for i in range(1, n):
        _turn_normal(x[i - 1], x[i + 1], normal[i])
    _turn_normal(x[n - 1], x[n], normal[n])


@kernel
def _turn_normal(near, far, normal):
    """Left normal of the way from one node to another."""
    ex, ey = far[0] - near[0], far[1] - near[1]
    inverse = 1.0 / math.sqrt(ex * ex + ey * ey)
    normal[0], normal[1] = -ey * inverse, ex * inverse
