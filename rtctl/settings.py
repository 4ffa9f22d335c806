"""Everything that shapes a run: one TOML file in, frozen dataclasses out.

Read it with :func:`load`; override single keys with ``--set a.b=value``, or those of a calibration with ``--set @FILE``
(:func:`override`). Options marked
live can be changed while the controller runs; :mod:`rtctl.parameters` turns them into the record the tick reads.
"""

import hashlib
import json
import tomllib
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from importlib.resources import files
from ipaddress import ip_address
from pathlib import Path
from typing import Any

from hal.errors import OptionError
from hal.options import option, read, table_of
from rtctl import robots
from rtctl.electrode.array_shape import LENGTH_MM
from rtctl.electrode.patient import (
    LARGEST_A_MM,
    RECESS_ANGLE_RAD,
    RECESS_CLEARANCE_MM,
    SIDES,
    SMALLEST_A_MM,
    SPIRAL_A_MM,
)
from rtctl.guidance import detector_file
from rtctl.guidance.impedance import layout, power_law
from rtctl.guidance.layout import REACTIONS

ARRAY_MATRIX = (
    (2.93695392269587e-03, -3.94085203728490e-02, 6.16973009198033e-03, -2.35843234791911e-04),
    (6.26946771319700e-03, 4.90351444182624e-02, -7.18756027501507e-03, 2.64267314493850e-04),
    (1.47679960554564e-03, -1.03290097336955e-02, 1.34216948322671e-03, -4.39002771123580e-05),
    (-7.77889138080976e-05, 5.33535053874115e-04, -5.34787115835697e-05, 1.50893500682453e-06),
)
"""Modal matrix A_1 (02 section 3): the array the planner expects unless told otherwise."""


@dataclass(frozen=True)
class Robot:
    """Which robot, and the controller's model of it."""

    kind: str = option("planar_3rpr", choices=tuple(robots.KINDS), doc="file in rtctl/robots that implements it")
    name: str = option("planar", doc="name in every Zenoh key: rtctl/<name>/...")
    geometry: dict = option({}, doc="geometry and limits; see the robot's own options")


@dataclass(frozen=True)
class Loop:
    """The grid the controller runs on, and what it asks of the machine."""

    period_s: float = option(0.001, low=0.0001, high=0.01, unit="s", doc="time between two ticks")
    clock: str = option("grid", choices=("grid", "device"), doc="who paces the loop: this machine, or the device that tells its time")  # fmt: skip
    device_phase_s: float = option(0.0001, low=0.0, high=0.005, unit="s", doc="with clock = device: a tick is due so long after the device's own")  # fmt: skip
    spin_us: int = option(0, low=0, high=100, unit="us", doc="end of the sleep before a tick that is spent looking at the clock instead")  # fmt: skip
    priority: int = option(80, low=1, high=98, doc="SCHED_FIFO priority of the loop")
    cpu: int = option(-1, low=-1, high=1023, doc="core the loop is bound to; -1 takes the last one")
    allow_best_effort: bool = option(False, doc="arm hardware although the machine does not grant real time")


@dataclass(frozen=True)
class BackendChoice:
    """Which devices."""

    name: str = option("plant", doc="entry point in the group rtctl.backends")
    options: dict = option({}, doc="the backend's own settings; it checks them itself")

    @property
    def device_names(self) -> list[str]:
        """Names of its devices in their order; none where a backend is not made of devices."""
        entries = self.options.get("devices", ())
        return (
            [str(e.get("name")) for e in entries if isinstance(e, Mapping)] if isinstance(entries, list | tuple) else []
        )


@dataclass(frozen=True)
class Wrench:
    """Filter, gravity and bias of the force/torque sensor (D III.57, 05 section 1)."""

    filter: str = option(
        "butterworth", choices=("butterworth", "moving_average"), live=True, doc="low-pass of every component"
    )
    cutoff_hz: float = option(8.0, low=0.5, high=200.0, unit="Hz", live=True, doc="of the second-order Butterworth")
    window_s: float = option(0.025, low=0.002, high=0.1, unit="s", live=True, doc="of the moving average")
    gravity_force_in_base_n: tuple[float, ...] = option(
        (0.0, 0.0, 0.0),
        shape=(3,),
        low=-50,
        high=50,
        unit="N",
        doc="weight of the insertion module in {B}, from calibration",
    )
    centre_of_mass_in_sensor_mm: tuple[float, ...] = option(
        (0.0, 0.0, 0.0), shape=(3,), low=-500, high=500, unit="mm", doc="its centre of mass in {F}"
    )
    unbias_s: float = option(0.5, low=0.05, high=10.0, unit="s", doc="averaging time of `unbias`")


