"""The layout "ICZ1": one sample in 48 bytes, big-endian, with sequence, run and CRC-32 (07 section 4)."""

import math
import struct
import zlib
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from drivers.cim.sample import ELECTRODES, MONOPOLAR, OHM_MAX, Refusal, Sample
from hal import options

MAGIC, VERSION = b"ICZ1", 1
LAYOUT = struct.Struct(">4sBBHIIQBBBBffIII")
"""magic, version, flags, length, run, sequence, time [us], active, return, position, sweep length, ohm, degrees, sweep, 0, CRC"""
SIZE = LAYOUT.size
OPEN, SHORT, COMPLIANCE, SWEEP_START, SIMULATED = 1, 2, 4, 8, 16
"""The flags."""


@dataclass(frozen=True)
class Icz1Options:
    """The layout has no options."""


class Icz1:
    """See :class:`drivers.cim.sample.Decoder`."""

    options_type = Icz1Options

    def __init__(self, table: Mapping[str, Any] | None = None, where: str = "decoder_options") -> None:
        options.read(Icz1Options, table or {}, where)

    def decode(self, data: memoryview) -> Sample | Refusal:
        """The sample in a datagram."""
        if len(data) != SIZE:
            return Refusal.LENGTH
        (magic, version, flags, length, run, sequence, time_us, active, back, position, sweep_length, ohm, degrees, sweep,
         _, crc) = LAYOUT.unpack(data)  # fmt: skip
        if magic != MAGIC:
            return Refusal.MAGIC
        if version != VERSION:
            return Refusal.VERSION
        if length != SIZE:
            return Refusal.LENGTH
        if zlib.crc32(data[: SIZE - 4]) != crc:
            return Refusal.CHECKSUM
        electrodes_exist = 1 <= active <= ELECTRODES and 0 <= back <= ELECTRODES and back != active
        if not (electrodes_exist and position < sweep_length and 0.0 < ohm <= OHM_MAX):  # NaN is in no range
            return Refusal.RANGE
        return Sample(
            time_us, active, ohm, back, run, sequence, position, sweep_length, sweep, degrees,
            bool(flags & OPEN), bool(flags & SHORT), bool(flags & COMPLIANCE), bool(flags & SIMULATED),
        )  # fmt: skip


def encode(sample: Sample) -> bytes:
    """The datagram of a sample in which nothing but the phase may be missing.

    Raises:
        ValueError: a field is missing or does not fit.
    """
    s = sample
    if s.run is None or s.sequence is None or s.position is None or s.sweep_length is None:
        raise ValueError("ICZ1 needs run, sequence, position and length of the sweep")
    flags = OPEN * s.is_open | SHORT * s.is_short | COMPLIANCE * s.at_compliance | SIMULATED * s.is_simulated
    flags |= SWEEP_START * (s.position == 0)
    back = MONOPOLAR if s.back is None else s.back
    if not math.isfinite(s.ohm):
        raise ValueError("ICZ1 carries finite magnitudes")
    try:
        body = LAYOUT.pack(
            MAGIC, VERSION, flags, SIZE, s.run, s.sequence, s.time_us, s.active, back, s.position, s.sweep_length,
            s.ohm, s.phase_deg, s.sweep, 0, 0,
        )[: SIZE - 4]  # fmt: skip
    except (struct.error, OverflowError) as error:
        raise ValueError(f"a field does not fit into ICZ1: {error}") from None
    return body + zlib.crc32(body).to_bytes(4, "big")
