"""The one record: a row of shared memory, a row of the log and a message on the wire are the same bytes.

One table of signals gives the numpy dtype, the ros2msg text and the reference documentation. Fields are
ordered by size, so that the row is naturally aligned without padding and at the same time a valid CDR body.
"""

from hal.signals import TICK, TIME, Signal, Table
from rtctl.stages import STAGES

CDR_HEADER = b"\x00\x01\x00\x00"
"""Encapsulation: plain CDR, little endian."""

INPUTS = frozenset(
    [
        "tick",
        "axis_angle_rad",
        "wrench_in_sensor",
        "impedance_ohm",
        "impedance_pair",
        "axes_sequence",
        "wrench_sequence",
        "impedance_sequence",
        "axes_age_ticks",
        "wrench_age_ticks",
        "impedance_age_ticks",
        "axes_validity",
        "wrench_validity",
        "impedance_validity",
        "powered",
        "watchdog_tripped",
        "amplifier_fault",
        "trouble",
        "trouble_device",
        "trouble_grade",
        "trouble_value",
        "command_sequence",
        "command_argument",
        "command_deadline_tick",
        "command_source",
        "command_verb",
        "missed_ticks",
        "clock_state",
        "gateway_health",
        "time_ns",
    ]
)
"""What a replay feeds; everything else must come out again, except TIMING."""

ZERO_BEFORE = frozenset({"clock_state"})
"""Inputs that logs of earlier versions lack, where they would have been zero: there was the grid clock only."""

TIMING = frozenset(
    [
        "tick_ns",
        "lateness_ns",
        "clock_error_s",
        "clock_moved_ns",
        "stage_ns",
        "minor_faults",
        "major_faults",
        "voluntary_switches",
        "involuntary_switches",
        "core",
    ]
)
"""Measured of the machine, so different in every run, and zero in lockstep."""