@dataclass(frozen=True)
class Admittance:
    """Hybrid position/force law (03 section 3)."""

    lateral: bool = option(True, live=True, doc="correct the path across the insertion axis")
    deadband_n: float = option(0.03, low=0.0, high=1.0, unit="N", live=True, doc="zeta: forces below it are noise")
    lateral_gain_mm_per_n_s: float = option(20.0, low=0.0, high=200.0, unit="mm/(N s)", live=True, doc="K_a")
    lateral_limit_mm: float = option(
        5.0, low=0.1, high=10.0, unit="mm", live=True, doc="beta: radius of the correction"
    )
    project_first: bool = option(False, live=True, doc="project on the lateral plane before the deadband, not after")
    stylet: bool = option(False, live=True, doc="pull the stylet faster when the array meets resistance")
    stylet_gain_mm_per_n_s: float = option(50.0, low=0.0, high=200.0, unit="mm/(N s)", live=True, doc="K_i")
    regulated_force_n: float = option(
        -0.1, low=-1.0, high=0.0, unit="N", live=True, doc="f_reg, negative for resistance; not printed in the sources"
    )
    blend_start_mm: float = option(4.0, low=0.0, high=20.0, unit="mm", live=True, doc="gamma_1: the stylet law begins")
    blend_end_mm: float = option(
        7.0, low=0.1, high=20.0, unit="mm", live=True, doc="gamma_2: the stylet law is fully on"
    )


@dataclass(frozen=True)
class Trajectory:
    """Task-space limits of every motion."""

    speed_mm_per_s: float = option(8.0, low=0.1, high=50.0, unit="mm/s", live=True, doc="translations")
    acceleration_mm_per_s2: float = option(40.0, low=1.0, high=2000.0, unit="mm/s^2", live=True, doc="translations")
    jerk_mm_per_s3: float = option(400.0, low=10.0, high=50000.0, unit="mm/s^3", live=True, doc="translations")
    speed_rad_per_s: float = option(0.15, low=0.001, high=2.0, unit="rad/s", live=True, doc="rotations")
    acceleration_rad_per_s2: float = option(0.8, low=0.01, high=50.0, unit="rad/s^2", live=True, doc="rotations")
    jerk_rad_per_s3: float = option(8.0, low=0.1, high=1000.0, unit="rad/s^3", live=True, doc="rotations")
    depth_speed_mm_per_s: float = option(
        3.0, low=0.05, high=5.0, unit="mm/s", live=True, doc="fastest insertion or retraction a client may ask for"
    )
    depth_acceleration_mm_per_s2: float = option(
        4.0, low=0.1, high=100.0, unit="mm/s^2", live=True, doc="along the path"
    )
    depth_jerk_mm_per_s3: float = option(40.0, low=1.0, high=5000.0, unit="mm/s^3", live=True, doc="along the path")
    stream_limit_s: float = option(
        0.05, low=0.01, high=0.1, unit="s", doc="silence after which a servo stream ends in a controlled stop"
    )
    entry_tolerance_mm: float = option(
        0.5, low=0.01, high=5.0, unit="mm", doc="how far from the plan's first pose an insertion may begin"
    )


