"""Golden logs come out again to the bit, and a change of arithmetic shows in its signal and tick.

If a change of the controller is meant to change its outputs: `make golden`, and say in the commit why they changed.
"""

import base64
from pathlib import Path

import numpy as np
import pytest

from hal.errors import RtctlError
from rtctl import replay
from rtctl.commands import Verb
from rtctl.controller import Controller
from rtctl.lifecycle import Operating, Task
from rtctl.log.reader import Log
from rtctl.record import INPUTS, TIMING
from rtctl.replaying.difference import compared, first_difference
from rtctl.replaying.fingerprint import PREFIX
from rtctl.settings import from_table

FOLDER = Path(__file__).parent
LOGS = sorted(FOLDER.glob("*.mcap"))
LARGEST_BYTES = 100_000


def replayed(name, change=lambda _table: None):
    """Rows of a golden log, and what a controller makes of them with settings changed by `change`."""
    log = Log.open(FOLDER / f"{name}.mcap")
    table = log.settings_table()
    change(table)
    rows = replay.whole_rows(log)
    controller = Controller(from_table(table))
    return rows, replay.rerun(controller, rows, replay.staged_in(log, controller))


@pytest.mark.parametrize("log", LOGS, ids=lambda p: p.stem)
def test_golden_logs_come_out_again(log):
    found = replay.run([log])
    assert found.identical, f"{found.difference}; if it was meant to differ: `make golden`"
    assert log.stat().st_size < LARGEST_BYTES


def test_they_hold_what_they_are_for():
    assert {p.stem for p in LOGS} == {"insertion", "guidance", "operation"}
    _, insertion = replayed("insertion")
    assert np.abs(insertion["admittance_offset_mm"]).max() > 0.01
    assert {Operating.ENABLED, Operating.PAUSED} <= set(insertion["operating_state"].tolist())
    assert Task.HOLDING in insertion["task_state"]
    _, guidance = replayed("guidance")
    assert np.nanmax(guidance["impedance_jacobian_norm"]) > 0
    _, operation = replayed("operation")
    assert Operating.FAULT in operation["operating_state"]
    assert set(operation["parameter_set"].tolist()) == {1, 2}
    assert Verb.SERVO_CV in operation["command_verb"]


@pytest.mark.parametrize(
    ("log", "section", "option", "signal", "when"),
    [
        ("insertion", "wrench", "cutoff_hz", "wrench_in_base", lambda rows: rows["tick"] >= 0),
        ("insertion", "admittance", "lateral_gain_mm_per_n_s", "admittance_offset_mm", lambda r: r["command_verb"] == Verb.INSERT),
        ("insertion", "control", "derivative_cutoff_hz", "command_desired_v", lambda r: r["command_verb"] == Verb.ENABLE),
        ("operation", "trajectory", "jerk_rad_per_s3", "pose_desired", lambda r: r["command_verb"] == Verb.MOVE_CP),
    ],
)  # fmt: skip
def test_another_arithmetic_shows_in_its_signal(log, section, option, signal, when):
    def change(table):
        table[section][option] *= 1.0 + 1e-9

    rows, other = replayed(log, change)
    found = first_difference(rows, other)
    assert found is not None
    assert found.field == signal
    assert found.tick >= rows["tick"][np.flatnonzero(when(rows))[0]]
    assert found.logged is None
    assert found.replayed == other[found.field][np.searchsorted(rows["tick"], found.tick)].tolist()


def without(rows, *names):
    """The rows as a version would have written them that did not have these signals."""
    kept = [n for n in rows.dtype.names if n not in names]
    older = np.zeros(len(rows), [(n, rows.dtype[n]) for n in kept])
    for n in kept:
        older[n] = rows[n]
    return older


def test_they_stay_useful_when_the_record_grows():
    rows, other = replayed("operation")
    older = without(rows, f"{PREFIX}reason_bound", f"{PREFIX}fault_cause")
    assert first_difference(older, other) is None
    assert set(compared(older.dtype, other.dtype)[1]) == {"reason_bound", "fault_cause"}
    log = Log.open(FOLDER / "operation.mcap")
    controller = Controller(from_table(log.settings_table()))
    assert replay.rerun(controller, older, replay.staged_in(log, controller)).tobytes() == other.tobytes()


def test_a_parameter_set_of_another_layout_is_packed_from_its_values():
    log = Log.open(FOLDER / "operation.mcap")
    controller = Controller(from_table(log.settings_table()))
    whole = replay.staged_in(log, controller)["staged_parameters"]
    for message in log.parameters:
        message["record_base64"] = base64.b64encode(b"12345678").decode()
    assert replay.staged_in(log, controller)["staged_parameters"] == whole
    for message in log.parameters:
        del message["values"]
    with pytest.raises(RtctlError, match="parameters in the log is of another version"):
        replay.rerun(controller, log.controller, replay.staged_in(log, controller))


def test_an_input_that_is_not_there_is_not_made_up():
    rows, _ = replayed("operation")
    log = Log.open(FOLDER / "operation.mcap")
    controller = Controller(from_table(log.settings_table()))
    with pytest.raises(RtctlError, match=r"lacks inputs.*powered"):
        replay.rerun(controller, without(rows, "powered"), replay.staged_in(log, controller))


def test_every_output_has_a_fingerprint():
    rows, other = replayed("operation")
    marked = {n.removeprefix(PREFIX) for n in rows.dtype.names}
    assert set(other.dtype.names) - {"reserved"} - TIMING <= marked
    assert set(rows.dtype.names) >= INPUTS
