"""Run the controller again on what a log holds: inputs, commands, plans and parameter sets, each at its tick.

A replay is the same experiment only if every output is identical to the bit.
"""

import base64
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from hal.errors import RtctlError
from hal.kernel import kernel_hash
from rtctl.controller import Controller
from rtctl.log.hashing import check_hashes
from rtctl.log.reader import Log, open_many
from rtctl.parameters import pack, with_values
from rtctl.replaying.difference import Difference, compared, first_difference
from rtctl.rerun import Staged, rerun
from rtctl.settings import from_table


@dataclass(frozen=True)
class Replay:
    """What a replay found. `difference` is None if every output was identical to the bit."""

    ticks: int
    commands: int
    difference: Difference | None
    same_kernels: bool
    """False: the code has changed since the log was written, which may explain a difference."""
    not_compared: tuple[str, ...] = ()
    """Outputs that only the log or only this version has."""

    @property
    def identical(self) -> bool:
        return self.difference is None


def run(paths: Iterable[str | Path]) -> Replay:
    """Replay a log, given as its file, or its files in order if the gateway was restarted.

    A log of another version is compared in the signals that both have.

    Raises:
        RtctlError: the log does not begin with the controller, has gaps, lacks a plan or parameter set it used, or
            something that this version reads.
    """
    log = open_many(paths)
    rows = whole_rows(log)
    controller = Controller(from_table(log.settings_table()))
    replayed = rerun(controller, rows, staged_in(log, controller))
    difference = first_difference(rows, replayed)
    if difference is None and check_hashes(rows, log.hashes):
        raise RtctlError("the log's own hashes do not fit its rows", remedy="the file was changed after it was written")
    same_kernels = log.header.get("kernel_hash") == kernel_hash()
    commands = int(np.count_nonzero(rows["command_verb"]))
    return Replay(len(rows), commands, difference, same_kernels, tuple(compared(rows.dtype, replayed.dtype)[1]))


def staged_in(log: Log, controller: Controller) -> Staged:
    """The plans and parameter sets of a log, bit for bit; sets of another layout are packed anew from their values."""
    sets = _payloads(log.parameters)
    size = controller.memory["staged_parameters"].dtype.itemsize
    for message in log.parameters:
        number = int(message["number"])
        if len(sets[number]) != size and "values" in message:
            settings = from_table(with_values(log.settings_table(), message["values"]))
            sets[number] = pack(settings, controller.robot, number).tobytes()
    return {"staged_plan": _payloads(log.plans), "staged_parameters": sets}


def whole_rows(log: Log) -> np.ndarray:
    """The controller's records from the first tick on: what is missing cannot be made up.

    Raises:
        RtctlError: there are none, or some are missing.
    """
    rows = log.controller
    if len(rows) == 0:
        raise RtctlError("the log holds no records of a controller", remedy="give a log.mcap of rtctl")
    if rows["tick"][0] - rows["missed_ticks"][0] != 0:
        raise RtctlError("the log does not begin with the first tick", value=int(rows["tick"][0]), bound="0", remedy="give all files of the run, log.mcap first")  # fmt: skip
    gaps = log.missing_ticks()
    if gaps:
        raise RtctlError("records are missing, so the controller's state is not known after them", value=gaps[0], bound="every tick", remedy="only the part before them can be trusted")  # fmt: skip
    return rows


def _payloads(messages: list[dict]) -> dict[int, bytes]:
    """Raw records by number out of the log's messages on plans or parameter sets."""
    return {int(m["number"]): base64.b64decode(m["record_base64"]) for m in messages}
