"""A simulated insertion cut into pieces that can be run again: by the kernels, by the plant alone, or by other code."""

from dataclasses import dataclass

import numpy as np

from hal.kernel import kernel
from rtctl.commands import Verb
from rtctl.exchange.mailbox import forget
from rtctl.lockstep import Lockstep
from rtctl.record import INPUTS, TIMING
from rtctl.settings import Settings
from rtctl.simulation import LockstepOperator, Recorder
from rtctl.tick import tick
from rtctl.workflow import insert_array


@dataclass(frozen=True)
class Piece:
    """What happened from one command to the next.

    Attributes:
        memory: of the controller just before the tick of the command, shape (1,); it holds the command.
        device: of the plant at that time, shape (1,).
        sensors: frames (n,) that the ticks read.
        records: that the ticks wrote, (n,).
        actuators: frames (n,) that the ticks wrote.
    """

    memory: np.ndarray
    device: np.ndarray
    sensors: np.ndarray
    records: np.ndarray
    actuators: np.ndarray

    @property
    def verb(self) -> Verb:
        """The command the piece begins with."""
        return Verb(int(self.memory["command"]["verb"][0]))

    def inputs(self) -> np.ndarray:
        """Rows (n,) with what the caller of the tick fills in, and nothing else."""
        rows = np.zeros_like(self.records)
        for name in INPUTS:
            rows[name] = self.records[name]
        return rows

    def first(self, ticks: int) -> "Piece":
        """The first ticks of this piece."""
        return Piece(self.memory, self.device, self.sensors[:ticks], self.records[:ticks], self.actuators[:ticks])


class CuttingLockstep(Lockstep):
    """A lockstep that keeps what it would need to start again at each command."""

    def __init__(self, settings: Settings, seed: int, recorder: Recorder) -> None:
        super().__init__(settings, seed, recorder.take)
        self.starts: list[tuple[int, np.ndarray, np.ndarray]] = []

    def advance(self, ticks: int) -> np.void:
        memory = self.controller.memory
        if memory["command"]["verb"][0] != Verb.NONE:
            self.starts.append((self.tick, memory.copy(), self.device.device.copy()))
        return super().advance(ticks)


def record_insertion(settings: Settings, seed: int) -> list[Piece]:
    """Run the whole work-flow in lockstep and return its pieces, in order.

    Raises:
        RtctlError: the insertion did not come to its end.
    """
    recorder = Recorder()
    lockstep = CuttingLockstep(settings, seed, recorder)
    try:
        insert_array(LockstepOperator(lockstep, recorder), settings, lockstep.controller.robot)
    finally:
        lockstep.close()
    records, _ = recorder.rows()
    controller = lockstep.controller
    sensors: np.ndarray = np.zeros(len(records), controller.sensors.dtype)
    sensors["device_time_s"] = np.nan  # for the clock, and nothing of it is in a record
    for name in set(sensors.dtype.names or ()) - {"device_time_s"}:
        sensors[name] = records[name]
    actuators: np.ndarray = np.zeros(len(records), controller.actuators.dtype)
    actuators["command_v"], actuators["power"] = records["command_applied_v"], records["power_request"]
    actuators["array_loaded"] = records["array_loaded"]
    ends = [start[0] for start in lockstep.starts[1:]] + [len(records)]
    return [
        Piece(memory, device, sensors[begin:end], records[begin:end], actuators[begin:end])
        for (begin, memory, device), end in zip(lockstep.starts, ends, strict=True)
    ]


@kernel
def drive(memory, sensors, actuators, records):
    """Run one tick for each row of `records`; the first has the command in `memory`, the others none."""
    for k in range(records.shape[0]):
        tick(memory[0], sensors[k], actuators[k], records[k])
        forget(memory[0].command)


def differing_fields(a: np.ndarray, b: np.ndarray) -> list[str]:
    """Fields of two arrays of records (n,) that are not equal to the bit, the times measured apart."""
    return [n for n in a.dtype.names or () if n not in TIMING and a[n].tobytes() != b[n].tobytes()]
