"""(b) The cost of a tick inside the real loop: a whole insertion at 1 kHz through the daemon, with plant and record."""

from functools import partial

import numpy as np

from bench.figures import Figure, Target
from bench.real_time import BenchOperator, records_of
from rtctl.lifecycle import Task
from rtctl.settings import Settings
from rtctl.workflow import WorkflowError, insert_array

PART = "loop"
TARGET_US = Target(50.0)
ATTEMPTS = 3


def measure(settings: Settings) -> list[Figure]:
    """Percentiles of record.tick_ns: from the wake-up to the moment the record goes into the ring.

    Raises:
        RtctlError: the insertion did not come to its end.
    """
    records, failures = _insertion(settings)
    inserting = records[records["task_state"] == Task.INSERTING]
    missed = int(records["missed_ticks"].sum())
    figures = []
    for name, rows in (("whole run", records), ("while inserting", inserting)):
        cost_us = rows["tick_ns"] * 1e-3
        note = f"{len(rows)} ticks" + (f", {missed} missed{failures}" if rows is records else "")
        figures.append(Figure(PART, f"tick p50, {name}", "us", _percentile(cost_us, 50), target=TARGET_US, note=note))
        figures.append(Figure(PART, f"tick p99.9, {name}", "us", _percentile(cost_us, 99.9)))
    return figures


def _insertion(settings: Settings) -> tuple[np.ndarray, str]:
    """Records of an insertion that came to its end, and what ended those before: a machine that stalls may fault one."""
    failures = ""
    for _ in range(ATTEMPTS - 1):
        try:
            return records_of(settings, partial(_insert, settings)), failures
        except WorkflowError as error:
            failures += f"; an attempt ended: {error}"
    return records_of(settings, partial(_insert, settings)), failures


def _insert(settings: Settings, operator: BenchOperator) -> None:
    insert_array(operator, settings, operator.robot)


def _percentile(values: np.ndarray, percent: float) -> float:
    return float(np.percentile(values, percent))
