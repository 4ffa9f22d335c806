"""How much of a CAN bus its frames take (07 section 2.4)."""

from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from drivers.epos.options import EposOptions

OVERHEAD_BITS, STUFFABLE_BITS = 47, 34
"""Of a data frame with an 11-bit identifier: all bits but data with the space to the next frame; of these, stuffed."""
FEEDBACK_BYTES = 6
"""Statusword and position."""
SETPOINT_BYTES = {"csp": 6, "ppm": 6, "position": 6, "velocity": 6, "cst": 4, "current": 4}
"""Controlword and set value."""


def plain_bits(data_bytes: int) -> int:
    """A frame without stuff bits."""
    return OVERHEAD_BITS + 8 * data_bytes


def stuffed_bits(data_bytes: int) -> int:
    """A frame with as many stuff bits as there can be: one for the first five equal bits, then one for every four."""
    return plain_bits(data_bytes) + (STUFFABLE_BITS + 8 * data_bytes - 1) // 4


@dataclass(frozen=True)
class BusLoad:
    """Bits of one exchange, and shares of the bus with everybody's heartbeat; `worst` is with worst-case stuffing."""

    plain_bits: int
    stuffed_bits: int
    plain: float
    worst: float

    @classmethod
    def of(cls, bus: "EposOptions", period_s: float) -> "BusLoad":
        """Of a bus as it is set up."""
        frames = [0] + [n for node in bus.nodes for n in (SETPOINT_BYTES[node.mode], FEEDBACK_BYTES)]
        beats = len(bus.nodes) + 1
        plain, worst = (sum(map(bits, frames)) for bits in (plain_bits, stuffed_bits))
        exchanges_per_s = 1.0 / (bus.divisor * period_s)
        beats_per_s = beats * 1e3 / bus.heartbeat_ms
        shares = ((n * exchanges_per_s + bits(1) * beats_per_s) / bus.bitrate for n, bits in ((plain, plain_bits), (worst, stuffed_bits)))  # fmt: skip
        return cls(plain, worst, *shares)
