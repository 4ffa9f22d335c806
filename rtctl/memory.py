"""All the controller remembers, in one structured record that is allocated once.

The tick gets it as ``memory``; its parts are plain nested records: the robot's geometry, the parameter set
in force, the state, the motion profile being followed, the profile proposed for the command of this tick,
the insertion plan, the command itself, the failure detector with what it knows of the insertion, and what the contacts of
the array have read. Whoever holds the same memory and feeds the same inputs gets the same outputs to the bit.
"""

import numpy as np

from rtctl.commands import COMMAND
from rtctl.electrode.path import PATH
from rtctl.guidance.impedance.layout import LAW, PAIR_STORE
from rtctl.guidance.layout import DETECTOR, INSERTION
from rtctl.way_back import ROWS as WAY_ROWS

SEGMENTS = 12
"""Pieces of one channel of a profile: a brake of two, seven of a move, and the final one, rounded up."""
WINDOW_MAX = 1000
"""Samples of the longest moving average: 0.1 s at the shortest period."""


def parameters_dtype(dof: int) -> np.dtype:
    """The parameter set: what settings become for the tick. Units are in the names."""
    axes = dof + 1
    return np.dtype(
        [
            ("number", "i8"),
            ("period_s", "f8"),
            # wrench: Butterworth section b, a, or moving average; gravity; averaging of the bias
            ("moving_average", "i8"),
            ("window_ticks", "i8"),
            ("filter_b", "f8", (3,)),
            ("filter_a", "f8", (3,)),
            ("gravity_force_in_base_n", "f8", (3,)),
            ("centre_of_mass_in_sensor_mm", "f8", (3,)),
            ("unbias_ticks", "i8"),
            # admittance
            ("lateral_on", "i8"),
            ("project_first", "i8"),
            ("stylet_on", "i8"),
            ("deadband_n", "f8"),
            ("lateral_gain_mm_per_n_s", "f8"),
            ("lateral_limit_mm", "f8"),
            ("lateral_mask", "f8", (3,)),
            ("stylet_gain_mm_per_n_s", "f8"),
            ("regulated_force_n", "f8"),
            ("blend_start_mm", "f8"),
            ("blend_end_mm", "f8"),
            # trajectory: one value a channel, the depth is the last
            ("speed", "f8", (axes,)),
            ("acceleration", "f8", (axes,)),
            ("jerk", "f8", (axes,)),
            ("stream_ticks", "i8"),
            ("entry_tolerance_mm", "f8"),
            ("length_dofs", "i8"),
            # low-level control: one value an axis, the stylet is the last
            ("proportional", "f8", (axes,)),
            ("integral", "f8", (axes,)),
            ("derivative", "f8", (axes,)),
            ("feedforward", "f8", (axes,)),
            ("backlash_rad", "f8", (axes,)),
            ("derivative_blend", "f8"),
            ("integral_limit_v", "f8"),
            ("command_limit_v", "f8"),
            ("command_slew_v", "f8"),
            ("backlash_step_rad", "f8"),
            ("stylet_lead_mm_per_rad", "f8"),
            ("stylet_stroke_mm", "f8"),
            ("stylet_step_mm", "f8"),
            # homing
            ("homing_step_rad", "f8"),
            ("homing_limit_v", "f8"),
            ("homing_stall_ticks", "i8"),
            ("homing_timeout_ticks", "i8"),
            # safety
            ("following_error_rad", "f8"),
            ("force_limit_n", "f8"),
            ("drift_limit_n", "f8"),
            ("drift_ticks", "i8"),
            ("axes_age_ticks", "i8"),
            ("wrench_age_ticks", "i8"),
            ("power_on_ticks", "i8"),
            ("overrun_ticks", "i8"),
            ("overrun_window_ticks", "i8"),
            ("overrun_window_limit", "i8"),
            ("overrun_windows", "i8"),
            # failure detection
            ("fold_margin", "f8"),
            ("fold_reaction", "i8"),
            ("buckling_reaction", "i8"),
            ("buckling_two_sided", "i8"),
            # impedance guidance
            ("impedance_law", LAW),
        ],
        align=True,
    )


