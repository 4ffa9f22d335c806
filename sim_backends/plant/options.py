"""The truth of the simulated bench: every parameter of the plant, with bounds and a plausible default.

It is deliberately not the controller's model. Defaults differ from the nominal robot by what a well built and badly
calibrated machine differs, so that whatever needs calibration, homing or force control has work to do.
"""

from dataclasses import dataclass

from hal.options import option
from rtctl.robots.planar_3rpr import Planar3rprOptions


@dataclass(frozen=True)
class Geometry(Planar3rprOptions):
    """The robot as it was really built: the nominal one with errors of manufacture."""

    a_mm: tuple[float, ...] = option(
        (63.205, 63.195, 64.005), shape=(3,), low=1, high=500, unit="mm", doc="arm lengths"
    )
    eta_mm_per_rad: tuple[float, ...] = option(
        (0.09703, 0.09698, 0.09702), shape=(3,), low=0.001, high=10, unit="mm/rad", doc="screw leads"
    )
    platform_mm: tuple[tuple[float, ...], ...] = option(
        ((-88.0, -2.0), (-88.005, -21.005), (-88.005, 21.005)),
        shape=(3, 2),
        low=-1000,
        high=1000,
        unit="mm",
        doc="platform joints in the platform frame, origin at the gripper tip",
    )


@dataclass(frozen=True)
class Motor:
    """A DC gear motor behind an amplifier in current mode; torques and angles at the gear's output shaft."""

    gain_a_per_v: float = option(0.2, low=0.001, high=10.0, unit="A/V", doc="amplifier current per volt of set value")
    current_limit_a: float = option(2.0, low=0.01, high=20.0, unit="A", doc="largest current of the amplifier")
    torque_nmm_per_a: float = option(20.0, low=0.1, high=1000.0, unit="N mm/A", doc="K")
    inertia_nmm_s2: float = option(1.2e-3, low=1e-5, high=1.0, unit="N mm s^2", doc="J of rotor, gear and screw")
    viscous_nmm_s: float = option(0.06, low=1e-4, high=10.0, unit="N mm s", doc="drag per rad/s")
    coulomb_nmm: float = option(0.4, low=0.0, high=100.0, unit="N mm", doc="dry friction of the unloaded drive")
    screw_efficiency: float = option(
        0.35, low=0.05, high=1.0, doc="of the lead screw; below one half it cannot be driven backwards"
    )
    counts_per_turn: int = option(
        4096, low=16, high=10_000_000, unit="counts", doc="encoder lines times four times the gear ratio"
    )


@dataclass(frozen=True)
class Wire:
    """Wire loops and pistons of the three legs; the leads of their screws belong to the geometry."""

    stiffness_n: float = option(3200.0, low=10.0, high=1e6, unit="N", doc="EA of the wire rope")
    near_length_mm: float = option(150.0, low=1.0, high=2000.0, unit="mm", doc="h_1, the segment that pulls back")
    far_length_mm: float = option(220.0, low=1.0, high=2000.0, unit="mm", doc="h_2, the segment that pushes out")
    pretension_n: float = option(15.0, low=0.0, high=200.0, unit="N", doc="tension of both segments at rest")
    backlash_rad: tuple[float, ...] = option(
        (1.9, 2.4, 1.5),
        shape=(3,),
        low=0.0,
        high=20.0,
        unit="rad",
        doc="chi: width of the hysteresis between motor and piston that piston friction makes with this wire",
    )
    settling_s: float = option(
        0.004, low=1e-4, high=0.1, unit="s", doc="time constant of the piston on the wire, from viscous drag"
    )
    home_error_mm: tuple[float, ...] = option(
        (0.006, -0.004, 0.003),
        shape=(3,),
        low=-5.0,
        high=5.0,
        unit="mm",
        doc="piston extension that remains when the carriage has come to its retracted end stop",
    )
    stroke_mm: float = option(44.0, low=5.0, high=100.0, unit="mm", doc="carriage travel between its end stops")


@dataclass(frozen=True)
class StyletDrive:
    """The drive that pulls the stylet out of the array."""

    motor: Motor
    lead_mm_per_rad: float = option(0.05, low=0.001, high=1.0, unit="mm/rad", doc="screw lead")
    stroke_mm: float = option(16.0, low=1.0, high=50.0, unit="mm", doc="rod travel between its end stops")
    start_mm: float = option(1.5, low=0.0, high=50.0, unit="mm", doc="rod position at power-up, unknown to anybody")
    friction_n: float = option(1.0, low=0.0, high=50.0, unit="N", doc="binding of the rod and of the stylet")


