"""One sample of the telemetry, why a datagram is none, and what a decoder is."""

import enum
from collections.abc import Mapping
from dataclasses import dataclass
from importlib.metadata import entry_points
from typing import Any, Protocol

from hal.errors import OptionError

GROUP = "rtctl.cim_decoders"
ELECTRODES = 22
"""Intracochlear electrodes of a Nucleus array, numbered 1 .. 22."""
MONOPOLAR = 0
"""Return electrode of a measurement against the case: none of the array's."""
OHM_MAX = 40_000.0
"""No telemetry reads more; an open circuit reads 28.8 kohm."""


class Refusal(enum.Enum):
    """Why a datagram is not a sample of this array."""

    LENGTH = "length"
    MAGIC = "magic"
    VERSION = "version"
    CHECKSUM = "checksum"
    RANGE = "range"
    """a field is out of bounds"""
    PAIR = "pair"
    """well-formed, but these electrodes are not a pair of the sweep"""
    SWEEP = "sweep"
    """the length of the sweep changed within a run"""


@dataclass(frozen=True, slots=True)
class Sample:
    """What one datagram says. Where a layout does not tell a thing, it is None.

    Attributes:
        time_us: when it was measured, by the sender's clock.
        active: electrode 1 .. 22. back: the return electrode, or MONOPOLAR.
        ohm: magnitude, finite, 0 < ohm <= 40 000.
        run: number of the sender's start. sequence: of the datagram in it, 32 bit, wraps.
        position, sweep_length: place in the sweep, and number of places. sweep: counts sweeps, 32 bit.
        phase_deg: NaN for none.
        is_open, is_short, at_compliance: the sender's own classification. is_simulated: no implant is behind it.
    """

    time_us: int
    active: int
    ohm: float
    back: int | None = None
    run: int | None = None
    sequence: int | None = None
    position: int | None = None
    sweep_length: int | None = None
    sweep: int = 0
    phase_deg: float = float("nan")
    is_open: bool = False
    is_short: bool = False
    at_compliance: bool = False
    is_simulated: bool = False


class Decoder(Protocol):
    """Makes samples of datagrams of one layout; keeps nothing between two of them."""

    options_type: type

    def __init__(self, table: Mapping[str, Any], where: str) -> None:
        """From `decoder_options`; `where` names them in messages. Raises OptionError."""

    def decode(self, data: memoryview) -> Sample | Refusal:
        """The sample in a datagram of any length and content. Never raises."""


def load(name: str) -> type[Decoder]:
    """The decoder called `name`. Raises OptionError."""
    found = {e.name: e for e in entry_points(group=GROUP)}
    if name not in found:
        raise OptionError("no such layout of the telemetry", value=name, bound=" | ".join(sorted(found)), remedy=f"install a decoder (entry point group {GROUP}) or name one of these")  # fmt: skip
    return found[name].load()
