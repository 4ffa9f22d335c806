"""The controller and a simulated backend in lockstep: a virtual clock, no waiting, no sockets.

A backend of kernels runs without the interpreter, a hundred times faster than real time; one of drivers and emulators
runs through its methods.

What happens depends on the settings, the seed and the commands alone, never on the speed of the machine.
"""

from collections.abc import Callable
from typing import Any, cast

import numpy as np

from hal.backend import Backend, CompiledDevice, load
from hal.errors import BackendError
from hal.kernel import Pointer, specialised
from rtctl.commands import COMMAND, Verb
from rtctl.controller import Controller
from rtctl.exchange.control import ARMING_ALLOWED
from rtctl.exchange.mailbox import forget
from rtctl.settings import Settings
from rtctl.tick import tick as run_tick

NO_COMMAND = np.zeros(1, COMMAND)


def run(first_tick, records, truths, truth, memory, sensors, actuators, device, read, write, period_ns, health):
    """Run len(records) ticks without the interpreter; `read` and `write` are the kernels of the device.

    A kernel once :class:`Lockstep` has compiled it for its device; arguments are arrays, the single ones of shape (1,).
    """
    for k in range(records.shape[0]):
        tick = first_tick + k
        record = records[k]
        record.tick = tick
        record.time_ns = tick * period_ns
        record.gateway_health = health
        read(device[0], tick, sensors[0])
        run_tick(memory[0], sensors[0], actuators[0], record)
        write(device[0], tick, actuators[0])
        forget(memory[0].command)
        truths[k] = truth[0]
        truths[k].time_ns = record.time_ns
        truths[k].tick = tick


class Lockstep:
    """A closed loop of controller and simulated devices.

    Args:
        settings: of the controller, and of the backend it names.
        seed: of the backend's noise.
        sink: is given every block of records and truths (arrays), in order; for logs. They are its to keep.

    Raises:
        BackendError: the backend named in the settings is no simulation.
    """

    BLOCK = 16384
    """Rows of memory at a time: so many that the operating system gives it in large pages, seven times as fast."""

    def __init__(
        self,
        settings: Settings,
        seed: int,
        sink: Callable[[np.ndarray, np.ndarray], None] = lambda _records, _truths: None,
    ) -> None:
        self.controller = Controller(settings)
        period = settings.loop.period_s
        self.backend: Backend = load(settings.backend.name, settings.backend.options, period_s=period, seed=seed)
        compiled, truth = self.backend.compiled(), self.backend.truth()
        if not self.backend.simulated or truth is None:
            raise BackendError("this backend cannot run in lockstep", value=settings.backend.name, remedy="use a simulation")  # fmt: skip
        self.truth = truth[1]
        self.period_ns = round(period * 1e9)
        self.sink = sink
        self.tick = 0
        self.sequence = 0
        self._compiled = compiled
        self._clear()
        if compiled is not None:
            self._read, self._write = Pointer(compiled.read), Pointer(compiled.write)
            self.run = specialised(run, self._arguments(0))
        self.backend.open()

    @property
    def device(self) -> CompiledDevice:
        """The backend's kernels and their record. Raises BackendError for one that has none."""
        if self._compiled is None:
            raise BackendError("this backend has no kernels", remedy="use the backend plant")
        return self._compiled

    def _clear(self) -> None:
        """Fresh rows; the old ones belong to whoever holds them."""
        self._records = np.zeros(self.BLOCK, self.controller.table.dtype)
        self._truths = np.zeros(self.BLOCK, self.truth.dtype)
        self._rows = 0

    def _arguments(self, ticks: int) -> tuple[Any, ...]:
        """Arguments of :func:`run` for the next ticks."""
        c, rows = self.controller, slice(self._rows, self._rows + ticks)
        frames = self.truth, c.memory, c.sensors, c.actuators
        device = self.device.device, self._read, self._write
        return self.tick, self._records[rows], self._truths[rows], *frames, *device, self.period_ns, ARMING_ALLOWED

    def _interpret(self, ticks: int) -> None:
        """The same as :func:`run`, through the methods of the backend."""
        c, backend, record = self.controller, self.backend, self.controller.record
        for k in range(ticks):
            tick, row = self.tick + k, self._rows + k
            record["tick"], record["time_ns"] = tick, tick * self.period_ns
            record["gateway_health"] = ARMING_ALLOWED
            backend.read(tick, c.sensors)
            c.step()
            backend.write(tick, c.actuators)
            c.command[:] = NO_COMMAND
            self._records[row] = record[0]
            self._truths[row] = self.truth[0]
            self._truths[row]["time_ns"], self._truths[row]["tick"] = record["time_ns"][0], tick

    def advance(self, ticks: int) -> np.void:
        """Run `ticks` ticks, at least one, and return the last record."""
        while ticks > 0:
            if self._rows == self.BLOCK:
                self._clear()
            n = min(ticks, self.BLOCK - self._rows)
            if self._compiled is None:
                self._interpret(n)
            else:
                self.run(*self._arguments(n))
            rows = slice(self._rows, self._rows + n)
            self._rows += n
            self.tick += n
            ticks -= n
            self.sink(self._records[rows], self._truths[rows])
        return cast(np.void, self._records[self._rows - 1])

    def command(self, verb: Verb, *arguments: float) -> np.void:
        """Give the controller one command in the next tick, and return the record of that tick."""
        self.sequence += 1
        row = np.zeros(1, COMMAND)
        row["sequence"], row["verb"], row["deadline_tick"] = self.sequence, verb, self.tick + 1
        row["argument"][0, : len(arguments)] = arguments
        self.controller.order(row[0])
        self.controller.propose(self.tick)
        return self.advance(1)

    def close(self) -> None:
        """Remove power and release the backend."""
        self.backend.close()
