"""What is written to a drive before it may move, and read back: safety settings and process data (07 section 2.3)."""

import math
from dataclasses import dataclass

from drivers.epos.options import EposOptions, NodeOptions
from hal.device import Site

MODE_NUMBERS = {"ppm": 1, "csp": 8, "cst": 10, "position": -1, "velocity": -2, "current": -3}
SETPOINTS = {
    "ppm": 0x607A0020, "csp": 0x607A0020, "cst": 0x60710010,
    "position": 0x20620020, "velocity": 0x206B0020, "current": 0x20300010,
}  # fmt: skip
"""Mapping entry of the set value: index, sub-index, bits."""
CONTROLWORD, STATUSWORD, POSITION = 0x60400010, 0x60410010, 0x60640020
CONTROLWORD_OBJECT, STATUSWORD_OBJECT, FAULT_CODE, SUPPORTED_MODES = 0x6040, 0x6041, 0x603F, 0x6502
COB_INVALID = 1 << 31
COB_MASK = COB_INVALID | 0x7FF
"""Bit 30 forbids remote requests: drives set it as they like."""
EVERY_SYNC = 1
SYNC_COB, NMT_COB, EMERGENCY_COB, FEEDBACK_COB, SETPOINT_COB, HEARTBEAT_COB = 0x080, 0x000, 0x080, 0x180, 0x200, 0x700
PDO_PAIRS = 4
LOST_HEARTBEATS = 3
QUICK_STOP, QUICK_STOP_RAMP, RAMP_THEN_OFF = 3, 2, 2
"""Values of 6007, 605E and 605A."""
PER_MINUTE = 30.0 / math.pi
LOWEST, HIGHEST = -(2**31), 2**31 - 1


@dataclass(frozen=True)
class Setting:
    """One object with the value it must hold.

    size: bytes; negative for a signed number. mask: bits that are read back. fixed: only looked at, since it is so in every
    drive that nobody has changed, and drives may refuse to have it written.
    """

    index: int
    sub: int
    size: int
    value: int
    mask: int = -1
    fixed: bool = False

    def __str__(self) -> str:
        return f"{self.index:04X}:{self.sub}"

    def held_by(self, value: int) -> bool:
        """Whether a value that was read back is the one written."""
        return (value ^ self.value) & self.mask == 0

    def pack(self) -> bytes:
        """As it travels."""
        return self.value.to_bytes(abs(self.size), "little", signed=self.size < 0)


def consumer_ms(bus: EposOptions, watchdog_s: float) -> int:
    """Silence of the controller after which a drive stops by itself: longer than the backend's own watchdog allows."""
    return max(LOST_HEARTBEATS * bus.heartbeat_ms, round(watchdog_s * 1e3) + 2 * bus.heartbeat_ms)


def safety_settings(bus: EposOptions, node: NodeOptions, site: Site) -> list[Setting]:
    """In the order they are written."""
    epos4 = node.generation == "epos4"
    low, high = position_limits(node)
    size = 4 if epos4 else 2
    motor = 0x3001 if epos4 else 0x6410
    rated, rated_sub = node.rated_current_object or (motor, 1)
    limit, limit_sub = node.current_limit_object or (motor, 2)
    settings = [
        Setting(0x1005, 0, 4, SYNC_COB, 0x7FF, fixed=True),
        Setting(0x1014, 0, 4, EMERGENCY_COB + node.node, COB_MASK, fixed=True),
        Setting(0x1016, 1, 4, bus.master << 16 | consumer_ms(bus, site.watchdog_ticks * site.period_s)),
        Setting(0x1017, 0, 2, bus.heartbeat_ms),
        Setting(0x6007, 0, -2, QUICK_STOP),
        Setting(0x605A, 0, -2, RAMP_THEN_OFF),
        Setting(0x605E, 0, -2, QUICK_STOP_RAMP),
        Setting(0x6065, 0, 4, max(1, round(node.following_error_rad * node.counts_per_rad))),
        Setting(0x607D, 1, -4, low),
        Setting(0x607D, 2, -4, high),
        Setting(0x6085, 0, 4, round(node.quick_stop_rad_per_s2 * PER_MINUTE)),
        Setting(0x6080 if epos4 else 0x607F, 0, 4, round(node.max_speed_rad_per_s * PER_MINUTE)),
        Setting(int(rated), int(rated_sub), size, round(node.rated_current_a * 1e3)),
        Setting(int(limit), int(limit_sub), size, round(node.current_limit_a * 1e3)),
        Setting(0x6060, 0, -1, MODE_NUMBERS[node.mode]),
    ]
    if epos4:
        settings.append(Setting(0x6066, 0, 2, node.following_error_ms))
    if node.mode == "csp":
        settings += [Setting(0x60C2, 1, 1, round(bus.divisor * site.period_s * 1e3)), Setting(0x60C2, 2, -1, -3)]
    return settings + [Setting(int(i), int(s), int(-n if v < 0 else n), int(v)) for i, s, n, v in node.objects]


def position_limits(node: NodeOptions) -> tuple[int, int]:
    """In counts of the drive, which may count the other way round."""
    if not node.position_limits_rad:
        return LOWEST, HIGHEST
    low, high = sorted(round(node.direction * limit * node.counts_per_rad) for limit in node.position_limits_rad)
    return max(low, LOWEST), min(high, HIGHEST)


def process_data(node: NodeOptions) -> list[Setting]:
    """The remap in the order that drives demand: PDO invalid, count 0, entries, count, COB-ID valid."""
    settings = [
        Setting(parameters + number, 1, 4, cob + (number << 8) + node.node | COB_INVALID, COB_MASK)
        for number in range(PDO_PAIRS)
        for parameters, cob in ((0x1400, SETPOINT_COB), (0x1800, FEEDBACK_COB))
    ]
    for parameters, mapping, cob, entries in (
        (0x1400, 0x1600, SETPOINT_COB, (CONTROLWORD, SETPOINTS[node.mode])),
        (0x1800, 0x1A00, FEEDBACK_COB, (STATUSWORD, POSITION)),
    ):
        settings.append(Setting(mapping, 0, 1, 0))
        settings += [Setting(mapping, sub, 4, entry) for sub, entry in enumerate(entries, 1)]
        settings.append(Setting(mapping, 0, 1, len(entries)))
        settings.append(Setting(parameters, 2, 1, EVERY_SYNC))
        settings.append(Setting(parameters, 1, 4, cob + node.node, COB_MASK))
    return settings
