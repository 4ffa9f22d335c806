"""Six-axis force/torque sensor between robot and insertion module.

Axes of {F}: z along the insertion axis (x of the gripper), y against y of the gripper, x along z of the base.
Resistance to insertion is therefore a negative f_z. Between sensor and gripper is the insertion module, whose weight
and inertia the sensor bears too. It moves in the plane, and its products of inertia are left out.
"""

import math

import numpy as np

from hal.kernel import kernel
from sim_backends.plant.noise import normals

SENSOR = np.dtype(
    [
        ("lever_mm", "f8"),
        ("weight_in_base_n", "f8", (3,)),
        ("centre_of_mass_mm", "f8", (3,)),
        ("mass_kg", "f8"),
        ("inertia_kg_mm2", "f8"),  # about the centre of mass, along z of {B}
        ("matrix", "f8", (6, 6)),
        ("bias", "f8", (6,)),
        ("drift_per_tick", "f8", (6,)),
        ("noise", "f8", (6,)),
        ("rated", "f8", (6,)),
        ("step", "f8", (6,)),
        ("smoothing", "f8"),
        ("place", "f8", (3,)),  # of the module: centre of mass x, y [mm] in {B}, angle [rad], as of the last tick
        ("speed", "f8", (3,)),
        ("acceleration", "f8", (3,)),
        ("places_known", "i8"),
        ("load", "f8", (6,)),
        ("filtered", "f8", (6,)),
        ("draw", "f8", (6,)),
    ],
    align=True,
)
"""Parameters, then state; wrenches as (f_x, f_y, f_z, m_x, m_y, m_z) in {F} [N, N mm]."""

GRAVITY_M_PER_S2 = 9.81
N_PER_KG_MM_S2 = 1e-3
"""1 kg mm/s^2 in newtons, and 1 kg mm^2/s^2 in N mm."""


@kernel
def stand(sensor, pose):
    """The module is at a pose (x mm, y mm, phi rad) of the gripper, and how it moves there is not known."""
    _locate(sensor, pose)
    sensor.places_known = 1
    for i in range(3):
        sensor.speed[i] = sensor.acceleration[i] = 0.0


@kernel
def swing(sensor, pose, period_s):
    """Follow the module to the gripper's pose one tick later; its acceleration is the second difference of places.

    It is that of the middle tick, so it comes one tick late. Two places have to be known before it is.
    """
    before_x, before_y, before_angle = sensor.place[0], sensor.place[1], sensor.place[2]
    _locate(sensor, pose)
    _accelerate(sensor, 0, (sensor.place[0] - before_x) / period_s, period_s)
    _accelerate(sensor, 1, (sensor.place[1] - before_y) / period_s, period_s)
    _accelerate(sensor, 2, (sensor.place[2] - before_angle) / period_s, period_s)
    sensor.places_known = min(sensor.places_known + 1, 2)


@kernel
def _locate(sensor, pose):
    c, s, r = math.cos(pose[2]), math.sin(pose[2]), sensor.centre_of_mass_mm
    ahead = r[2] - sensor.lever_mm
    sensor.place[0] = pose[0] + c * ahead + s * r[1]
    sensor.place[1] = pose[1] + s * ahead - c * r[1]
    sensor.place[2] = pose[2]


@kernel
def _accelerate(sensor, i, speed, period_s):
    sensor.acceleration[i] = (speed - sensor.speed[i]) / period_s if sensor.places_known >= 2 else 0.0
    sensor.speed[i] = speed


@kernel
def bear(sensor, wrench_in_base, angle_rad, lift_n, along_mm, aside_mm):
    """The wrench on the sensor, into `load`: what touches the gripper tip, and weight and inertia of the module.

    The module's momentum changes by weight and touch less what the sensor bears: L = W + w - m a, and about the
    sensor's origin M = r x (W - m a) + M_w - I alpha.
    wrench_in_base: (f_x, f_y, m_z) of the surroundings on the gripper, about its tip. angle_rad: of the gripper.
    lift_n: their force along z of {B}, which acts so far ahead and to the left of the gripper tip.
    """
    c, s = math.cos(angle_rad), math.sin(angle_rad)
    along = c * wrench_in_base[0] + s * wrench_in_base[1]
    aside = c * wrench_in_base[1] - s * wrench_in_base[0]
    w, r, load = sensor.weight_in_base_n, sensor.centre_of_mass_mm, sensor.load
    wx = w[0] - N_PER_KG_MM_S2 * sensor.mass_kg * sensor.acceleration[0]
    wy = w[1] - N_PER_KG_MM_S2 * sensor.mass_kg * sensor.acceleration[1]
    gx, gy, gz = w[2], s * wx - c * wy, c * wx + s * wy
    load[0] = gx + lift_n
    load[1] = gy - aside
    load[2] = gz + along
    load[3] = r[1] * gz - r[2] * gy + wrench_in_base[2] + sensor.lever_mm * aside
    load[3] -= N_PER_KG_MM_S2 * sensor.inertia_kg_mm2 * sensor.acceleration[2]
    load[4] = r[2] * gx - r[0] * gz + (sensor.lever_mm + along_mm) * lift_n
    load[5] = r[0] * gy - r[1] * gx + aside_mm * lift_n


@kernel
def settle(sensor):
    """Let the filter stand where the load is."""
    for i in range(6):
        sensor.filtered[i] = sensor.load[i]


@kernel
def follow(sensor):
    """One tick of the electronics' filter."""
    for i in range(6):
        sensor.filtered[i] += sensor.smoothing * (sensor.load[i] - sensor.filtered[i])


@kernel
def sample(sensor, seed, tick, reading):
    """Write what the sensor says into `reading` (6,); False if an axis is beyond its rated load."""
    normals(seed, tick, sensor.draw)
    within = True
    for i in range(6):
        value = sensor.bias[i] + sensor.drift_per_tick[i] * tick + sensor.noise[i] * sensor.draw[i]
        for j in range(6):
            value += sensor.matrix[i, j] * sensor.filtered[j]
        if sensor.step[i] > 0.0:
            value = math.floor(value / sensor.step[i] + 0.5) * sensor.step[i]
        reading[i] = value
        within = within and abs(value) <= sensor.rated[i]
    return within