def controller_table(dof: int) -> Table:
    """Signals of the controller of a robot with `dof` pose coordinates (its motors plus one for the stylet)."""
    axes = dof + 1
    pose = "mm, rad"
    base, gripper = "{B}", "gripper in {B}"
    s = Signal
    return Table(
        "Controller",
        (
            TIME,
            TICK,
            # what came in
            s(
                "axis_angle_rad",
                "f8",
                (axes,),
                "rad",
                "motor angles as the device counts them; the stylet's is the last",
            ),
            s("wrench_in_sensor", "f8", (6,), "N, N mm", "raw force and moment, biased and with gravity", "{F}"),
            s("impedance_ohm", "f8", (), "ohm", "bipolar, last sample; 28.8 kohm is an open circuit, 0 a short"),
            s("axes_sequence", "i8", (), "", "sample number of the motor angles"),
            s("wrench_sequence", "i8", (), "", "sample number of the wrench"),
            s("impedance_sequence", "i8", (), "", "sample number of the impedance"),
            s("command_sequence", "i8", (), "", "number of the command read in this tick, 0 for none"),
            s("command_argument", "f8", (8,), "by verb", "arguments of that command"),
            s("command_deadline_tick", "i8", (), "tick", "the command is void after this tick"),
            s("command_source", "u8", (), "", "hash of the name of the client that sent it"),
            # what is known
            s("pose_measured", "f8", (dof,), pose, "forward kinematics of the motor angles", gripper),
            s("joint_measured", "f8", (dof,), "mm", "piston strokes at the measured pose"),
            s("stylet_measured_mm", "f8", (), "mm", "stylet withdrawal from the motor angle"),
            s("wrench_in_base", "f8", (6,), "N, N mm", "filtered, free of bias and gravity", base),
            s("force_axial_n", "f8", (), "N", "along the insertion axis; resistance is negative"),
            s("force_lateral_n", "f8", (), "N", "magnitude across the insertion axis"),
            # what is wanted
            s("pose_goal", "f8", (dof,), pose, "where the present motion ends", gripper),
            s("pose_desired", "f8", (dof,), pose, "high-level controller, before admittance (x_des)", gripper),
            s("pose_reference", "f8", (dof,), pose, "after admittance and limits (x_admit)", gripper),
            s("pose_entry", "f8", (dof,), pose, "registered entry, NaN until registered", gripper),
            s("admittance_offset_mm", "f8", (3,), "mm", "lateral correction, Delta x", base),
            s("depth_mm", "f8", (), "mm", "commanded insertion depth d"),
            s("depth_goal_mm", "f8", (), "mm", "depth where the insertion or retraction ends"),
            s("depth_rate_mm_per_s", "f8", (), "mm/s", "commanded insertion speed"),
            s("stylet_desired_mm", "f8", (), "mm", "planned stylet withdrawal, q_s,des"),
            s("stylet_reference_mm", "f8", (), "mm", "after the stylet's admittance law, q_s,admit"),
            s("joint_reference", "f8", (dof,), "mm", "inverse kinematics of the reference"),
            s("axis_reference_rad", "f8", (axes,), "rad", "with backlash compensation, home offset included"),
            s("command_desired_v", "f8", (axes,), "V", "controller output before the limits"),
            s("command_applied_v", "f8", (axes,), "V", "what was written to the amplifiers"),
            # impedance guidance: NaN and 0 while it is off
            s("impedance_step_mm", "f8", (), "mm", "step of the stylet the last evaluation asked for"),
            s("impedance_offset_mm", "f8", (), "mm", "withdrawal added by impedance in this insertion"),
            s("impedance_jacobian_norm", "f8", (), "ohm/mm", "norm of J_zqs at the last evaluation"),
            # why
            s("condition_active", "i8", (), "bits", "conditions that hold in this tick"),
            s("condition_latched", "i8", (), "bits", "conditions since the last acknowledgement"),
            s("reason_value", "f8", (), "by reason", "offending value of a refused command"),
            s("reason_bound", "f8", (), "by reason", "the bound it broke"),
            s("condition_value", "f8", (), "by condition", "offending value of the condition reported"),
            s("condition_bound", "f8", (), "by condition", "the bound it broke"),
            s("trouble_value", "f8", (), "by trouble", "number that belongs to `trouble`"),
            # the device that paces the loop
            s("clock_error_s", "f8", (), "s", "grid point after its place in the device's period, NaN while not known"),
            # failure detection: NaN and 0 without a detector, and outside an insertion
            s("predicted_force_n", "f8", (), "N", "f_z at 13.8 mm as far as it can be predicted"),
            s("fold_decision", "f8", (), "", "h of the predicted insertion; normal is above -fold_bound"),
            s("fold_bound", "f8", (), "", "rho delta h: how far h may be wrong, by the margin in force"),
            s("buckling_integral", "f8", (2,), "N, N mm", "phi_1 and phi_2: force and moment over lambda"),
            s("buckling_bound", "f8", (2,), "N, N mm", "largest normal values of them"),
            # small things
            s("axes_age_ticks", "i4", (), "ticks", "age of the motor angles"),
            s("wrench_age_ticks", "i4", (), "ticks", "age of the wrench"),
            s("impedance_age_ticks", "i4", (), "ticks", "age of the impedance"),
            s("impedance_pair", "i4", (), "", "pair of contacts it was measured at, counted from the tip; -1 for none"),
            s("trouble", "i4", (), "", "gravest trouble a device reports, see the table of troubles; 0 for none"),
            s("trouble_device", "i4", (), "", "which device of the settings reports it, -1 for none"),
            s("missed_ticks", "i4", (), "ticks", "grid points skipped before this one"),
            s("command_verb", "i4", (), "", "verb of the command read in this tick, see the command table"),
            s("command_verdict", "i4", (), "", "reason number: 0 nothing to judge, 1 accepted, else why refused"),
            s("parameter_set", "i4", (), "", "number of the parameter set in force"),
            s("plan_number", "i4", (), "", "number of the insertion plan in force, 0 for none"),
            s("condition_reported", "i4", (), "", "gravest condition that arose in this tick, -1 for none"),
            s("fault_cause", "i4", (), "", "first condition that led to the fault, -1 for none"),
            s("stop_cause", "i4", (), "", "condition or command that ended the last motion, -1 for none"),
            s("kinematic_iterations", "i4", (), "", "Newton steps of the forward kinematics, -1 if it failed"),
            s("detector_samples", "i4", (), "", "samples the detectors have of this insertion, of 97"),
            s("clock_moved_ns", "i4", (), "ns", "how far the grid was moved after this tick, to follow the device"),
            s("tick_ns", "i4", (), "ns", "time the tick took, from wake-up to the end of the record"),
            s("lateness_ns", "i4", (), "ns", "wake-up after the grid point"),
            s(
                "stage_ns",
                "i4",
                (len(STAGES),),
                "ns",
                f"time of each stage: {', '.join(g.name for g in STAGES)}; the last is that of the tick before",
            ),
            s("minor_faults", "i4", (), "", "page faults of the loop's thread since the record before, without disk"),
            s("major_faults", "i4", (), "", "the same, with disk"),
            s(
                "voluntary_switches",
                "i4",
                (),
                "",
                "times it went to sleep since the record before; 1 is the wait for the tick",
            ),
            s("involuntary_switches", "i4", (), "", "times another thread took its core away since the record before"),
            s("core", "i4", (), "", "core it ran on"),
            s(
                "gateway_health",
                "u4",
                (),
                "bits",
                "1 alive, 2 log writing, 4 operator present, 8 operator expected, 16 gateway expected, 32 arming allowed",
            ),
            s("impedance_usable", "u4", (), "bits", "pairs that guide in this tick, the one at the tip is bit 0"),
            s("clock_state", "u1", (), "", "0 grid, 1 watching the device's time, 2 pulling in, 3 locked, 4 refused"),
            s("axes_validity", "u1", (), "", "0 invalid, 1 valid, 2 saturated, 3 frozen"),
            s("wrench_validity", "u1", (), "", "0 invalid, 1 valid, 2 saturated, 3 frozen"),
            s("impedance_validity", "u1", (), "", "0 invalid, 1 valid, 2 saturated, 3 frozen"),
            s("powered", "u1", (), "", "the amplifiers are energised"),
            s("watchdog_tripped", "u1", (), "", "the device removed power because the loop was silent"),
            s("amplifier_fault", "u1", (), "", "an amplifier reports not ready"),
            s("trouble_grade", "u1", (), "", "0 none, 1 warning, 2 pause, 3 fault"),
            s("operating_state", "u1", (), "", "0 disabled, 1 enabled, 2 paused, 3 fault"),
            s(
                "task_state",
                "u1",
                (),
                "",
                "0 idle, 1 approach, 2 at_entry, 3 inserting, 4 holding, 5 retracting, 6 done",
            ),
            s(
                "motion",
                "u1",
                (),
                "",
                "0 hold, 1 move, 2 servo position, 3 servo velocity, 4 insert, 5 retract, 6 home",
            ),
            s("is_homed", "u1", (), "", "motor angles are referenced to the home pose"),
            s("is_busy", "u1", (), "", "a motion or a routine is under way"),
            s("is_unbiased", "u1", (), "", "the force sensor's bias has been taken since the array was loaded"),
            s("array_loaded", "u1", (), "", "the operator has loaded an array"),
            s(
                "detector_flags",
                "u1",
                (),
                "bits",
                "1 watching, 2 blind, 4 phi_1 high, 8 phi_2 high, 16 buckled, 32 tip folded; all but 1 latched",
            ),
            s(
                "impedance_phase",
                "u1",
                (),
                "",
                "0 moving, 1 measuring, 2 correcting, 3 measuring again, 4 ready to go on",
            ),
            s("power_request", "u1", (), "", "the controller asks for energised amplifiers"),
        ),
    )