@dataclass(frozen=True)
class Control:
    """PID on motor angles with backlash compensation; one number an axis, the stylet's last."""

    proportional_v_per_rad: tuple[float, ...] = option(
        (0.5, 0.5, 0.5, 0.5), shape=(-1,), low=0, high=1000, unit="V/rad", live=True, doc="K_p"
    )
    integral_v_per_rad_s: tuple[float, ...] = option(
        (1.0, 1.0, 1.0, 1.0), shape=(-1,), low=0, high=10000, unit="V/(rad s)", live=True, doc="K_i"
    )
    derivative_v_s_per_rad: tuple[float, ...] = option(
        (0.01, 0.01, 0.01, 0.01),
        shape=(-1,),
        low=0,
        high=100,
        unit="V s/rad",
        live=True,
        doc="K_d, on the filtered rate of the error",
    )
    feedforward_v_s_per_rad: tuple[float, ...] = option(
        (0.0, 0.0, 0.0, 0.0),
        shape=(-1,),
        low=0,
        high=100,
        unit="V s/rad",
        live=True,
        doc="volts for a rad/s of reference",
    )
    derivative_cutoff_hz: float = option(
        80.0, low=5.0, high=400.0, unit="Hz", live=True, doc="first-order filter of the rate"
    )
    integral_limit_v: float = option(3.0, low=0.0, high=10.0, unit="V", live=True, doc="largest share of the integral")
    command_limit_v: float = option(8.0, low=0.1, high=10.0, unit="V", live=True, doc="largest set value")
    command_slew_v_per_s: float = option(
        2000.0, low=1.0, high=20000.0, unit="V/s", live=True, doc="largest change against the previous command"
    )
    backlash_rad: tuple[float, ...] = option(
        (0.0, 0.0, 0.0, 0.0),
        shape=(-1,),
        low=0,
        high=20,
        unit="rad",
        live=True,
        doc="chi_1 - chi_0 of every axis (05 section 4)",
    )
    backlash_rate_rad_per_s: float = option(
        40.0, low=1.0, high=1000.0, unit="rad/s", live=True, doc="how fast the compensation changes sides"
    )


@dataclass(frozen=True)
class Stylet:
    """The stylet drive of the insertion module."""

    lead_mm_per_rad: float = option(0.05, low=0.001, high=1.0, unit="mm/rad", doc="screw lead")
    stroke_mm: float = option(
        15.0, low=1.0, high=15.0, unit="mm", doc="withdrawal beyond it no longer changes the array"
    )
    speed_mm_per_s: float = option(4.0, low=0.1, high=20.0, unit="mm/s", doc="fastest withdrawal")


@dataclass(frozen=True)
class Homing:
    """Every motor runs slowly towards its retracted end stop until it stalls."""

    speed_rad_per_s: float = option(25.0, low=1.0, high=200.0, unit="rad/s", doc="speed of every motor")
    command_limit_v: float = option(1.5, low=0.1, high=5.0, unit="V", doc="how hard a motor may push the stop")
    stall_s: float = option(0.3, low=0.05, high=2.0, unit="s", doc="standstill that counts as the stop")
    timeout_s: float = option(40.0, low=1.0, high=300.0, unit="s", doc="homing fails after this time")


@dataclass(frozen=True)
class Safety:
    """Bounds behind the condition table of rtctl/lifecycle.py."""

    following_error_rad: float = option(
        6.0, low=0.1, high=100.0, unit="rad", doc="largest distance of a motor from its reference"
    )
    force_limit_n: float = option(
        0.5, low=0.05, high=5.0, unit="N", live=True, doc="force that pauses a motion with a loaded array"
    )
    drift_limit_n: float = option(
        0.05,
        low=0.01,
        high=1.0,
        unit="N",
        live=True,
        doc="force with a loaded array outside the cochlea that is told as drift",
    )
    drift_s: float = option(1.0, low=0.1, high=60.0, unit="s", doc="how long it must last")
    axes_age_ticks: int = option(5, low=1, high=100, unit="ticks", doc="oldest motor angles that may be used")
    wrench_age_ticks: int = option(
        20, low=1, high=200, unit="ticks", doc="oldest wrench that may be used while an array is moved"
    )
    power_on_ticks: int = option(500, low=10, high=5000, unit="ticks", doc="time the amplifiers have to come up")
    overrun_ticks: int = option(40, low=1, high=1000, unit="ticks", doc="missed ticks in one gap that pause the motion")
    overrun_window_s: float = option(1.0, low=0.1, high=60.0, unit="s", doc="missed ticks are counted over windows of this length, one after the other")  # fmt: skip
    overrun_share: float = option(0.1, low=0.001, high=1.0, doc="share of the ticks of a window whose loss pauses the motion; 1 never does")  # fmt: skip
    overrun_windows: int = option(5, low=1, high=1000, doc="so many windows like that in a row remove power")
    heartbeat_ticks: int = option(
        500, low=50, high=5000, unit="ticks", doc="silence of the gateway that pauses the motion"
    )


