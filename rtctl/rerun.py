"""The tick once more on recorded inputs: what a fresh controller makes of them."""

import numpy as np

from hal.errors import RtctlError
from hal.kernel import kernel
from rtctl.commands import Reason, Verb
from rtctl.controller import Controller
from rtctl.record import INPUTS, ZERO_BEFORE
from rtctl.tick import tick as run_tick

STAGED = {int(Verb.LOAD_PLAN): "staged_plan", int(Verb.SET_PARAMETERS): "staged_parameters"}
"""Where the data of a command wait for the tick."""

Staged = dict[str, dict[int, bytes]]
"""Name of :data:`STAGED` -> number -> raw record."""
NEEDED = INPUTS | {"command_verdict"}
"""Signals a replay reads off the log; the verdict tells whether staged data were there."""


def rerun(controller: Controller, rows: np.ndarray, staged: Staged) -> np.ndarray:
    """The records (n,) that a fresh `controller` makes of the inputs in `rows` (n,), which may be of another version.

    Raises:
        RtctlError: an input, a plan or a parameter set is missing, or of another version.
    """
    fed = _as_this_version(rows, controller.table.dtype)
    replayed = np.zeros_like(fed)
    begin = 0
    for at in np.flatnonzero(fed["command_verb"]).tolist():
        if at > begin:
            run_rows(fed[begin:at], replayed[begin:at], controller.memory, controller.sensors, controller.actuators)
        _prepare(controller, fed[at], staged)
        run_rows(fed[at : at + 1], replayed[at : at + 1], controller.memory, controller.sensors, controller.actuators)
        begin = at + 1
    if begin < len(fed):
        run_rows(fed[begin:], replayed[begin:], controller.memory, controller.sensors, controller.actuators)
    return replayed


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


def _as_this_version(rows: np.ndarray, dtype: np.dtype) -> np.ndarray:
    """`rows` (n,) in the layout `dtype`, as far as they have its signals; the rest is zero and never looked at."""
    if rows.dtype == dtype:
        return rows
    here = {name for name in dtype.names or () if name in (rows.dtype.names or ()) and rows.dtype[name] == dtype[name]}
    if lacking := sorted(NEEDED - here - ZERO_BEFORE):
        raise RtctlError("the log lacks inputs that this version of rtctl reads", value=", ".join(lacking), remedy="replay it with the revision in its header")  # fmt: skip
    fed = np.zeros(len(rows), dtype)
    for name in here:
        fed[name] = rows[name]
    return fed


def _prepare(controller: Controller, row: np.void, staged: Staged) -> None:
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
    elif len(raw) != memory[name].dtype.itemsize:
        raise RtctlError(f"the {name.removeprefix('staged_')} in the log is of another version of rtctl", value=f"{len(raw)} bytes", bound=f"{memory[name].dtype.itemsize} bytes", remedy="replay it with the revision in its header")  # fmt: skip
    else:
        memory[name] = np.frombuffer(raw, memory[name].dtype)
