"""(i) What it gains and costs to spend the end of the sleep looking at the clock (`loop.spin_us`)."""

import time
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np

from bench.figures import Figure, in_turns
from bench.real_time import BenchOperator, records_of
from rtctl.exchange.control import Word, get
from rtctl.settings import Settings

PART = "spin"
SPINS_US = (0, 20, 50, 100)
MEASURED = {"lateness p50": "us", "lateness p99": "us", "share of the core": "%"}
PERCENTILES = (50.0, 99.0)


def measure(settings: Settings, rounds: int, seconds: float) -> list[Figure]:
    """Lateness and share of the core with each spin, in turns; what is without one is the reference.

    Raises:
        BenchError: the daemon failed.
    """
    runs = [partial(_run, replace(settings, loop=replace(settings.loop, spin_us=us)), seconds) for us in SPINS_US]
    turns = in_turns(rounds, *runs)
    figures = []
    for column, (name, unit) in enumerate(MEASURED.items()):
        medians = [float(np.median([run[column] for run in runs_of_one])) for runs_of_one in turns]
        for spin_us, median in zip(SPINS_US, medians, strict=True):
            beside, called = (medians[0], "no spin") if spin_us else (None, "")
            note = f"{rounds} rounds of {seconds:g} s"
            figures.append(Figure(PART, f"{name}, spin {spin_us} us", unit, median, beside, called, note=note))
    return figures


def _run(settings: Settings, seconds: float) -> tuple[float, float, float]:
    """Lateness p50 and p99 [us] and share of the core [%] of a run without power."""
    spent: list[tuple[float, float]] = []

    def script(operator: BenchOperator) -> None:
        pid = get(operator.control, Word.REAL_TIME_PID)
        spent.append((time.monotonic(), _processor_s(pid)))
        operator.wait(lambda _: False, seconds)
        spent.append((time.monotonic(), _processor_s(pid)))

    lateness_us = records_of(settings, script)["lateness_ns"] * 1e-3
    (begin_s, before_s), (end_s, after_s) = spent
    p50, p99 = np.percentile(lateness_us, PERCENTILES)
    return float(p50), float(p99), 100.0 * (after_s - before_s) / (end_s - begin_s)


def _processor_s(pid: int) -> float:
    """Time process `pid`, of one thread, has had on a core [s]."""
    return int(Path(f"/proc/{pid}/schedstat").read_text().split()[0]) * 1e-9