@dataclass(frozen=True)
class Electrode:
    """The planner's model of the array (02 section 2)."""

    modal_matrix: tuple[tuple[float, ...], ...] = option(
        ARRAY_MATRIX, shape=(4, 4), low=-10, high=10, unit="rad / mm^k", doc="A of theta(s, q) = psi(s)^T A eta(q)"
    )
    length_mm: float = option(
        LENGTH_MM,
        low=5.0,
        high=30.0,
        unit="mm",
        doc="from the grip to the tip; the model of its shape knows this one only",
    )


@dataclass(frozen=True)
class Cochlea:
    """The planner's model of the patient (02 sections 1 and 5; II.1, II.2)."""

    spiral_a_mm: float = option(
        SPIRAL_A_MM, low=SMALLEST_A_MM, high=LARGEST_A_MM, unit="mm", doc="A of its spiral, which scales all of it"
    )
    side: str = option(
        "right", choices=SIDES, doc="ear; for a left one the robot is mounted turned over about x of {B}"
    )
    recess_angle_rad: float = option(
        RECESS_ANGLE_RAD,
        low=0.1,
        high=0.6,
        unit="rad",
        doc="the gripper turns, and the array passes the facial recess, so far to either side of the registered direction",
    )
    recess_clearance_mm: float = option(
        RECESS_CLEARANCE_MM,
        low=0.3,
        high=10.0,
        unit="mm",
        doc="half width of the facial recess, which is where that cone is as wide",
    )


@dataclass(frozen=True)
class Guidance:
    """Detection of buckling and of tip folding (03 sections 4 to 6)."""

    detector: str = option("", doc="file of `rtctl detector train`; without one nothing is watched")
    model: dict = option({}, doc="content of that file, put here when settings are read; leave it out")
    tip_fold: str = option("warn", choices=tuple(REACTIONS), live=True, doc="reaction to a folding tip; retract: pause, and nothing but a retraction until the array is out")  # fmt: skip
    buckling: str = option("warn", choices=tuple(REACTIONS), live=True, doc="reaction to buckling outside the cochlea")
    margin: float = option(
        0.75,
        low=0.0,
        high=1.0,
        live=True,
        doc="rho: share of the doubt about h that must be overcome to call it a fold",
    )
    two_sided: bool = option(False, live=True, doc="unusually low forces count as buckling, too, as printed in (VI.12)")


@dataclass(frozen=True)
class Impedance:
    """Guidance of the stylet by the bipolar impedance of the contacts (04 section 4)."""

    guidance: bool = option(False, live=True, doc="a lost impedance pulls the stylet; needs bias_ohm")
    mode: str = option(
        "continuous", choices=tuple(layout.MODES), doc="correct in passing, or where the insertion rests"
    )
    interval_mm: float = option(0.5, low=0.1, high=2.0, unit="mm", doc="of insertion between two evaluations")
    step_limit_mm: float = option(1.0, low=0.0, high=1.0, unit="mm", live=True, doc="largest step of one evaluation")
    pair_step: int = option(1, low=1, high=2, doc="1: contacts (i, i + 1), 21 pairs; 2: (i, i + 2), 20 pairs")
    first_contact_mm: float = option(
        0.6, low=0.0, high=5.0, unit="mm", doc="from the tip to the middle of the first contact"
    )
    pitch_mm: float = option(0.62, low=0.1, high=1.5, unit="mm", doc="Delta s, between neighbouring contacts")
    bias_ohm: tuple[float, ...] = option(
        (), shape=(-1,), low=-5000.0, high=5000.0, unit="ohm", doc="r of every pair, from `rtctl calibrate saline`"
    )
    left_out: tuple[float, ...] = option(
        (), shape=(-1,), low=0, high=layout.PAIRS - 1, doc="pairs that never guide, the one at the tip is 0"
    )
    factor_ohm: float = option(power_law.FACTOR_OHM, low=1.0, high=1e4, unit="ohm", doc="a of z = a A^b + c, A in mm^2")
    exponent: float = option(power_law.EXPONENT, low=-3.0, high=-0.1, doc="b of the power law")
    far_field_ohm: float = option(power_law.FAR_FIELD_OHM, low=0.0, high=1e4, unit="ohm", doc="c of the power law")
    area_max_mm2: float = option(
        power_law.AREA_MAX_MM2, low=0.05, high=5.0, unit="mm^2", doc="no area in the cochlea is larger"
    )
    open_ohm: float = option(20_000.0, low=5000.0, high=28_500.0, unit="ohm", doc="a pair that reads so much is open")
    short_ohm: float = option(500.0, low=0.0, high=1100.0, unit="ohm", doc="a pair that reads less is shorted")
    noise_limit_ohm: float = option(800.0, low=50.0, high=5000.0, unit="ohm", doc="a pair this noisy (rms) is left out")
    pair_age_s: float = option(2.8, low=0.1, high=30.0, unit="s", doc="oldest sample of a pair that counts")
    link_age_s: float = option(0.5, low=0.1, high=5.0, unit="s", doc="silence of the telemetry that ends guidance")
    least_pairs: int = option(3, low=1, high=layout.PAIRS, doc="with fewer usable pairs the law stands still")
    when_blind: str = option(
        "note", choices=layout.BLIND_REACTIONS, live=True, doc="reaction when it has to stand still"
    )


