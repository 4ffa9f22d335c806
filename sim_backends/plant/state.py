"""The one record of the simulated bench: parameters and state of every part, and what it tells as truth."""

import math

import numpy as np

from hal.errors import OptionError
from hal.options import table_of
from hal.signals import TICK, TIME, Signal, Table
from rtctl import robots
from rtctl.electrode.cochlea import SPIRAL_A_MM
from rtctl.robots.planar_3rpr import PLANAR_3RPR
from sim_backends.plant import crystal, impedance, scala, transmission
from sim_backends.plant.ideal import idealised
from sim_backends.plant.impedance import IMPEDANCE
from sim_backends.plant.motors import MOTOR
from sim_backends.plant.options import Motor, PlantOptions, Sensor, StyletDrive
from sim_backends.plant.rod import state as rod
from sim_backends.plant.rod.state import ROD
from sim_backends.plant.scala import SCALA
from sim_backends.plant.sensor import GRAVITY_M_PER_S2, SENSOR
from sim_backends.plant.transmission import LEG
from sim_backends.plant.trial import specimen

LEGS, AXES, STYLET = 3, 4, 3
NEVER_TICKS = 2**62
SHOWN = 31
"""Points at which the truth tells the array's shape, from the grip to the tip at equal arc lengths."""

SIGNALS = (
    TIME,
    TICK,
    Signal("pose_gripper_in_base", "f8", (3,), "mm, mm, rad", "true gripper pose", "B"),
    Signal("wrench_on_gripper_in_base", "f8", (3,), "N, N, N mm", "f_x, f_y, m_z of the array on the gripper tip", "B"),
    Signal("lift_on_gripper_n", "f8", (), "N", "out of the plane, f_z of the array on the gripper tip", "B"),
    Signal("array_tip_in_base_mm", "f8", (2,), "mm", "true tip of the array; NaN without one", "B"),
    Signal("array_node_in_base_mm", "f8", (2 * SHOWN,), "mm", "x, y of points, gripper to tip; NaN without array", "B"),
    Signal("contact_force_in_base_n", "f8", (2 * SHOWN,), "N", "x, y of everything that touches it, at those points", "B"),
    Signal("entry_in_base_mm", "f8", (2,), "mm", "true centre of the cochleostomy", "B"),
    Signal("insertion_angle_rad", "f8", (), "rad", "true bearing of the insertion direction", "B"),
    Signal("cochlea_scale", "f8", (), "", "size of the true cochlea, as a multiple of the template"),
    Signal("array_depth_mm", "f8", (), "mm", "length of the array beyond the entry"),
    Signal("modiolar_wall_n", "f8", (), "N", "sum of normal forces of the modiolar wall"),
    Signal("lateral_wall_n", "f8", (), "N", "sum of normal forces of the lateral wall"),
    Signal("lips_n", "f8", (), "N", "normal forces of the lips of the entry"),
    Signal("recess_n", "f8", (), "N", "normal forces of the facial recess on the shaft"),
    Signal("face_n", "f8", (), "N", "normal forces of the bone beside the entry"),
    Signal("permanent_curvature_per_mm", "f8", (), "1/mm", "largest set that stylet or array have taken"),
    Signal("stylet_mm", "f8", (), "mm", "true withdrawal of the stylet, which never goes back"),
    Signal("stylet_rod_mm", "f8", (), "mm", "rod position from its retracted stop"),
    Signal("motor_rate_rad_per_s", "f8", (AXES,), "rad/s", "true motor speeds"),
    Signal("motor_current_a", "f8", (AXES,), "A", "amplifier currents"),
    Signal("wire_tension_n", "f8", (2 * LEGS,), "N", "near and far wire segment of every leg"),
    Signal("rod_retries", "i8", (), "", "steps so far that had to be cut up to converge"),
    Signal("rod_iterations", "i4", (), "", "Newton steps the array took in this tick"),
    Signal("array_loaded", "u1", (), "", "an array is in the gripper"),
    Signal("inside", "u1", (), "", "the array has found the entry"),
    Signal("folded", "u1", (), "", "the tip points backwards in the scala"),
    Signal("buckled", "u1", (), "", "the array stays bent by more than 10 degrees outside the entry"),
    Signal("failed", "u1", (), "", "the simulation of the array did not converge; it stands still"),
)  # fmt: skip
TABLE = Table("Truth", SIGNALS)
TRUTH = TABLE.dtype

