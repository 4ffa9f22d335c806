"""The person beside an emulated bench who puts an array into the gripper when the operator says that one is loaded.

A bench of hardware has a real one. The two ends talk by datagrams, so that it works across processes too.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from hal import options
from hal.device import NEVER, Demand, Finding, Health, Readings, Site
from hal.emulator import Bench, Station
from hal.errors import BackendError
from hal.options import option
from hal.seams import Datagrams

EVERY_TICKS = 50
"""A lost word is said again soon."""


@dataclass(frozen=True)
class AssistantOptions:
    """Settings of the kind "assistant"."""

    address: str = option("127.0.0.1:7526", doc="host:port where he listens")


class Assistant:
    """The operator's voice: tells the assistant what was declared. Turns nothing, measures nothing."""

    options_type = AssistantOptions
    axes: tuple[int, ...] = ()
    measures: frozenset[str] = frozenset()

    def __init__(self, name: str, table: Mapping[str, Any], site: Site) -> None:
        self._options = options.read(AssistantOptions, table, f"device {name}")
        self._site = site
        self._line: Datagrams | None = None

    def open(self) -> None:
        """Raises BackendError if the address is none."""
        self._line = self._site.seams.datagrams("", self._options.address)

    def begin(self, tick: int) -> None:
        """Nothing takes time."""

    def read(self, tick: int, readings: Readings) -> None:
        """Nothing is measured."""

    def write(self, tick: int, demand: Demand) -> None:
        """Say now and then what holds."""
        if self._line is not None and tick % EVERY_TICKS == 0:
            self._line.send(b"\1" if demand.array_loaded else b"\0")

    def close(self) -> None:
        """Fall silent."""
        if self._line is not None:
            self._line.close()
            self._line = None

    def health(self) -> Health:
        """He is well."""
        return Health("simulated assistant", age_ticks=NEVER)

    def probe(self) -> list[Finding]:
        """He has no wires."""
        return []


class EmulatedAssistant:
    """The assistant himself."""

    faults: tuple[str, ...] = ("absent",)
    apart = False

    def __init__(self, name: str, table: Mapping[str, Any], station: Station) -> None:
        address = options.read(AssistantOptions, table, f"device {name}").address
        self._line = station.switchboard.plug_datagrams("", address)
        self._word = bytearray(1)
        self._absent = False

    def sense(self, tick: int, bench: Bench) -> None:
        """He looks at the operator, not at the bench."""

    def drive(self, tick: int, bench: Bench) -> None:  # noqa: ARG002
        """Do what was said last."""
        while self._line.receive(self._word) == 1:
            if not self._absent:
                bench.array_loaded = bool(self._word[0])

    def inject(self, fault: str, value: float = 1.0) -> None:
        """ "absent": he does nothing any more."""
        if fault not in self.faults:
            raise BackendError("no such fault", value=fault, bound=" | ".join(self.faults))
        self._absent = bool(value)
