"""Settings of a Sensoray 526."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from drivers.sensoray526.registers import INPUTS, OUTPUTS, SIZE, WATCHDOG, WATCHDOG_ENABLE, WATCHDOG_INVERTED
from hal import options
from hal.errors import OptionError
from hal.options import option


@dataclass(frozen=True)
class Sensoray526Options:
    """Settings of a device "sensoray526"."""

    base: int = option(0x2C0, low=0x100, high=0xFFC0, doc="I/O address set by the jumpers J1, a multiple of 0x40")
    poll_limit: int = option(
        400, low=1, high=1000, doc="reads of the status register, about 1 µs each, before a scan counts as not done"
    )
    index: bool = option(True, doc="latch the counters at the encoders' index pulses; four accesses more a counter")
    index_edge: str = option("rising", choices=("rising", "falling"), doc="edge of the index that latches")
    loop_back: tuple[float, ...] = option(
        (), shape=(-1,), low=0, high=7, doc="[output, input] wired together as a self-test"
    )
    loop_back_tolerance_v: float = option(
        0.05, low=0.002, high=1.0, unit="V", doc="by how much that input may be off its output"
    )
    watchdog_code: int = option(-1, low=-1, high=7, doc="interval select of the card's watchdog; -1 leaves it off")
    watchdog_interval_s: float = option(
        0.1, low=0.005, high=10.0, unit="s", doc="what the manual says of that code: silence after which it expires"
    )
    watchdog_inverted: bool = option(False, doc="invert the watchdog's output")
    watchdog_pet: tuple[tuple[float, ...], ...] = option(
        (), shape=(-1, 2), low=0, high=0xFFFF, doc="[offset, word] of each write that pets it; none: its control again"
    )
    watchdog_line: int = option(
        -1, low=-1, high=7, doc="input line that is high while the enable chain is open; -1: not wired"
    )


def read_options(table: Mapping[str, Any], where: str, period_s: float) -> Sensoray526Options:
    """Checked settings. Raises OptionError."""
    found = options.read(Sensoray526Options, table, where)
    if found.base % SIZE:
        raise OptionError(f"{where}.base is no address of this card", value=hex(found.base), bound="a multiple of 0x40", remedy="see its jumpers J1")  # fmt: skip
    if found.loop_back and (len(found.loop_back) != 2 or found.loop_back[0] not in range(OUTPUTS) or found.loop_back[1] not in range(INPUTS)):  # fmt: skip
        raise OptionError(f"{where}.loop_back must name an output and an input", value=found.loop_back, bound="[0 .. 3, 0 .. 7]")  # fmt: skip
    for offset, word in found.watchdog_pet:
        if offset % 2 or offset >= SIZE or word % 1:
            raise OptionError(f"{where}.watchdog_pet writes no register", value=(offset, word), bound="an even offset below 0x40, a whole word")  # fmt: skip
    if found.watchdog_code < 0 and (found.watchdog_pet or found.watchdog_line >= 0):
        raise OptionError(f"{where}: the watchdog is off and yet used", value=found.watchdog_code, remedy="set watchdog_code")  # fmt: skip
    if found.watchdog_code >= 0 and found.watchdog_interval_s < 3.0 * period_s:
        raise OptionError(f"{where}.watchdog_interval_s is too short for the loop", value=found.watchdog_interval_s, bound=f"at least {3.0 * period_s:g} s")  # fmt: skip
    return found


def watchdog_word(found: Sensoray526Options) -> int:
    """Control word of the running watchdog."""
    return WATCHDOG_ENABLE | found.watchdog_code | (WATCHDOG_INVERTED if found.watchdog_inverted else 0)


def pets(found: Sensoray526Options) -> tuple[tuple[int, int], ...]:
    """Offset and word of each write that pets the watchdog; none if it is off."""
    if found.watchdog_code < 0:
        return ()
    if not found.watchdog_pet:
        return ((WATCHDOG, watchdog_word(found)),)
    return tuple((int(offset), int(word)) for offset, word in found.watchdog_pet)