DEVICE = np.dtype(
    [
        # parameters
        ("seed", "u8"),
        ("period_s", "f8"),
        ("watchdog_ticks", "i8"),
        ("axes_silent_ticks", "i8"),
        ("wrench_silent_ticks", "i8"),
        ("wrench_saturated_ticks", "i8"),
        ("amplifier_fault_ticks", "i8"),
        ("jam_ticks", "i8"),
        ("jam_axis", "i8"),
        # state of the electronics
        ("start_tick", "i8"),
        ("tick", "i8"),
        ("write_tick", "i8"),
        ("axes_tick", "i8"),
        ("wrench_tick", "i8"),
        ("axes_sequence", "i8"),
        ("wrench_sequence", "i8"),
        ("rest_ticks", "i8"),
        ("command_v", "f8", (AXES,)),
        # state of the mechanics
        ("pose", "f8", (3,)),
        ("motor_angle", "f8", (3,)),
        ("load_n", "f8", (3,)),
        ("load_gain", "f8"),
        ("wrench", "f8", (3,)),
        ("wire_jacobian", "f8", (3, 3)),
        ("stylet_mm", "f8"),
        # parts
        ("robot", PLANAR_3RPR),
        ("motor", MOTOR, (AXES,)),
        ("leg", LEG, (LEGS,)),
        ("sensor", SENSOR),
        ("impedance", IMPEDANCE),
        ("scala", SCALA),
        ("array", ROD),
        ("crystal", crystal.CRYSTAL),
        ("truth", TRUTH),
        # flags
        ("opened", "u1"),
        ("started", "u1"),
        ("powered", "u1"),
        ("tripped", "u1"),
        ("amplifier_fault", "u1"),
        ("array_loaded", "u1"),
        ("failed", "u1"),
    ],
    align=True,
)


def pack(options: PlantOptions, period_s: float, seed: int) -> np.ndarray:
    """A DEVICE record, shape (1,), at its start pose, closed and without power.

    Raises:
        OptionError: options that each are within bounds do not go together.
        RobotError: the true geometry has no home, or the start pose cannot be assembled.
    """
    options = idealised(options)
    device = np.zeros(1, DEVICE)
    d = device[0]
    d["seed"] = np.random.SeedSequence(seed).generate_state(1, np.uint64)[0]
    d["period_s"], d["watchdog_ticks"] = period_s, options.watchdog_ticks
    _pack_robot(options, d)
    _pack_stylet(options.stylet, d["motor"][STYLET])
    _pack_sensor(options.sensor, period_s, seed, d["sensor"])
    impedance.pack(options.impedance, options.inject, options.array.length_mm, period_s, seed, d["impedance"])
    scala.pack(options.anatomy, specimen(options), d["scala"])
    rod.pack(options.array, d["array"])
    crystal.pack(options.crystal_ppm, d["crystal"])
    d["truth"]["entry_in_base_mm"] = options.anatomy.entry_in_base_mm
    d["truth"]["insertion_angle_rad"] = options.anatomy.insertion_angle_rad
    d["truth"]["cochlea_scale"] = options.anatomy.spiral_a_mm / SPIRAL_A_MM
    inject = options.inject
    for name in ("axes_silent", "wrench_silent", "wrench_saturated", "amplifier_fault", "jam"):
        after_s = getattr(inject, f"{name}_after_s")
        d[f"{name}_ticks"] = NEVER_TICKS if after_s is None else round(after_s / period_s)
    d["jam_axis"] = inject.jam_axis
    return device