def profile_dtype(dof: int) -> np.dtype:
    """Piecewise cubic motion of every channel (pose, then depth) from `start_tick` on."""
    channels = dof + 1
    shape = (channels, SEGMENTS)
    return np.dtype(
        [
            ("start_tick", "i8"),
            ("valid", "i8"),
            ("reason", "i8"),
            ("reason_value", "f8"),
            ("reason_bound", "f8"),
            ("duration_s", "f8"),
            ("segments", "i8", (channels,)),
            ("start_s", "f8", shape),
            ("position", "f8", shape),
            ("velocity", "f8", shape),
            ("acceleration", "f8", shape),
            ("jerk", "f8", shape),
        ],
        align=True,
    )


def state_dtype(dof: int) -> np.dtype:
    """What lives from tick to tick, block by block."""
    axes = dof + 1
    return np.dtype(
        [
            # lifecycle
            ("tick", "i8"),
            ("operating", "i8"),
            ("task", "i8"),
            ("motion", "i8"),
            ("paused_motion", "i8"),
            ("homed", "i8"),
            ("array_loaded", "i8"),
            ("unbiased", "i8"),
            ("active", "i8"),
            ("latched", "i8"),
            ("fault_cause", "i8"),
            ("stop_cause", "i8"),
            ("power_ticks", "i8"),
            ("plan_number", "i8"),
            # missed ticks: number of the window under way, those missed in it, windows before it that were bad
            ("overrun_window", "i8"),
            ("overrun_missed", "i8"),
            ("overrun_run", "i8"),
            # high-level controller: setpoint of every channel with its derivatives
            ("setpoint", "f8", (axes,)),
            ("setpoint_rate", "f8", (axes,)),
            ("setpoint_acceleration", "f8", (axes,)),
            ("path_offset", "f8", (dof,)),
            ("pose_goal", "f8", (dof,)),
            ("pose_entry", "f8", (dof,)),
            ("depth_goal_mm", "f8"),
            ("depth_speed_mm_per_s", "f8"),
            ("stream_tick", "i8"),
            ("on_path", "i8"),
            # kinematics
            ("pose", "f8", (dof,)),
            ("joint", "f8", (dof,)),
            ("rotation", "f8", (3, 3)),
            ("angle_rad", "f8", (axes,)),
            ("axes_silent_ticks", "i8"),
            ("home_offset_rad", "f8", (axes,)),
            # wrench
            ("scratch", "f8", (2, 8)),
            ("filter_state", "f8", (6, 2)),
            ("window", "f8", (6, WINDOW_MAX)),
            ("window_sum", "f8", (6,)),
            ("window_lap", "f8", (6,)),
            ("window_at", "i8"),
            ("filter_ready", "i8"),
            ("bias_in_sensor", "f8", (6,)),
            ("unbias_sum", "f8", (6,)),
            ("unbias_left", "i8"),
            ("drift_ticks", "i8"),
            # admittance
            ("lateral_offset_mm", "f8", (3,)),
            ("way_offset_mm", "f8", (WAY_ROWS, 3)),
            ("way_depth_mm", "f8"),
            ("stylet_extra_mm", "f8"),
            ("stylet_reference_mm", "f8"),
            # trajectory and low-level control
            ("reference", "f8", (dof,)),
            ("joint_reference", "f8", (dof,)),
            ("motor_reference", "f8", (axes,)),
            ("axis_reference", "f8", (axes,)),
            ("side", "f8", (axes,)),
            ("compensation_rad", "f8", (axes,)),
            ("integral_v", "f8", (axes,)),
            ("rate_rad_per_s", "f8", (axes,)),
            ("last_error_rad", "f8", (axes,)),
            ("last_command_v", "f8", (axes,)),
            # homing
            ("homing_ticks", "i8"),
            ("stall_ticks", "i8"),
            ("stall_angle_rad", "f8", (axes,)),
        ],
        align=True,
    )


def memory_dtype(robot_dtype: np.dtype, dof: int) -> np.dtype:
    """The whole memory of a controller for a robot with geometry record `robot_dtype`."""
    profile = profile_dtype(dof)
    return np.dtype(
        [
            ("robot", robot_dtype),
            ("parameters", parameters_dtype(dof)),
            ("staged_parameters", parameters_dtype(dof)),
            ("state", state_dtype(dof)),
            ("profile", profile),
            ("proposal", profile),
            ("plan", PATH),
            ("staged_plan", PATH),
            ("command", COMMAND),
            ("detector", DETECTOR),
            ("insertion", INSERTION),
            ("pairs", PAIR_STORE),
        ],
        align=True,
    )