@dataclass(frozen=True)
class Gateway:
    """The process between shared memory and the network."""

    endpoint: str = option("tcp/127.0.0.1:7447", doc="Zenoh locator the daemon listens on; loopback unless secured")
    state_rate_hz: float = option(50.0, low=1.0, high=200.0, unit="Hz", doc="rate of the state keys")
    lease_s: float = option(1.0, low=0.2, high=30.0, unit="s", doc="a lease dies after this silence of its holder")
    payload_limit_bytes: int = option(
        65536, low=1024, high=1048576, unit="bytes", doc="larger requests are refused unread"
    )
    user: str = option("", doc="user name, needed with a password for anything wider than loopback")
    password: str = option("", doc="password of that user; never shown, never logged")


@dataclass(frozen=True)
class Log:
    """The MCAP file of a run."""

    directory: str = option("runs", doc="every run makes a folder of its own in here")
    chunk_kib: int = option(192, low=16, high=1024, unit="KiB", doc="what a killed process can lose at most")
    ring_rows: int = option(
        8192, low=1024, high=65536, unit="rows", doc="records shared memory holds until they are logged"
    )


@dataclass(frozen=True)
class Workflow:
    """The scripted insertion of `rtctl demo` and `rtctl sim` (I section II-C)."""

    entry_pose_mm_rad: tuple[float, ...] = option(
        (173.0, 2.0, 0.0),
        shape=(-1,),
        low=-1000,
        high=1000,
        unit="mm, rad",
        doc="where the surgeon points the empty gripper: the entry, along the approach",
    )
    retracted_pose_mm_rad: tuple[float, ...] = option(
        (152.0, 0.0, 0.0),
        shape=(-1,),
        low=-1000,
        high=1000,
        unit="mm, rad",
        doc="clear of the patient, to load the array",
    )
    depth_mm: float = option(15.0, low=0.5, high=15.0, unit="mm", doc="insertion depth; 13.8 mm is lambda = 1")
    speed_mm_per_s: float = option(1.0, low=0.05, high=5.0, unit="mm/s", doc="insertion speed")
    hold_s: float = option(2.0, low=0.0, high=60.0, unit="s", doc="rest at full depth before the end")


@dataclass(frozen=True)
class Settings:
    """The whole configuration of a run."""

    robot: Robot
    loop: Loop
    backend: BackendChoice
    wrench: Wrench
    admittance: Admittance
    trajectory: Trajectory
    control: Control
    stylet: Stylet
    homing: Homing
    safety: Safety
    electrode: Electrode
    cochlea: Cochlea
    guidance: Guidance
    impedance: Impedance
    gateway: Gateway
    log: Log
    workflow: Workflow


def load(path: str | Path, overrides: Iterable[str] = ()) -> Settings:
    """Read, override and check a settings file; a bare name finds the files that ship with rtctl.

    Raises:
        OptionError: missing file, broken TOML, unknown key, wrong type or value out of bounds.
    """
    table = read_toml(find(path))
    for assignment in overrides:
        override(table, assignment)
    return from_table(table)


def read_toml(file: Path) -> dict[str, Any]:
    """The table in a file of settings, unchecked. Raises OptionError if it cannot be read or is not TOML."""
    try:
        return tomllib.loads(file.read_text())
    except OSError as error:
        raise OptionError("the settings file cannot be read", value=str(file), remedy=str(error.strerror)) from None
    except ValueError as error:  # also of bytes that are no text, and of a name that is none
        raise OptionError(f"{file} is not valid TOML", value=str(error), remedy="correct the line it names") from None


