"""The two frames that cross the seam every tick: what the devices measured, what they shall do.

A value never travels alone: every group of values has a validity, an age in ticks since it was
sampled, and the sequence number of its sample. An invalid group carries NaN, so that a reader who
forgets to look at the validity cannot mistake it for a measurement.
"""

import enum

import numpy as np


class Validity(enum.IntEnum):
    """State of a group of sensor values; only VALID may be used for control."""

    INVALID = 0
    """No measurement this tick: device silent, broken or not opened."""
    VALID = 1
    SATURATED = 2
    """A channel is at its rail, so no component can be trusted (07 section 3.3)."""
    FROZEN = 3
    """Bit-identical for longer than noise allows."""


INVALID, VALID, SATURATED, FROZEN = (int(v) for v in Validity)


def sensor_frame(axes: int) -> np.dtype:
    """Measurements of one tick for a robot with `axes` motors (the stylet's is the last).

    axis_angle_rad: accumulated motor angles since the device was opened, direction positive, no home offset.
    wrench_in_sensor: force [N] and moment [N mm] that the gripper side exerts on the sensor, in {F}, biased.
    impedance_ohm: bipolar impedance of one pair of the electrode's contacts, the latest sample of its telemetry. An open
        circuit reads about 28.8 kohm and a short next to nothing: samples like any other, and no numbers to control by.
    impedance_pair: which pair that was, counted from the tip of the array; -1 for none. A backend without telemetry says
        INVALID, NaN and -1.
    powered: the amplifiers are energised.
    trouble: code of hal.troubles.Trouble, the gravest there is, 0 for none; trouble_value: the number that belongs to it;
        trouble_device: which device of the backend says so, -1 for none; trouble_grade: a hal.troubles.Grade.
    device_time_s: what the clock of the device that may pace the loop showed when `read` was called, in seconds of its own
        crystal; its samples are taken at whole periods. NaN from a backend without such a clock, and while it is not known.
    """
    return np.dtype(
        [
            ("axis_angle_rad", "f8", (axes,)),
            ("wrench_in_sensor", "f8", (6,)),
            ("impedance_ohm", "f8"),
            ("device_time_s", "f8"),
            ("axes_sequence", "i8"),
            ("wrench_sequence", "i8"),
            ("impedance_sequence", "i8"),
            ("trouble_value", "f8"),
            ("impedance_pair", "i4"),
            ("axes_age_ticks", "i4"),
            ("wrench_age_ticks", "i4"),
            ("impedance_age_ticks", "i4"),
            ("trouble", "i4"),
            ("trouble_device", "i4"),
            ("axes_validity", "u1"),
            ("wrench_validity", "u1"),
            ("impedance_validity", "u1"),
            ("powered", "u1"),
            ("watchdog_tripped", "u1"),
            ("amplifier_fault", "u1"),
            ("trouble_grade", "u1"),
        ],
        align=True,
    )


def actuator_frame(axes: int) -> np.dtype:
    """Commands of one tick.

    command_v: set value of each amplifier [V], -10 .. 10; never NaN.
    power: 1 asks for energised amplifiers. Going from 0 to 1 re-arms a tripped watchdog.
    array_loaded: the operator has declared that an array is in the gripper; drivers ignore it,
        a simulated assistant uses it to load one.
    """
    return np.dtype([("command_v", "f8", (axes,)), ("power", "u1"), ("array_loaded", "u1")], align=True)