def _pack_robot(options: PlantOptions, d: np.void) -> None:
    robot, wire = robots.load("planar_3rpr", table_of(options.geometry)), options.wire
    d["robot"] = robot.record[0]
    d["pose"] = options.start_pose_mm_rad
    _, d["motor_angle"] = robot.inverse(d["pose"])
    for i in range(LEGS):
        eta, motor, leg = options.geometry.eta_mm_per_rad[i], d["motor"][i], d["leg"][i]
        leg["near_n_per_mm"] = wire.stiffness_n / wire.near_length_mm
        leg["far_n_per_mm"] = wire.stiffness_n / wire.far_length_mm
        leg["pretension_n"] = wire.pretension_n
        play_mm = eta * wire.backlash_rad[i]
        leg["friction_n"] = play_mm / 2 * (leg["near_n_per_mm"] + leg["far_n_per_mm"])
        leg["settling_s"] = wire.settling_s
        leg["misalignment_mm"], leg["straight_mm"] = wire.misalignment_mm[i], wire.straight_mm
        leg["pulley_radius_mm"] = options.geometry.pulley_radius_mm[i]
        leg["home_length_mm"] = transmission.wire_length(
            leg["straight_mm"], leg["misalignment_mm"], leg["pulley_radius_mm"]
        )[0]
        leg["piston_mm"] = eta * d["motor_angle"][i]
        _pack_motor(options.motor, eta, motor)
        motor["angle_rad"] = transmission.carriage_of(leg, leg["piston_mm"]) / eta
        # a carriage that comes to its stop leaves its piston behind by half the play; the stop is set to allow for it
        motor["low_rad"] = (wire.home_error_mm[i] - play_mm / 2) / eta
        motor["high_rad"] = motor["low_rad"] + wire.stroke_mm / eta
        nearest_mm = wire.straight_mm + eta * motor["low_rad"]
        if nearest_mm <= 0.0 or nearest_mm**2 <= 2 * leg["pulley_radius_mm"] * leg["misalignment_mm"]:
            raise OptionError(
                "backend.options.wire.straight_mm leaves no room between carriage and pulley",
                value=wire.straight_mm, remedy="make it larger, or misalignment_mm smaller",
            )  # fmt: skip


def _pack_stylet(options: StyletDrive, motor: np.void) -> None:
    _pack_motor(options.motor, options.lead_mm_per_rad, motor)
    motor["coulomb_nmm"] += options.lead_mm_per_rad * options.friction_n / options.motor.screw_efficiency
    motor["high_rad"] = options.stroke_mm / options.lead_mm_per_rad
    motor["angle_rad"] = min(options.start_mm, options.stroke_mm) / options.lead_mm_per_rad


def _pack_motor(options: Motor, lead_mm_per_rad: float, motor: np.void) -> None:
    for name in (
        "gain_a_per_v", "current_limit_a", "torque_nmm_per_a", "inertia_nmm_s2", "viscous_nmm_s", "coulomb_nmm",
        "gain_v_per_v", "resistance_ohm",
    ):  # fmt: skip
        motor[name] = getattr(options, name)
    motor["in_voltage_mode"] = options.amplifier == "voltage"
    motor["inductance_h"] = options.inductance_mh / 1000.0
    motor["screw_loss"] = 1.0 / options.screw_efficiency - 1.0
    motor["count_rad"] = 2 * math.pi / options.counts_per_turn
    motor["lead_mm_per_rad"] = lead_mm_per_rad


def _pack_sensor(options: Sensor, period_s: float, seed: int, sensor: np.void) -> None:
    direction = np.array(options.gravity_direction_in_base)
    sensor["lever_mm"] = options.lever_mm
    sensor["weight_in_base_n"] = options.weight_n * direction / max(float(np.linalg.norm(direction)), 1e-12)
    sensor["mass_kg"], sensor["inertia_kg_mm2"] = options.weight_n / GRAVITY_M_PER_S2, options.inertia_kg_mm2
    sensor["centre_of_mass_mm"] = options.centre_of_mass_in_sensor_mm
    sensor["rated"] = rated = np.repeat((options.rated_force_n, options.rated_moment_nmm), 3)
    error = np.random.default_rng(seed).standard_normal((6, 6)) * options.cross_axis_error
    sensor["matrix"] = np.eye(6) + error * rated[:, None] / rated
    sensor["bias"] = options.bias
    sensor["drift_per_tick"] = np.array(options.drift_per_min) * period_s / 60.0
    sensor["noise"] = np.repeat((options.force_noise_n, options.moment_noise_nmm), 3)
    sensor["step"] = np.repeat((options.force_step_n, options.moment_step_nmm), 3)
    sensor["smoothing"] = 1.0 - math.exp(-2 * math.pi * options.cutoff_hz * period_s)