@dataclass(frozen=True)
class Sensor:
    """Six-axis force/torque sensor between robot and insertion module, axes in {F}: z along the insertion axis."""

    lever_mm: float = option(60.0, low=0.0, high=500.0, unit="mm", doc="gripper tip in front of the sensor's origin")
    weight_n: float = option(1.5, low=0.0, high=50.0, unit="N", doc="weight of the insertion module")
    gravity_direction_in_base: tuple[float, ...] = option(
        (0.10, -0.30, -0.95), shape=(3,), low=-1, high=1, doc="direction of gravity in {B}; normalised"
    )
    centre_of_mass_in_sensor_mm: tuple[float, ...] = option(
        (3.0, -2.0, 25.0), shape=(3,), low=-500, high=500, unit="mm", doc="of the insertion module"
    )
    bias: tuple[float, ...] = option(
        (0.35, -0.20, 0.80, 4.0, -6.0, 2.0), shape=(6,), low=-1000, high=1000, unit="N, N mm", doc="reading of no load"
    )
    drift_per_min: tuple[float, ...] = option(
        (0.002, -0.001, 0.002, 0.02, 0.01, -0.01), shape=(6,), low=-10, high=10, unit="N, N mm", doc="bias per minute"
    )
    force_noise_n: float = option(0.004, low=0.0, high=10.0, unit="N", doc="rms of one sample")
    moment_noise_nmm: float = option(0.1, low=0.0, high=100.0, unit="N mm", doc="rms of one sample")
    cutoff_hz: float = option(200.0, low=1.0, high=10000.0, unit="Hz", doc="first-order filter of the electronics")
    cross_axis_error: float = option(
        0.003, low=0.0, high=0.1, doc="standard deviation of the entries of the matrix error, shares of rated load"
    )
    rated_force_n: float = option(18.0, low=0.1, high=10000.0, unit="N", doc="saturates beyond")
    rated_moment_nmm: float = option(250.0, low=1.0, high=1e6, unit="N mm", doc="saturates beyond")


@dataclass(frozen=True)
class Anatomy:
    """Where the cochlea really is, and what it is like to touch."""

    entry_in_base_mm: tuple[float, ...] = option(
        (172.6, 4.7), shape=(2,), low=-1000, high=1000, unit="mm", doc="centre of the cochleostomy in {B}"
    )
    insertion_angle_rad: float = option(
        0.224, low=-3.2, high=3.2, unit="rad", doc="bearing of the straight part of the insertion path in {B}"
    )
    hole_radius_mm: float = option(0.67, low=0.3, high=3.0, unit="mm", doc="of the cochleostomy")
    wall_stiffness_n_per_mm: float = option(
        3.0, low=0.01, high=100.0, unit="N/mm", doc="of wall, lip and bone face under one node"
    )
    friction: float = option(0.15, low=0.0, high=1.0, doc="Coulomb coefficient between array and tissue")
    friction_travel_mm: float = option(
        0.1, low=0.005, high=2.0, unit="mm", doc="tissue and array give so far before they slide on each other"
    )
    floor_drag_n_per_mm: float = option(
        0.01, low=0.0, high=0.1, unit="N/mm", doc="friction of floor and roof of the scala per inserted length"
    )


@dataclass(frozen=True)
class Array:
    """The electrode array the assistant loads."""

    number: int = option(1, low=1, high=7, doc="which synthetic array it is (02 section 2); the planner assumes 1")
    curvature_error: float = option(0.03, low=-0.5, high=0.5, doc="share by which it curls more than that array")
    grip_angle_rad: float = option(0.01, low=-0.3, high=0.3, unit="rad", doc="angle at which the assistant grips it")
    shaft_bending_nmm2: float = option(
        3.0, low=0.05, high=50.0, unit="N mm^2", doc="bending stiffness between gripper and entry, stylet inside"
    )
    tip_stiffness_n_per_mm: float = option(
        0.015, low=1e-4, high=1.0, unit="N/mm", doc="resistance of one node at the tip against being bent aside"
    )
    base_stiffness_n_per_mm: float = option(
        0.05, low=1e-4, high=1.0, unit="N/mm", doc="the same for the node at the gripper, linear between them"
    )
    yield_mm: float = option(
        1.5, low=0.05, high=20.0, unit="mm", doc="deflection at which a node's resistance has fallen to a half"
    )
    tip_radius_mm: float = option(0.25, low=0.05, high=1.0, unit="mm", doc="radius of the array at its tip")
    base_radius_mm: float = option(0.40, low=0.05, high=1.0, unit="mm", doc="and at the gripper, linear between them")


@dataclass(frozen=True)
class Inject:
    """Failures to order, each from a time after the first tick on; none by default."""

    axes_silent_after_s: float | None = option(None, low=0.0, unit="s", doc="the encoders stop answering")
    wrench_silent_after_s: float | None = option(None, low=0.0, unit="s", doc="the sensor stops answering")
    wrench_saturated_after_s: float | None = option(None, low=0.0, unit="s", doc="a gauge is at its rail")
    amplifier_fault_after_s: float | None = option(None, low=0.0, unit="s", doc="an amplifier is not ready, no power")
    jam_after_s: float | None = option(None, low=0.0, unit="s", doc="a motor no longer turns")
    jam_axis: int = option(0, low=0, high=3, doc="which motor jams")


@dataclass(frozen=True)
class PlantOptions:
    """Everything about the simulated bench."""

    geometry: Geometry
    motor: Motor
    wire: Wire
    stylet: StyletDrive
    sensor: Sensor
    anatomy: Anatomy
    array: Array
    inject: Inject
    start_pose_mm_rad: tuple[float, ...] = option(
        (154.0, -5.0, -0.01),
        shape=(3,),
        low=-1000,
        high=1000,
        unit="mm, rad",
        doc="pose at power-up, unknown to anybody",
    )
    watchdog_ticks: int = option(
        50, low=1, high=10000, unit="ticks", doc="silence after which the device removes power by itself"
    )
