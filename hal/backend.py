"""What every backend is: four verbs and a watchdog. The controller knows nothing else of it."""

from collections.abc import Mapping
from dataclasses import dataclass
from importlib.metadata import entry_points
from typing import Any, Protocol, runtime_checkable

import numpy as np

from hal.errors import BackendError
from hal.signals import Table

GROUP = "rtctl.backends"


@dataclass(frozen=True)
class CompiledDevice:
    """A backend whose devices are kernels, so that a loop may run without the interpreter.

    read(device, tick, sensors) and write(device, tick, actuators) are kernels over the records below.
    """

    read: Any
    write: Any
    device: np.ndarray


@runtime_checkable
class Backend(Protocol):
    """Devices behind one seam.

    Contract (proved for every backend by :mod:`hal.conformance`):

    * ``open`` leaves the amplifiers without power; so does ``close``, which may be called twice.
    * ``read`` and ``write`` get the tick number of the loop's grid. They return at once, allocate nothing
      and raise nothing; trouble is told through validity and the flags of the sensor frame. A tick number that
      jumps tells how many periods were missed.
    * Power needs a write with ``power = 1`` every tick. After ``watchdog_ticks`` without one the device itself
      sets its outputs to zero, removes power and reports ``watchdog_tripped`` until a write with ``power = 0``.
    * A command that is not finite is treated as a missing one, never passed on.
    """

    axes: int
    watchdog_ticks: int
    simulated: bool

    def open(self) -> None:
        """Connect and check the devices. Raises BackendError with what to do."""

    def read(self, tick: int, sensors: np.ndarray) -> None:
        """Fill the sensor frame, shape (1,), for grid tick `tick`."""

    def write(self, tick: int, actuators: np.ndarray) -> None:
        """Pass the actuator frame, shape (1,), on to the devices."""

    def close(self) -> None:
        """Remove power and release the devices."""

    def compiled(self) -> CompiledDevice | None:
        """The same devices as kernels, or None where they are not."""

    def truth(self) -> tuple[Table, np.ndarray] | None:
        """What a simulation knows and a controller may not: signals and their live record (1,) of the table's dtype."""


@runtime_checkable
class Scattered(Protocol):
    """What a simulation may have beside: runs that differ from seed to seed in more than noise."""

    def drawn_values(self) -> dict[str, float]:
        """What the seed decided, by names with units; which names there are depends neither on seed nor on settings."""


def drawn_values(backend: Backend) -> dict[str, float]:
    """What the seed decided about `backend`; empty where it decides nothing worth telling."""
    return backend.drawn_values() if isinstance(backend, Scattered) else {}


@runtime_checkable
class Fallible(Protocol):
    """What a simulation may have beside: steps it could not solve, after which it stands still without power."""

    def failure(self) -> BackendError | None:
        """Why it cannot go on; None while it can."""

    def snapshot(self) -> bytes:
        """All of its state, to be looked into or gone on from."""


def failure_of(backend: Backend) -> tuple[BackendError, bytes] | None:
    """Why a simulated `backend` stands still, and its state; None while it goes on, and for hardware."""
    error = backend.failure() if isinstance(backend, Fallible) else None
    return None if error is None else (error, backend.snapshot())  # type: ignore[attr-defined]


def load(name: str, options: Mapping[str, Any], *, period_s: float, seed: int) -> Backend:
    """Find backend `name` among the installed entry points and make it from its own table of settings.

    Raises:
        BackendError: no such backend; OptionError: its settings are wrong.
    """
    found = {e.name: e for e in entry_points(group=GROUP)}
    if name not in found:
        raise BackendError("no such backend", value=name, bound=" | ".join(sorted(found)), remedy="set [backend] name")
    return found[name].load()(options, period_s=period_s, seed=seed)
