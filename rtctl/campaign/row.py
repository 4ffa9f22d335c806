"""One simulated insertion as one row: seed, how it ended, what was drawn, and the figures of its summary."""

import json
from pathlib import Path
from typing import Any

from hal.errors import RtctlError
from hal.kernel import kernel_hash
from rtctl.electrode.planning import Plan
from rtctl.settings import Settings, config_hash
from rtctl.simulation import simulate
from rtctl.summary import FIGURES, summarise

FIRST = ("seed", "outcome", "failure")
NOT_RUN = "not run"
"""Outcome of a run for which there is no summary, since it could not be set up."""
MEASURED = ("tick_us_p50", "tick_us_p999", "lateness_us_p50", "lateness_us_p99", "real_time_factor")
"""Figures that tell of the machine: a row must not depend on it."""

Row = dict[str, str]


def columns(drawn: tuple[str, ...]) -> tuple[str, ...]:
    """Names of the columns; `drawn` are the names of what the backend draws."""
    first = (*FIRST, *drawn)
    return (*first, *(f.name for f in FIGURES if f.name not in first and f.name not in MEASURED))


def row_of(settings: Settings, seed: int, plan: Plan | None = None, logs: Path | None = None) -> Row:
    """Simulate and summarise one insertion; one that fails is a row too, and says why.

    plan: see :func:`rtctl.simulation.simulate`. logs: folder for its log, which replaces that of a run that was cut off.
    """
    log = None if logs is None else logs / f"{seed}.mcap"
    if log is not None:
        log.unlink(missing_ok=True)
    try:
        result = simulate(settings, seed, plan=plan, log=log)
    except RtctlError as error:
        identity = {"config_hash": config_hash(settings), "kernel_hash": kernel_hash()}
        return {"seed": str(seed), "outcome": NOT_RUN, "failure": _text(str(error))} | identity
    recording, failure = result.recording, result.failure
    values = {**recording.drawn, **summarise(recording), "failure": str(failure) if failure else None}
    return {name: _text(value) for name, value in values.items() if name not in MEASURED}


def is_failure(row: Row) -> bool:
    """True unless the insertion reached its depth and the whole work-flow its end."""
    return row["outcome"] != "completed" or bool(row["failure"])


def _text(value: Any) -> str:
    """A figure as it stands in the table: unknown is empty, a condition is its name, and no text has two lines."""
    if value is None:
        return ""
    if isinstance(value, dict):
        return str(value.get("name", ""))
    return " ".join(value.split()) if isinstance(value, str) else json.dumps(value)
