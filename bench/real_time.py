"""Whole runs of the daemon kept in memory, for what is measured of every record."""

import time
from collections.abc import Callable

import numpy as np

from hal.errors import RtctlError
from rtctl.commands import Verb
from rtctl.daemon import Daemon
from rtctl.readiness.direct import DirectOperator, run_daemon
from rtctl.settings import Settings


class BenchError(RtctlError):
    """A part of the bench did not do what it was started for."""


class BenchOperator(DirectOperator):
    """Keeps every record it sees."""

    def __init__(self, daemon: Daemon) -> None:
        self.control = daemon.control
        self._rows: list[np.ndarray] = []
        super().__init__(daemon, self._keep)

    def _keep(self, rows: np.ndarray, _position: int) -> None:
        if len(rows):
            self._rows.append(rows.copy())

    def records(self) -> np.ndarray:
        """All records so far. Raises BenchError if some were overwritten before they were seen."""
        self.glance()
        if self.lost or not self._rows:
            raise BenchError("records were lost", value=self.lost, bound="0", remedy="relieve the machine")
        return np.concatenate(self._rows)


def records_of(settings: Settings, script: Callable[[BenchOperator], object]) -> np.ndarray:
    """Run the daemon without a gateway while `script` operates it; all records (n,) of the run.

    Raises:
        RunError: the daemon ended badly. What `script` raises comes out, too.
        BenchError: records were lost.
    """
    operators = []

    def operate(daemon: Daemon) -> None:
        operators.append(BenchOperator(daemon))
        script(operators[0])

    run_daemon(settings, operate, gateway=False)
    return operators[0].records()


def home_and_hold(seconds: float, operator: BenchOperator) -> None:
    """Enable, home, and hold until `seconds` are over."""
    end_s = time.monotonic() + seconds
    operator.command(Verb.ENABLE)
    operator.wait(lambda record: record["powered"], seconds)
    operator.command(Verb.HOME)
    operator.wait(lambda _: False, end_s - time.monotonic())
