"""(c) How late the loop wakes up, against cyclictest at the same priority on the same core, in turns: idle, and loaded."""

import os
import re
import shutil
import subprocess
import time

import numpy as np

from bench.figures import Figure, Target, compare, in_turns
from bench.load import busy_cores
from bench.real_time import BenchOperator, records_of
from rtctl.commands import Verb
from rtctl.settings import Settings

PART = "wake-up"
TARGETS = {50.0: Target(1.15), 99.0: Target(1.25), 99.9: Target(2.0)}
PERCENTILES = tuple(TARGETS)
LONGEST_NS = 1_000_000
"""The histogram of cyclictest has bins of 1 ns up to here; what is later counts as this."""
BIN = re.compile(r"^(\d+)\s+(\d+)\s*$", re.MULTILINE)
OVERFLOWS = re.compile(r"^# Histogram Overflows:\s*(\d+)", re.MULTILINE)


def measure(settings: Settings, rounds: int, seconds: float) -> list[Figure]:
    """Ratios of the percentiles of the lateness, round by round; each is that of one run of `seconds`."""
    obstacle = _obstacle(settings)
    if obstacle:
        return [Figure(PART, f"lateness p{p:g}", "us", None, target=TARGETS[p], note=obstacle) for p in PERCENTILES]
    figures = _compared(settings, rounds, seconds, "idle")
    with busy_cores():
        return figures + _compared(settings, rounds, seconds, "all cores loaded")


def _compared(settings: Settings, rounds: int, seconds: float, condition: str) -> list[Figure]:
    ours, theirs = in_turns(rounds, lambda: _ours_us(settings, seconds), lambda: _cyclictest_us(settings, seconds))
    return [
        compare(
            PART,
            f"lateness p{percent:g}, {condition}",
            "us",
            [round_us[k] for round_us in ours],
            [round_us[k] for round_us in theirs],
            reference_name="cyclictest",
            target=TARGETS[percent],
            note=f"{rounds} rounds of {seconds:g} s",
        )
        for k, percent in enumerate(PERCENTILES)
    ]


def _obstacle(settings: Settings) -> str:
    """Why there is nothing to compare with; empty if there is."""
    if shutil.which("cyclictest") is None:
        return "skipped: no cyclictest on this machine (Debian: rt-tests)"
    result = subprocess.run(_cyclictest(settings, 1), capture_output=True, text=True)
    return f"skipped: {result.stderr.strip() or 'cyclictest failed'}" if result.returncode else ""


def _ours_us(settings: Settings, seconds: float) -> np.ndarray:
    """Percentiles of the lateness [us] of a run that enables, homes and holds; every tick counts."""

    def script(operator: BenchOperator) -> None:
        end_s = time.monotonic() + seconds
        operator.command(Verb.ENABLE)
        operator.wait(lambda record: record["powered"], seconds)
        operator.command(Verb.HOME)
        operator.wait(lambda _: False, end_s - time.monotonic())

    return np.percentile(records_of(settings, script)["lateness_ns"], PERCENTILES) * 1e-3


def _cyclictest_us(settings: Settings, seconds: float) -> np.ndarray:
    """The same of a run of cyclictest."""
    loops = round(seconds / settings.loop.period_s)
    text = subprocess.run(_cyclictest(settings, loops), capture_output=True, text=True, check=True).stdout
    bins = np.array([(int(ns), int(count)) for ns, count in BIN.findall(text) if count.strip("0")]).reshape(-1, 2)
    late = [(LONGEST_NS, int(n)) for n in OVERFLOWS.findall(text)]
    lateness_ns, counts = np.concatenate([bins, np.array(late).reshape(-1, 2)]).T
    return np.percentile(np.repeat(lateness_ns, counts), PERCENTILES) * 1e-3


def _cyclictest(settings: Settings, loops: int) -> list[str]:
    """One thread, memory locked, at the priority, the period and on the core of the loop; a histogram at the end."""
    core = settings.loop.cpu if settings.loop.cpu >= 0 else max(os.sched_getaffinity(0))
    interval_us = round(settings.loop.period_s * 1e6)
    options = f"-m -q -N -p {settings.loop.priority} -i {interval_us} -l {loops} -h {LONGEST_NS} -a {core} -t 1"
    return ["cyclictest", *options.split()]
