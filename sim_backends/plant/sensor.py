"""Six-axis force/torque sensor between robot and insertion module.

Axes of {F}: z along the insertion axis (x of the gripper), y against y of the gripper, x along z of the base.
Resistance to insertion is therefore a negative f_z.
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
        ("matrix", "f8", (6, 6)),
        ("bias", "f8", (6,)),
        ("drift_per_tick", "f8", (6,)),
        ("noise", "f8", (6,)),
        ("rated", "f8", (6,)),
        ("smoothing", "f8"),
        ("load", "f8", (6,)),
        ("filtered", "f8", (6,)),
        ("draw", "f8", (6,)),
    ],
    align=True,
)
"""Parameters, then state; wrenches as (f_x, f_y, f_z, m_x, m_y, m_z) in {F} [N, N mm]."""


@kernel
def bear(sensor, wrench_in_base, angle_rad):
    """The wrench on the sensor, into `load`: what touches the gripper tip, and the weight of the insertion module.

    wrench_in_base: (f_x, f_y, m_z) of the surroundings on the gripper, about its tip. angle_rad: of the gripper.
    """
    c, s = math.cos(angle_rad), math.sin(angle_rad)
    along = c * wrench_in_base[0] + s * wrench_in_base[1]
    aside = c * wrench_in_base[1] - s * wrench_in_base[0]
    w, r, load = sensor.weight_in_base_n, sensor.centre_of_mass_mm, sensor.load
    gx, gy, gz = w[2], s * w[0] - c * w[1], c * w[0] + s * w[1]
    load[0] = gx
    load[1] = gy - aside
    load[2] = gz + along
    load[3] = r[1] * gz - r[2] * gy + wrench_in_base[2] + sensor.lever_mm * aside
    load[4] = r[2] * gx - r[0] * gz
    load[5] = r[0] * gy - r[1] * gx


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
        reading[i] = value
        within = within and abs(value) <= sensor.rated[i]
    return within
