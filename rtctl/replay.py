"""Run the controller again on what a log holds: inputs, commands, plans and parameter sets, each at its tick.

A replay is the same experiment only if every output is identical to the bit.
"""

import base64
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from hal.errors import RtctlError
from hal.kernel import kernel, kernel_hash
from rtctl.commands import Reason, Verb
from rtctl.controller import Controller
from rtctl.log.hashing import Difference, check_hashes, first_difference
from rtctl.log.reader import Log, open_many
from rtctl.settings import from_table
from rtctl.tick import tick as run_tick

STAGED = {int(Verb.LOAD_PLAN): "staged_plan", int(Verb.SET_PARAMETERS): "staged_parameters"}
"""Where the data of a command wait for the tick."""


@dataclass(frozen=True)
class Replay:
    """What a replay found. `difference` is None if every output was identical to the bit."""

    ticks: int
    commands: int
    difference: Difference | None
    same_kernels: bool
    """False: the code has changed since the log was written, which may explain a difference."""

    @property
    def identical(self) -> bool:
        return self.difference is None


def run(paths: Iterable[str | Path]) -> Replay:
    """Replay a log, given as its file, or its files in order if the gateway was restarted.

    Raises:
        RtctlError: the log does not begin with the controller, has gaps, or lacks a plan or parameter set it used.
    """
    log = open_many(paths)
    rows = log.controller
    _check_whole(log, rows)
    controller = Controller(from_table(log.settings_table()))
    if controller.table.dtype != rows.dtype:
        raise RtctlError("the log has other signals than this version of rtctl", remedy="replay it with the revision in its header")  # fmt: skip
    staged = {"staged_plan": _payloads(log.plans), "staged_parameters": _payloads(log.parameters)}
    replayed = np.zeros_like(rows)
    ordered = np.flatnonzero(rows["command_verb"]).tolist()
    begin = 0
    for at in ordered:
        if at > begin:
            run_rows(rows[begin:at], replayed[begin:at], controller.memory, controller.sensors, controller.actuators)
        _prepare(controller, rows[at], staged)
        run_rows(rows[at : at + 1], replayed[at : at + 1], controller.memory, controller.sensors, controller.actuators)
        begin = at + 1
    if begin < len(rows):
        run_rows(rows[begin:], replayed[begin:], controller.memory, controller.sensors, controller.actuators)
    difference = first_difference(rows, replayed)
    if difference is None and check_hashes(rows, log.hashes):
        raise RtctlError("the log's own hashes do not fit its rows", remedy="the file was changed after it was written")
    return Replay(len(rows), len(ordered), difference, log.header.get("kernel_hash") == kernel_hash())


@kernel
def run_rows(rows, replayed, memory, sensors, actuators):
    """Feed the inputs of consecutive rows to the tick; memory.command is already that of a row with a command."""
    s = sensors[0]
    for k in range(rows.shape[0]):
        row, out = rows[k], replayed[k]
        for i in range(s.axis_angle_rad.shape[0]):
            s.axis_angle_rad[i] = row.axis_angle_rad[i]
        for i in range(6):
            s.wrench_in_sensor[i] = row.wrench_in_sensor[i]
        s.impedance_ohm, s.impedance_pair = row.impedance_ohm, row.impedance_pair
        s.impedance_sequence, s.impedance_age_ticks = row.impedance_sequence, row.impedance_age_ticks
        s.impedance_validity = row.impedance_validity
        s.axes_sequence, s.wrench_sequence = row.axes_sequence, row.wrench_sequence
        s.axes_age_ticks, s.wrench_age_ticks = row.axes_age_ticks, row.wrench_age_ticks
        s.axes_validity, s.wrench_validity = row.axes_validity, row.wrench_validity
        s.powered, s.watchdog_tripped, s.amplifier_fault = row.powered, row.watchdog_tripped, row.amplifier_fault
        s.trouble, s.trouble_grade = row.trouble, row.trouble_grade
        s.trouble_device, s.trouble_value = row.trouble_device, row.trouble_value
        command = memory[0].command
        command.sequence, command.verb = row.command_sequence, row.command_verb
        command.source, command.deadline_tick = row.command_source, row.command_deadline_tick
        for i in range(8):
            command.argument[i] = row.command_argument[i]
        out.tick, out.time_ns = row.tick, row.time_ns
        out.missed_ticks, out.gateway_health = row.missed_ticks, row.gateway_health
        out.clock_state = row.clock_state
        out.tick_ns, out.lateness_ns = row.tick_ns, row.lateness_ns
        out.clock_error_s, out.clock_moved_ns = row.clock_error_s, row.clock_moved_ns
        run_tick(memory[0], s, actuators[0], out)


def _check_whole(log: Log, rows: np.ndarray) -> None:
    """A replay needs every tick from the first on: what is missing cannot be made up."""
    if len(rows) == 0:
        raise RtctlError("the log holds no records of a controller", remedy="give a log.mcap of rtctl")
    if rows["tick"][0] - rows["missed_ticks"][0] != 0:
        raise RtctlError("the log does not begin with the first tick", value=int(rows["tick"][0]), bound="0", remedy="give all files of the run, log.mcap first")  # fmt: skip
    gaps = log.missing_ticks()
    if gaps:
        raise RtctlError("records are missing, so the controller's state is not known after them", value=gaps[0], bound="every tick", remedy="only the part before them can be trusted")  # fmt: skip


def _payloads(messages: list[dict]) -> dict[int, bytes]:
    """Raw records by number out of the log's messages on plans or parameter sets."""
    return {int(m["number"]): base64.b64decode(m["record_base64"]) for m in messages}


def _prepare(controller: Controller, row: np.void, staged: dict[str, dict[int, bytes]]) -> None:
    """What the loop did for this command beside the tick."""
    memory = controller.memory
    memory["command"]["verb"] = row["command_verb"]
    memory["command"]["argument"] = row["command_argument"]
    name = STAGED.get(int(row["command_verb"]))
    if name is None:
        controller.propose(int(row["tick"]))
        return
    number = int(row["command_argument"][0]) if np.isfinite(row["command_argument"][0]) else -1
    raw = staged[name].get(number)
    if raw is None and row["command_verdict"] == Reason.ACCEPTED:
        raise RtctlError(f"the log lacks the {name.removeprefix('staged_')} that was used", value=number)
    if raw is None or row["command_verdict"] == Reason.STALE_SLOT:  # the loop did not get hold of it
        memory[name]["number"] = -1
    else:
        memory[name] = np.frombuffer(raw, memory[name].dtype)
