"""Who did work on the rod in an insertion, and where it went: the books are kept from positions, not by the solver.

Forces act along the whole step as they are at its end (implicit Euler), so the sums differ from the continuous ones in
the first order of the step.
"""

import numpy as np

from bench.rod_insertion import Case, motion_of, new_records
from hal.kernel import kernel
from sim_backends.plant.rod.friction import reach
from sim_backends.plant.rod.step import advance
from sim_backends.plant.rod.stylet import occupied

BOOK = np.dtype(
    [
        ("gripper_nmm", "f8"),  # done by the gripper
        ("stylet_nmm", "f8"),  # done by the stylet's drive
        ("contacts_nmm", "f8"),  # done on the rod by what is around it, friction included
        ("elastic_nmm", "f8"),  # stored in the rod, since the start
        ("walls_nmm", "f8"),  # stored in walls, lips and face
        ("friction_nmm", "f8"),  # lost to it
        ("damping_nmm", "f8"),  # lost in the rod and in the fluid
        ("imbalance_n", "f8"),  # largest: reported wrench less the forces on the nodes
        ("imbalance_nmm", "f8"),  # the same of the moment about the gripper's tip
    ],
    align=True,
)


def keep(case: Case) -> tuple[np.ndarray, np.ndarray]:
    """Rows (n,) of sums from the start of an insertion on, and the ROD record at its end."""
    rod, scala = new_records(case)
    motion = motion_of(case)
    book = np.zeros(len(motion.depth_mm), BOOK)
    assert _keep(rod, scala, motion.pose, motion.stylet_mm, case.step_s, book) == 0
    return book, rod[0]


@kernel
def _stored(rod):
    """Of stretching and bending, array and stylet side by side: B_a (kappa - kappa_a)^2 / 2 + B_s kappa^2 / 2."""
    n, edge, x = rod.segments, rod.edge_mm, rod.node_mm
    energy = 0.0
    for j in range(n):
        size = np.hypot(x[j + 1, 0] - x[j, 0], x[j + 1, 1] - x[j, 1])
        energy += 0.5 * rod.stretch_n_per_mm * (size - edge) ** 2
    for i in range(1, n):
        bent = _turn(x, i) / edge
        wire = rod.stylet_nmm2 * occupied(rod, (n - i) * edge, rod.stylet_mm)
        off = bent - rod.rest_per_mm[i]
        energy += 0.5 * edge * (rod.array_nmm2[i] * off * off + wire * bent * bent)
    return energy


@kernel
def _turn(x, i):
    ax, ay = x[i, 0] - x[i - 1, 0], x[i, 1] - x[i - 1, 1]
    bx, by = x[i + 1, 0] - x[i, 0], x[i + 1, 1] - x[i, 1]
    return np.arctan2(ax * by - ay * bx, ax * bx + ay * by)


@kernel
def _rubbed(grip_n, slip_mm, step_s):
    """Friction's force times the slip."""
    return grip_n * slip_mm * slip_mm / reach(slip_mm, step_s)


@kernel
def _floor(rod, scala, i, before_mm, slip_mm, step_s):
    """The same of floor and lid on node i; the two that came in last do not bear in full."""
    share = 1.0
    if i <= rod.inside_from + 1:
        dx, dy = before_mm[0] - scala.entry_mm[0], before_mm[1] - scala.entry_mm[1]
        share = min(max((dx * scala.axis[0] + dy * scala.axis[1]) / rod.edge_mm, 0.0), 1.0)
    drag = _rubbed(rod.floor_friction * scala.floor_load_n_per_mm, slip_mm, step_s)
    return share * rod.edge_mm * (drag + scala.viscous_n_s_per_mm2 / step_s * slip_mm * slip_mm)


@kernel
def _keep(rods, scalas, pose, stylet_mm, step_s, book):
    """How many steps failed or were cut up: the books are then wrong."""
    rod, scala = rods[0], scalas[0]
    n, edge = rod.segments, rod.edge_mm
    spoilt = 0
    x0, turn0 = rod.node_mm.copy(), np.zeros(n)
    start = grip = wire = around = rubbed = damped = 0.0
    for k in range(pose.shape[0]):
        last_mm = rod.stylet_mm
        grip_n, tangent = rod.grip_n.copy(), rod.tangent.copy()
        post_grip_n, post_rub = rod.post_grip_n.copy(), rod.post_rub.copy()
        retries = rod.retries
        if not advance(rod, scala, pose[k], stylet_mm[k], step_s) or rod.retries != retries:
            spoilt += 1
        x = rod.node_mm
        stored = _stored(rod)
        if k == 0:
            start = stored
        else:
            for c in range(3):
                grip -= rod.wrench[c] * (pose[k, c] - pose[k - 1, c])
            for i in range(1, n):
                at = (n - i) * edge
                change = occupied(rod, at, stylet_mm[k]) - occupied(rod, at, last_mm)
                bent, turned = _turn(x, i) / edge, _turn(x, i) - turn0[i]
                wire += 0.5 * edge * rod.stylet_nmm2 * change * bent * bent
                damped += rod.relaxation_s / step_s * rod.bending_nmm2[i] / edge * turned * turned
        fx = fy = moment = held = 0.0
        for i in range(n + 1):
            dx, dy = x[i, 0] - x0[i, 0], x[i, 1] - x0[i, 1]
            px, py = rod.force_n[i, 0], rod.force_n[i, 1]
            if k > 0:
                around += px * dx + py * dy
                damped += rod.drag_n_s_per_mm / step_s * (dx * dx + dy * dy)
                rubbed += _rubbed(grip_n[i], dx * tangent[i, 0] + dy * tangent[i, 1], step_s)
                if i >= rod.inside_from:
                    rubbed += _floor(rod, scala, i, x0[i], np.hypot(dx, dy), step_s)
            qx, qy = px - rod.drag_n_s_per_mm / step_s * dx, py - rod.drag_n_s_per_mm / step_s * dy
            fx += qx
            fy += qy
            moment += (x[i, 0] - rod.pose[0]) * qy - (x[i, 1] - rod.pose[1]) * qx
            if rod.press_n[i] > 0.0:
                held += 0.5 * rod.press_n[i] ** 2 / (scala.stiffness_n_per_mm2 * edge)
        for post in range(rod.post_press_n.size):
            if k > 0 and post_grip_n[post] > 0.0:
                edge_of, t = int(post_rub[post, 0]), post_rub[post, 1]
                slip = 0.0
                for c in range(2):
                    near, far = x[edge_of, c] - x0[edge_of, c], x[edge_of + 1, c] - x0[edge_of + 1, c]
                    slip += ((1.0 - t) * near + t * far) * post_rub[post, 2 + c]
                rubbed += _rubbed(post_grip_n[post], slip, step_s)
            if rod.post_press_n[post] > 0.0:
                held += 0.5 * rod.post_press_n[post] ** 2 / (scala.stiffness_n_per_mm2 * rod.post_reach_mm[post])
        row = book[k]
        row.gripper_nmm, row.stylet_nmm, row.contacts_nmm = grip, wire, around
        row.elastic_nmm, row.walls_nmm = stored - start, held
        row.friction_nmm, row.damping_nmm = rubbed, damped
        if k > 0:
            row.imbalance_n = np.hypot(fx - rod.wrench[0], fy - rod.wrench[1])
            row.imbalance_nmm = abs(moment - rod.wrench[2])
        for i in range(n + 1):
            x0[i, 0], x0[i, 1] = x[i, 0], x[i, 1]
        for i in range(1, n):
            turn0[i] = _turn(x, i)
    return spoilt
