"""(c) How late the loop wakes up, against cyclictest at the same priority on the same core, in turns: idle, and loaded."""

import tempfile
from functools import partial
from pathlib import Path

import numpy as np

from bench.figures import Figure, Target, compare, in_turns
from bench.real_time import home_and_hold, records_of
from rtctl.machine import loop_core
from rtctl.readiness import cyclictest
from rtctl.readiness.load import Load
from rtctl.settings import Settings

PART = "wake-up"
TARGETS = {50.0: Target(1.15), 99.0: Target(1.25), 99.9: Target(2.0)}
PERCENTILES = tuple(TARGETS)


def measure(settings: Settings, rounds: int, seconds: float) -> list[Figure]:
    """Ratios of the percentiles of the lateness, round by round; each is that of one run of `seconds`."""
    obstacle = cyclictest.obstacle(settings)
    if obstacle:
        note = f"skipped: {obstacle}"
        return [Figure(PART, f"lateness p{p:g}", "us", None, target=TARGETS[p], note=note) for p in PERCENTILES]
    figures = _compared(settings, rounds, seconds, "idle")
    with Load("cpu", Path(tempfile.gettempdir()), loop_core(settings.loop.cpu)):
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


def _ours_us(settings: Settings, seconds: float) -> np.ndarray:
    """Percentiles of the lateness [us] of a run that enables, homes and holds; every tick counts."""
    return np.percentile(records_of(settings, partial(home_and_hold, seconds))["lateness_ns"], PERCENTILES) * 1e-3


def _cyclictest_us(settings: Settings, seconds: float) -> np.ndarray:
    """The same of a run of cyclictest."""
    times = cyclictest.measure(settings, seconds)
    return np.array([times.percentile_ns(p) for p in PERCENTILES]) * 1e-3
