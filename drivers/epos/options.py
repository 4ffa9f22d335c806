"""Settings of a CAN bus with EPOS drives, and what must fit together in them."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from drivers.epos.load import BusLoad
from hal import options
from hal.device import Site
from hal.errors import OptionError
from hal.options import option

MODES = {"epos4": ("csp", "cst", "ppm"), "epos2": ("position", "velocity", "current")}
CURRENT_MODES = ("cst", "current")
HIGHEST_LOAD = 0.8
"""Worst-case share of the bus that a layout may take: the rest is for SDO, emergencies and repeated frames."""


@dataclass(frozen=True)
class NodeOptions:
    """One drive."""

    node: int = option(low=1, high=126, doc="CAN node number, set by the drive's switches")
    axis: int = option(low=0, high=63, doc="number of the axis it turns")
    mode: str = option(
        choices=("csp", "cst", "ppm", "position", "velocity", "current"),
        doc="EPOS4: csp, cst or ppm; EPOS2: position (-1), velocity (-2) or current (-3)",
    )
    counts_per_rad: float = option(low=1.0, high=1e6, unit="1/rad", doc="quadrature counts of one radian of the motor")
    rated_current_a: float = option(low=0.01, high=50.0, unit="A", doc="nominal current of the motor; torques are per mille of its torque")  # fmt: skip
    current_limit_a: float = option(low=0.01, high=50.0, unit="A", doc="current the drive never exceeds")
    max_speed_rad_per_s: float = option(low=0.2, high=5000.0, unit="rad/s", doc="speed the drive never exceeds; an encoder that is faster has jumped")  # fmt: skip
    following_error_rad: float = option(low=0.001, high=1000.0, unit="rad", doc="following error at which the drive faults (6065)")  # fmt: skip
    quick_stop_rad_per_s2: float = option(low=0.2, high=1e6, unit="rad/s^2", doc="deceleration of a quick stop (6085)")
    generation: str = option("epos4", choices=("epos4", "epos2"), doc="of the drive")
    direction: int = option(1, low=-1, high=1, doc="1, or -1 for a motor that counts down when its axis grows")
    gain_a_per_v: float | None = option(None, low=1e-4, high=10.0, unit="A/V", doc="current modes: current of one volt of set value")  # fmt: skip
    gain_rad_per_s_per_v: float | None = option(None, low=1e-3, high=1000.0, unit="rad/(s V)", doc="other modes: speed of one volt of set value")  # fmt: skip
    following_error_ms: int = option(0, low=0, high=1000, unit="ms", doc="how long the following error may last (6066, EPOS4)")  # fmt: skip
    position_limits_rad: tuple[Any, ...] = option((), shape=(-1,), unit="rad", doc="two limits in the position modes (607D), from where the drive is switched on; none without")  # fmt: skip
    rated_current_object: tuple[Any, ...] = option((), shape=(-1,), doc="index and sub-index, if not 3001:1 (EPOS4) or 6410:1 (EPOS2); to be confirmed in the manual")  # fmt: skip
    current_limit_object: tuple[Any, ...] = option((), shape=(-1,), doc="index and sub-index, if not 3001:2 (EPOS4) or 6410:2 (EPOS2); to be confirmed in the manual")  # fmt: skip
    objects: tuple[Any, ...] = option((), shape=(-1, 4), doc="further objects written and read back: [index, sub-index, bytes, value]")  # fmt: skip

    @property
    def by_current(self) -> bool:
        """The set value is a current; else a speed."""
        return self.mode in CURRENT_MODES


@dataclass(frozen=True)
class EposOptions:
    """One bus."""

    channel: str = option(doc='CAN channel, for instance "can0"')
    nodes: tuple = option(shape=(-1,), doc="a table a drive, [[backend.options.devices.nodes]]")
    interface: str = option("socketcan", doc="interface of python-can")
    bitrate: int = option(1_000_000, low=10_000, high=1_000_000, unit="bit/s", doc="of the bus")
    divisor: int = option(2, low=1, high=100, unit="ticks", doc="ticks of the loop to one exchange with the drives")
    master: int = option(127, low=1, high=127, doc="node number of this controller, for its heartbeat")
    heartbeat_ms: int = option(20, low=5, high=500, unit="ms", doc="everybody's heartbeat; a drive is lost after three, and stops by itself after the watchdog's time and two")  # fmt: skip
    quick_stop_ms: int = option(200, low=0, high=5000, unit="ms", doc="time of a quick stop before the voltage is taken away anyhow")  # fmt: skip


def read(name: str, table: Mapping[str, Any], site: Site) -> EposOptions:
    """Checked settings, with :class:`NodeOptions` in `nodes`. Raises OptionError."""
    where = f"device {name}"
    entries = table.get("nodes", ())
    if not isinstance(entries, list | tuple) or not entries:
        raise OptionError(f"{where}.nodes must be a list of tables", value=entries or None, remedy="write [[backend.options.devices.nodes]] once for every drive")  # fmt: skip
    plain = options.read(EposOptions, {**table, "nodes": ()}, where)
    nodes = tuple(_read_node(f"{where}.nodes[{i}]", entry) for i, entry in enumerate(entries))
    for what in ("node", "axis"):
        numbers = [getattr(node, what) for node in nodes]
        if what == "node":
            numbers.append(plain.master)
        if len(set(numbers)) < len(numbers):
            raise OptionError(f"{where}: every {what} must be there once", value=numbers, remedy="the controller's own number is `master`")  # fmt: skip
    result = EposOptions(**{**vars(plain), "nodes": nodes})
    _check_period(where, result, site.period_s)
    load = BusLoad.of(result, site.period_s)
    if load.worst > HIGHEST_LOAD:
        raise OptionError(f"{where}: the bus cannot carry its frames", value=f"{100 * load.worst:.0f} % load", bound=f"at most {100 * HIGHEST_LOAD:.0f} % with worst-case stuffing", remedy="raise the divisor, or use a second bus")  # fmt: skip
    return result


def _check_period(where: str, bus: EposOptions, period_s: float) -> None:
    """The interpolation time 60C2 is a byte of whole milliseconds."""
    period_ms = bus.divisor * period_s * 1e3
    whole = abs(period_ms - round(period_ms)) < 1e-6 and 1 <= round(period_ms) <= 255
    if not whole and any(node.mode == "csp" for node in bus.nodes):
        raise OptionError(f"{where}: a drive interpolates over whole milliseconds", value=f"{period_ms:g} ms", bound="1 .. 255 ms", remedy="change the divisor")  # fmt: skip
    if bus.heartbeat_ms < period_s * 1e3:
        raise OptionError(f"{where}.heartbeat_ms is shorter than a tick", value=bus.heartbeat_ms, bound=f"at least {period_s * 1e3:g} ms")  # fmt: skip


def _read_node(where: str, table: Mapping[str, Any]) -> NodeOptions:
    node = options.read(NodeOptions, table, where)
    if node.mode not in MODES[node.generation]:
        raise OptionError(f"{where}.mode is none of {node.generation}", value=node.mode, bound=" | ".join(MODES[node.generation]), remedy="EPOS2 has no cyclic modes, EPOS4 no modes below zero")  # fmt: skip
    if node.direction == 0:
        raise OptionError(f"{where}.direction is out of bounds", value=0, bound="1 | -1")
    wanted, other = ("gain_a_per_v", "gain_rad_per_s_per_v")[:: 1 if node.by_current else -1]
    if getattr(node, wanted) is None or getattr(node, other) is not None:
        raise OptionError(f"{where}: mode {node.mode} takes {wanted} and not {other}", value={wanted: getattr(node, wanted), other: getattr(node, other)}, remedy=f"set {wanted}")  # fmt: skip
    if node.current_limit_a > 3.0 * node.rated_current_a:
        raise OptionError(f"{where}.current_limit_a is too far above the nominal current", value=node.current_limit_a, bound=f"at most {3 * node.rated_current_a:g} A")  # fmt: skip
    limits = node.position_limits_rad
    if limits and (len(limits) != 2 or limits[0] >= limits[1]):
        raise OptionError(f"{where}.position_limits_rad must be two numbers, the lower first", value=list(limits))
    for name in ("rated_current_object", "current_limit_object"):
        given = getattr(node, name)
        if given and not (len(given) == 2 and _is_object(*given)):
            raise OptionError(f"{where}.{name} must be index and sub-index", value=list(given), bound="0 .. 65535, 0 .. 255")  # fmt: skip
    for index, sub, size, value in node.objects:
        if not (_is_object(index, sub) and size in (1, 2, 4) and value.is_integer() and -(2 ** (8 * size - 1)) <= value < 2 ** (8 * size)):  # fmt: skip
            raise OptionError(f"{where}.objects: no object holds this", value=[index, sub, size, value], bound="index, sub-index, 1 | 2 | 4 bytes, and a whole number that they hold")  # fmt: skip
    return node


def _is_object(index: float, sub: float) -> bool:
    return index.is_integer() and sub.is_integer() and 0 <= index <= 0xFFFF and 0 <= sub <= 0xFF
