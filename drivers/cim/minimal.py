"""The layout "minimal": time, electrode and magnitude in 20 bytes, for senders that tell no more (07 section 4 [U]).

float64 time [s], int32 electrode, float64 magnitude [ohm], nothing between them. It has no checksum, no number and no run:
a datagram that was damaged but stays plausible cannot be told from a good one, and losses show by the time alone.
"""

import struct
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from drivers.cim.sample import ELECTRODES, OHM_MAX, Refusal, Sample
from hal import options
from hal.options import option

TIME_MAX_S = 1e10
"""Three centuries; a larger number is no time in seconds."""


@dataclass(frozen=True)
class MinimalOptions:
    """What is not known of the layout before a datagram was seen."""

    byte_order: str = option("big", choices=("big", "little"), doc="of all three fields")


class Minimal:
    """See :class:`drivers.cim.sample.Decoder`."""

    options_type = MinimalOptions

    def __init__(self, table: Mapping[str, Any] | None = None, where: str = "decoder_options") -> None:
        read = options.read(MinimalOptions, table or {}, where)
        self._layout = struct.Struct(">did" if read.byte_order == "big" else "<did")

    def decode(self, data: memoryview) -> Sample | Refusal:
        """The sample in a datagram."""
        if len(data) != self._layout.size:
            return Refusal.LENGTH
        time_s, electrode, ohm = self._layout.unpack(data)
        if not (0.0 <= time_s <= TIME_MAX_S and 1 <= electrode <= ELECTRODES and 0.0 < ohm <= OHM_MAX):
            return Refusal.RANGE  # as is NaN
        return Sample(round(time_s * 1e6), electrode, ohm)

    def encode(self, time_s: float, electrode: int, ohm: float) -> bytes:
        """A datagram of this layout."""
        return self._layout.pack(time_s, electrode, ohm)