def from_table(table: Mapping[str, Any]) -> Settings:
    """Settings from a parsed table, checked as a whole."""
    settings = _with_detector(read(Settings, table))
    _check(settings)
    return settings


def _with_detector(settings: Settings) -> Settings:
    """The settings with the content of the detector they name, so that whoever has the settings has that, too.

    Raises DetectorError if it cannot be read, or is not one for this version.
    """
    guidance = settings.guidance
    if guidance.detector and not guidance.model:
        guidance = replace(guidance, model=detector_file.read_table(guidance.detector))
    if guidance.model:
        detector_file.from_table(guidance.model)
    return replace(settings, guidance=guidance)


def find(path: str | Path) -> Path:
    """The file at `path`, or the one that ships under that name."""
    file = Path(path)
    if file.is_file():
        return file
    shipped = Path(str(files("config"))) / f"{file.name.removesuffix('.toml')}.toml"
    if str(path) == file.name and shipped.is_file():
        return shipped
    known = sorted(p.stem for p in shipped.parent.glob("*.toml"))
    raise OptionError("no such settings file", value=str(path), remedy=f"give a path, or one of {', '.join(known)}")


def override(table: dict[str, Any], assignment: str) -> None:
    """Apply one ``a.b.c=value`` (TOML value; bare words are strings), or a TOML file as ``@FILE``, to a parsed table."""
    if assignment.startswith("@"):
        _put_on_top(table, read_toml(Path(assignment[1:])))
        return
    key, sign, text = assignment.partition("=")
    if not sign or not key.strip():
        raise OptionError("an override must read key=value or @FILE", value=assignment, remedy="for instance loop.priority=70")  # fmt: skip
    try:
        value = tomllib.loads(f"value = {text}")["value"]
    except tomllib.TOMLDecodeError:
        value = text
    *path, last = key.strip().split(".")
    for name in path:
        table = table.setdefault(name, {})
        if not isinstance(table, dict):
            raise OptionError(f"{key} is not inside a table", value=name, remedy="see `rtctl config show`")
    table[last] = value


def _put_on_top(table: dict[str, Any], upper: Mapping[str, Any]) -> None:
    """Every value of `upper` in its place in `table`; tables are merged, lists replaced."""
    for name, value in upper.items():
        below = table.get(name)
        if isinstance(value, dict) and isinstance(below, dict):
            _put_on_top(below, value)
        else:
            table[name] = value


def public_table(settings: Settings) -> dict[str, Any]:
    """The settings as a plain table without secrets: what goes into logs and `config show`."""
    table = table_of(settings)
    if table["gateway"]["password"]:
        table["gateway"]["password"] = "***"
    return table


def config_hash(settings: Settings) -> str:
    """Sixteen hex digits of everything that shaped the run, secrets excluded."""
    return hashlib.sha256(json.dumps(public_table(settings), sort_keys=True).encode()).hexdigest()[:16]


