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
    """A DC gear motor behind an amplifier; torques and angles at the gear's output shaft."""

    amplifier: str = option("current", choices=("current", "voltage"), doc="what the amplifier makes of the set value")
    gain_a_per_v: float = option(0.2, low=0.001, high=10.0, unit="A/V", doc="amplifier current per volt of set value")
    gain_v_per_v: float = option(
        2.4, low=0.01, high=20.0, unit="V/V", doc="in voltage mode: volts at the motor per volt of set value"
    )
    resistance_ohm: float = option(12.0, low=0.05, high=1000.0, unit="ohm", doc="R of the winding, for voltage mode")
    inductance_mh: float = option(1.0, low=0.0, high=1000.0, unit="mH", doc="L of the winding, for voltage mode")
    current_limit_a: float = option(2.0, low=0.01, high=20.0, unit="A", doc="largest current of the amplifier")
    torque_nmm_per_a: float = option(20.0, low=0.1, high=1000.0, unit="N mm/A", doc="K; the back-EMF's in mV s/rad")
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
    misalignment_mm: tuple[float, ...] = option(
        (0.25, -0.2, 0.25),
        shape=(3,),
        low=-2.0,
        high=2.0,
        unit="mm",
        doc="n: the carriage runs so far beside the tangent of its pulley, positive towards the pulley's axis",
    )
    straight_mm: float = option(
        25.0, low=10.0, high=500.0, unit="mm", doc="u*: from the pulley to the carriage while it is at home"
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
    weight_n: float = option(1.5, low=0.0, high=50.0, unit="N", doc="of the insertion module; its mass too")
    gravity_direction_in_base: tuple[float, ...] = option(
        (0.10, -0.30, -0.95), shape=(3,), low=-1, high=1, doc="direction of gravity in {B}; normalised"
    )
    centre_of_mass_in_sensor_mm: tuple[float, ...] = option(
        (3.0, -2.0, 25.0), shape=(3,), low=-500, high=500, unit="mm", doc="of the insertion module"
    )
    inertia_kg_mm2: float = option(
        150.0, low=0.0, high=1e5, unit="kg mm^2", doc="of the module about its centre of mass, across the robot's plane"
    )
    bias: tuple[float, ...] = option(
        (0.35, -0.20, 0.80, 4.0, -6.0, 2.0), shape=(6,), low=-1000, high=1000, unit="N, N mm", doc="reading of no load"
    )
    drift_per_min: tuple[float, ...] = option(
        (0.002, -0.001, 0.002, 0.02, 0.01, -0.01), shape=(6,), low=-10, high=10, unit="N, N mm", doc="bias per minute"
    )
    force_noise_n: float = option(0.004, low=0.0, high=10.0, unit="N", doc="rms of one sample")
    moment_noise_nmm: float = option(0.1, low=0.0, high=100.0, unit="N mm", doc="rms of one sample")
    force_step_n: float = option(0.0006, low=0.0, high=1.0, unit="N", doc="of the converter; 0 for none")
    moment_step_nmm: float = option(0.008, low=0.0, high=100.0, unit="N mm", doc="of the converter; 0 for none")
    cutoff_hz: float = option(200.0, low=1.0, high=10000.0, unit="Hz", doc="first-order filter of the electronics")
    cross_axis_error: float = option(
        0.003, low=0.0, high=0.1, doc="standard deviation of the entries of the matrix error, shares of rated load"
    )
    rated_force_n: float = option(18.0, low=0.1, high=10000.0, unit="N", doc="saturates beyond")
    rated_moment_nmm: float = option(250.0, low=1.0, high=1e6, unit="N mm", doc="saturates beyond")


@dataclass(frozen=True)
class Impedance:
    """Telemetry of the implant: the bipolar impedance of its 22 contacts, pair after pair (04 sections 3 and 4)."""

    pair_period_s: float = option(0.07, low=0.001, high=1.0, unit="s", doc="one pair is measured each")
    pair_step: int = option(
        1, low=1, high=2, doc="1 measures contacts (i, i + 1), 21 pairs a sweep; 2 measures (i, i + 2), 20 pairs"
    )
    first_contact_mm: float = option(
        0.6, low=0.0, high=5.0, unit="mm", doc="from the tip to the middle of the first contact"
    )
    pitch_mm: float = option(0.62, low=0.1, high=1.5, unit="mm", doc="between neighbouring contacts")
    factor_ohm: float = option(83.2, low=0.0, high=1e4, unit="ohm", doc="a of the power law z = a A^b + c, A in mm^2")
    exponent: float = option(-1.317, low=-3.0, high=-0.1, doc="b of the power law")
    far_field_ohm: float = option(1149.0, low=0.0, high=1e4, unit="ohm", doc="c of the power law")
    area_max_mm2: float = option(0.8, low=0.05, high=5.0, unit="mm^2", doc="a larger area changes nothing")
    distance_min_mm: float = option(
        0.05, low=0.001, high=0.5, unit="mm", doc="a contact nearer to the modiolus than the law was fitted reads alike"
    )
    bath: bool = option(False, doc="the array hangs in a bath of saline, far from every wall, to be calibrated")
    series_ohm: tuple[float, ...] = option(
        (100.0, 500.0), shape=(2,), low=0.0, high=5000.0, unit="ohm", doc="of a pair's leads: drawn between these"
    )
    noise_ohm: float = option(50.0, low=0.0, high=500.0, unit="ohm", doc="rms of one sample, typically below 200")


@dataclass(frozen=True)
class Anatomy:
    """Where the cochlea really is, and how large."""

    entry_in_base_mm: tuple[float, ...] = option(
        (172.6, 4.7), shape=(2,), low=-1000, high=1000, unit="mm", doc="centre of the cochleostomy in {B}"
    )
    insertion_angle_rad: float = option(
        0.224, low=-3.2, high=3.2, unit="rad", doc="bearing of the straight part of the insertion path in {B}"
    )
    out_of_plane_mm: float = option(
        0.0, low=-3.0, high=3.0, unit="mm", doc="height of the cochlea's plane above the robot's, along z of {B}"
    )
    spiral_a_mm: float = option(
        3.84, low=3.2, high=4.6, unit="mm", doc="A of the template: walls, widths and heights grow with it"
    )
    hole_radius_mm: float = option(0.67, low=0.4, high=3.0, unit="mm", doc="of the cochleostomy")
    lip_radius_mm: float = option(0.15, low=0.02, high=0.5, unit="mm", doc="its rim is rounded so far")
    recess_angle_rad: float = option(
        0.297,
        low=0.05,
        high=1.5,
        unit="rad",
        doc="half angle of the access through the facial recess, seen from the entry, in the plane of insertion",
    )
    recess_clearance_mm: float = option(
        2.0, low=0.3, high=10.0, unit="mm", doc="half width of the facial recess, which is where the cone is as wide"
    )


@dataclass(frozen=True)
class Phantom:
    """A specimen of teflon and acrylic: what the array rubs on, and how much such specimens differ."""

    wall_stiffness_n_per_mm2: float = option(
        3.9, low=0.2, high=50.0, unit="N/mm^2", doc="of wall, lip and bone per length of array: silicone indents"
    )
    friction: float = option(
        0.17, low=0.0, high=1.0, doc="kinetic Coulomb coefficient between array and specimen; fitted to set 0"
    )
    friction_static: float = option(0.1785, low=0.0, high=1.2, doc="the same at rest, at least the kinetic one")
    stribeck_mm_per_s: float = option(
        0.25, low=0.01, high=5.0, unit="mm/s", doc="speed at which friction has fallen most of the way to kinetic"
    )
    viscous_n_s_per_mm2: float = option(
        0.0, low=0.0, high=0.1, unit="N s/mm^2", doc="drag of the lubricant per inserted length and speed"
    )
    floor_load_n_per_mm: float = option(
        0.035,
        low=0.0,
        high=0.2,
        unit="N/mm",
        doc="how hard floor and lid press on an inserted length, which only rubs; fitted to set 0 and Table V.2",
    )
    lateral_sd_mm: float = option(0.12, low=0.0, high=2.0, unit="mm", doc="scatter of the registered entry, in plane")
    out_of_plane_sd_mm: float = option(0.2, low=0.0, high=2.0, unit="mm", doc="the same across the plane")
    angle_sd_rad: float = option(0.035, low=0.0, high=0.3, unit="rad", doc="scatter of the registered direction")
    stylet_sd_mm: float = option(0.06, low=0.0, high=2.0, unit="mm", doc="scatter of where the hook takes the stylet")
    stylet_late_mm: float = option(
        0.0, low=-2.0, high=3.0, unit="mm", doc="how much later than planned the stylet starts, on average"
    )
    curvature_sd: float = option(0.03, low=0.0, high=0.2, doc="scatter of the arrays' curvature, as a share")
    friction_sd: float = option(0.1, low=0.0, high=0.5, doc="scatter of friction and floor load, as a share")


@dataclass(frozen=True)
class Bone(Phantom):
    """A cadaveric temporal bone: no view inside, so it is registered worse, and the stylet starts late."""

    wall_stiffness_n_per_mm2: float = option(
        3.9, low=0.2, high=50.0, unit="N/mm^2", doc="of wall, lip and bone per length of array: silicone indents"
    )
    friction: float = option(0.157, low=0.0, high=1.0, doc="kinetic Coulomb coefficient; fitted to set 0b")
    friction_static: float = option(0.165, low=0.0, high=1.2, doc="the same at rest, at least the kinetic one")
    lateral_sd_mm: float = option(0.2, low=0.0, high=2.0, unit="mm", doc="scatter of the registered entry, in plane")
    out_of_plane_sd_mm: float = option(0.3, low=0.0, high=2.0, unit="mm", doc="the same across the plane")
    angle_sd_rad: float = option(0.06, low=0.0, high=0.3, unit="rad", doc="scatter of the registered direction")
    stylet_sd_mm: float = option(0.5, low=0.0, high=2.0, unit="mm", doc="scatter of where the hook takes the stylet")
    stylet_late_mm: float = option(
        0.72, low=-2.0, high=3.0, unit="mm", doc="how much later than planned the stylet starts, fitted to set 0b"
    )


@dataclass(frozen=True)
class Trial:
    """What differs from one insertion to the next."""

    specimen: str = option("phantom", choices=("phantom", "bone"), doc="which of the two tables holds")
    side: str = option(
        "right",
        choices=("right", "left"),
        doc="ear; for a left one the robot is mounted turned over about x of {B}, where gravity then comes from below",
    )
    lateral_mm: float = option(
        0.0, low=-3.0, high=3.0, unit="mm", doc="the entry lies so far left of where `anatomy` has it, across the axis"
    )
    out_of_plane_mm: float = option(
        0.0, low=-3.0, high=3.0, unit="mm", doc="the same across the plane, towards z of {B} of a right ear"
    )
    angle_rad: float = option(0.0, low=-0.3, high=0.3, unit="rad", doc="and the cochlea is turned so far about it")
    scatter: bool = option(False, doc="add draws from the seed to it, with the deviations in the specimen's table")


@dataclass(frozen=True)
class Array:
    """The electrode array the assistant loads: a rod with a stylet in it (08 section 3)."""

    length_mm: float = option(18.0, low=15.5, high=18.0, unit="mm", doc="from the grip to the tip")
    segments: int = option(48, low=20, high=80, doc="edges of the rod")
    bending_tip_nmm2: float = option(
        0.1, low=0.02, high=0.3, unit="N mm^2", doc="bending stiffness at the tip without stylet"
    )
    bending_base_nmm2: float = option(
        1.0, low=0.3, high=2.0, unit="N mm^2", doc="the same 15 mm behind the tip, linear between them"
    )
    stylet_bending_nmm2: float = option(4.2, low=1.0, high=8.0, unit="N mm^2", doc="bending stiffness of the stylet")
    curvature_tip_per_mm: float = option(
        0.99, low=0.5, high=1.3, unit="1/mm", doc="of the released array, at its tip; fitted to set 0"
    )
    curvature_base_per_mm: float = option(
        0.075, low=0.0, high=0.2, unit="1/mm", doc="the same 15 mm behind the tip, quadratic between them as in 02"
    )
    curvature_error: float = option(0.0, low=-0.5, high=0.5, doc="share by which this array curls more than the mean")
    grip_angle_rad: float = option(0.01, low=-0.3, high=0.3, unit="rad", doc="angle at which the assistant grips it")
    axial_stiffness_n: float = option(150.0, low=80.0, high=500.0, unit="N", doc="EA")
    tip_diameter_mm: float = option(0.5, low=0.2, high=1.0, unit="mm", doc="of the array at its tip")
    base_diameter_mm: float = option(0.8, low=0.2, high=1.2, unit="mm", doc="15 mm behind it, linear between them")
    soft_tip_mm: float = option(0.5, low=0.0, high=3.0, unit="mm", doc="s_e: the stylet ends so far before the tip")
    stylet_blend_mm: float = option(1.0, low=0.5, high=3.0, unit="mm", doc="over which the stylet's end lets go")
    stylet_offset_mm: float = option(
        0.0,
        low=-3.0,
        high=3.0,
        unit="mm",
        doc="the stylet was pulled so far while loading; negative: it is hooked late",
    )
    relaxation_s: float = option(0.02, low=0.0, high=0.5, unit="s", doc="Kelvin-Voigt time of bending")
    drag_n_s_per_mm: float = option(1e-5, low=1e-7, high=1e-2, unit="N s/mm", doc="of a node in the fluid")
    stylet_yield_per_mm: float = option(
        0.2, low=0.02, high=5.0, unit="1/mm", doc="bent further from its shape, the stylet stays bent"
    )
    array_yield_per_mm: float = option(
        2.0, low=0.2, high=20.0, unit="1/mm", doc="bent further from its rest curvature, the array stays bent"
    )


@dataclass(frozen=True)
class Inject:
    """Failures to order, each from a time after the first tick on; none by default."""

    axes_silent_after_s: float | None = option(None, low=0.0, unit="s", doc="the encoders stop answering")
    wrench_silent_after_s: float | None = option(None, low=0.0, unit="s", doc="the sensor stops answering")
    wrench_saturated_after_s: float | None = option(None, low=0.0, unit="s", doc="a gauge is at its rail")
    amplifier_fault_after_s: float | None = option(None, low=0.0, unit="s", doc="an amplifier is not ready, no power")
    jam_after_s: float | None = option(None, low=0.0, unit="s", doc="a motor no longer turns")
    jam_axis: int = option(0, low=0, high=3, doc="which motor jams")
    impedance_silent_after_s: float | None = option(None, low=0.0, unit="s", doc="the telemetry stops")
    open_channel_after_s: float | None = option(None, low=0.0, unit="s", doc="the lead of a contact breaks")
    open_channel: int = option(0, low=0, high=21, doc="which contact, counted from the tip; both its pairs read open")
    short_channel_after_s: float | None = option(None, low=0.0, unit="s", doc="a contact touches its pair's other one")
    short_channel: int = option(0, low=0, high=20, doc="which contact; the pair it begins reads next to nothing")


@dataclass(frozen=True)
class Ideal:
    """Parts that shall be without their faults, whatever their own tables say; for tests and studies."""

    drive: bool = option(False, doc="linear motors: current mode without limit, no dry friction; J and drag stay")
    screw: bool = option(False, doc="no friction that grows with the load, no binding of the stylet's rod")
    wire: bool = option(False, doc="no stretch, no lag, no backlash, no misalignment: piston = eta theta")
    geometry: bool = option(False, doc="the robot is as drawn, and its pistons end at zero")
    sensor: bool = option(False, doc="no bias, drift, noise, cross-axis error, filter, steps; weight and inertia stay")
    encoder: bool = option(False, doc="no counts: the true angle since the device was opened")


@dataclass(frozen=True)
class PlantOptions:
    """Everything about the simulated bench."""

    geometry: Geometry
    motor: Motor
    wire: Wire
    stylet: StyletDrive
    sensor: Sensor
    impedance: Impedance
    anatomy: Anatomy
    phantom: Phantom
    bone: Bone
    trial: Trial
    array: Array
    inject: Inject
    ideal: Ideal
    crystal_ppm: float | None = option(
        None,
        low=-500_000.0,
        high=500_000.0,
        unit="ppm",
        doc="the bench has a clock of its own, which runs so much faster than this machine's; for loop.clock = device",
    )
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