def _check(s: Settings) -> None:
    """Bounds that take more than one option."""
    robot = robots.load(s.robot.kind, s.robot.geometry)
    axes = robot.dof + 1
    for name in ("proportional_v_per_rad", "integral_v_per_rad_s", "derivative_v_s_per_rad", "feedforward_v_s_per_rad", "backlash_rad"):  # fmt: skip
        values = getattr(s.control, name)
        if len(values) != axes:
            raise OptionError(f"control.{name} needs one value an axis", value=list(values), bound=f"{axes} values")
    for name in ("entry_pose_mm_rad", "retracted_pose_mm_rad"):
        pose = getattr(s.workflow, name)
        if len(pose) != robot.dof:
            raise OptionError(f"workflow.{name} needs {robot.dof} numbers", value=list(pose))
        problem = robot.explain(pose)
        if problem is not None:
            raise OptionError(f"workflow.{name}: {problem.what}", value=problem.value, bound=problem.bound, remedy=problem.remedy)  # fmt: skip
    if s.loop.clock == "device" and s.loop.device_phase_s >= s.loop.period_s:
        raise OptionError("loop.device_phase_s is not inside a period", value=s.loop.device_phase_s, bound=f"below loop.period_s = {s.loop.period_s:g}")  # fmt: skip
    if s.loop.spin_us * 1e-6 > s.loop.period_s / 4:
        raise OptionError("loop.spin_us takes too much of a period", value=s.loop.spin_us, bound=f"a quarter of loop.period_s = {s.loop.period_s:g}", remedy="a core that never sleeps is stopped by the kernel")  # fmt: skip
    if s.admittance.blend_end_mm <= s.admittance.blend_start_mm:
        raise OptionError("admittance.blend_end_mm must be larger than blend_start_mm", value=s.admittance.blend_end_mm, bound=f"above {s.admittance.blend_start_mm}")  # fmt: skip
    if s.electrode.length_mm != LENGTH_MM:
        raise OptionError("the model of the array's shape is of one length", value=s.electrode.length_mm, bound=f"electrode.length_mm = {LENGTH_MM:g}", remedy="leave it out; arrays of other lengths cannot be planned yet")  # fmt: skip
    _check_impedance(s)
    if s.workflow.speed_mm_per_s > s.trajectory.depth_speed_mm_per_s:
        raise OptionError("workflow.speed_mm_per_s is faster than allowed", value=s.workflow.speed_mm_per_s, bound=f"at most trajectory.depth_speed_mm_per_s = {s.trajectory.depth_speed_mm_per_s}")  # fmt: skip
    _check_guidance(s)
    if not s.robot.name.replace("-", "").replace("_", "").isalnum():
        raise OptionError("robot.name must be one word", value=s.robot.name, bound="letters, digits, - and _")
    if not _is_loopback(s.gateway.endpoint) and not (s.gateway.user and s.gateway.password):
        raise OptionError("gateway.endpoint is reachable from outside", value=s.gateway.endpoint, bound="loopback, or user and password", remedy="use tcp/127.0.0.1:PORT, or set gateway.user and gateway.password")  # fmt: skip


def _check_guidance(s: Settings) -> None:
    """Reactions need a detector."""
    g = s.guidance
    if g.detector:
        return
    if g.model:
        raise OptionError("guidance.model belongs to a detector", remedy="name its file with guidance.detector, and leave out model")  # fmt: skip
    for name in ("tip_fold", "buckling"):
        if getattr(g, name) != "warn":
            raise OptionError(f"guidance.{name} has nothing to react to", value=getattr(g, name), bound="warn without a detector", remedy="name one with guidance.detector")  # fmt: skip


def _check_impedance(s: Settings) -> None:
    """The pairs must be on the array and calibrated, and only one law may pull the stylet."""
    z = s.impedance
    pairs = layout.CONTACTS - z.pair_step
    basal_mm = z.first_contact_mm + z.pitch_mm * (layout.CONTACTS - 1)
    if basal_mm > s.electrode.length_mm:
        raise OptionError("the last contact is not on the array", value=f"{basal_mm:g} mm", bound=f"electrode.length_mm = {s.electrode.length_mm:g}", remedy="lower impedance.first_contact_mm or pitch_mm")  # fmt: skip
    if z.bias_ohm and len(z.bias_ohm) != pairs:
        raise OptionError("impedance.bias_ohm needs one number a pair", value=f"{len(z.bias_ohm)} numbers", bound=f"{pairs} with pair_step = {z.pair_step}", remedy="calibrate again with this pair_step")  # fmt: skip
    for k in z.left_out:
        if k != int(k) or k >= pairs:
            raise OptionError("impedance.left_out names a pair there is not", value=k, bound=f"whole, 0 .. {pairs - 1}")
    if not z.guidance:
        return
    if not z.bias_ohm:
        raise OptionError("impedance.guidance needs impedance.bias_ohm", value="none", bound=f"{pairs} numbers", remedy="run `rtctl calibrate saline` with this array")  # fmt: skip
    if pairs - len(set(z.left_out)) < z.least_pairs:
        raise OptionError("impedance.left_out leaves too few pairs", value=pairs - len(set(z.left_out)), bound=f"at least least_pairs = {z.least_pairs}")  # fmt: skip
    if s.admittance.stylet:
        raise OptionError("the stylet follows one law, by force or by impedance", value="both are on", remedy="set admittance.stylet or impedance.guidance to false")  # fmt: skip


def _is_loopback(endpoint: str) -> bool:
    """True if nobody outside this machine can reach a Zenoh locator such as tcp/127.0.0.1:7447."""
    address = endpoint.partition("/")[2]
    if any(mark in address for mark in "?#;,"):  # options of a locator may name other interfaces
        return False
    host = address.rpartition(":")[0].strip("[]")
    try:
        return ip_address(host).is_loopback
    except ValueError:
        return host == "localhost"
