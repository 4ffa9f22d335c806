"""(g) How many deadlines are missed at 1 to 10 kHz, and the fastest rate that is sustained, beside a C++ loop run in turn.

The C++ loop has the same tick, clock, priority and core, and neither a simulated bench nor a gateway to look after.
"""

import tempfile
from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np

from bench import c_loop
from bench.figures import Figure, Target, in_turns
from bench.native import compiler, version
from bench.real_time import home_and_hold, records_of
from bench.recorded import Piece
from rtctl.commands import Verb
from rtctl.settings import Settings

PART = "rates"
RATES_HZ = (1000, 2000, 4000, 8000, 10_000)
TARGETS = {1000: Target(2.0), 4000: Target(2.0), 10_000: Target(2.0)}
SUSTAINED = 1e-3
"""Share of the deadlines that may be missed at a rate called sustained: virtual machines stall."""


def measure(settings: Settings, pieces: Sequence[Piece], rounds: int, seconds: float) -> list[Figure]:
    """Missed deadlines of both at every rate, and the fastest rate with few of them.

    Raises:
        BenchError: the daemon did not run at a rate. subprocess.CalledProcessError: the C++ loop did not.
    """
    if compiler() is None:
        return [Figure(PART, "missed deadlines", "", None, note="skipped: no g++ on this machine")]
    insertion = next(p for p in pieces if p.verb == Verb.INSERT)
    figures, shares = [], {}
    with tempfile.TemporaryDirectory() as name:
        directory = Path(name)
        c_loop.prepare(settings, insertion, directory)
        for rate_hz in RATES_HZ:
            at = at_rate(settings, rate_hz)
            theirs_now = partial(_theirs, directory, at, round(seconds * rate_hz))
            ours, theirs = np.array(in_turns(rounds, partial(_ours, at, seconds), theirs_now))
            shares[rate_hz] = [float(m.sum() / n.sum()) for m, n in ((ours.T), (theirs.T))]
            figures.append(_figure(rate_hz, ours, theirs))
    fastest = [max((r for r in RATES_HZ if shares[r][who] <= SUSTAINED), default=0) for who in range(2)]
    note = f"the fastest of {', '.join(f'{r / 1000:g}' for r in RATES_HZ)} kHz with at most {SUSTAINED:.1%} missed"
    return [*figures, Figure(PART, "sustained rate", "Hz", fastest[0], fastest[1], _reference(), note=note)]


def at_rate(settings: Settings, rate_hz: int) -> Settings:
    """The settings at another rate, with bounds so wide that a machine that stalls does not end the run."""
    wide_ticks = 1000
    backend = replace(settings.backend, options={**settings.backend.options, "watchdog_ticks": 10 * wide_ticks})
    safety = replace(settings.safety, overrun_ticks=wide_ticks, overrun_share=1.0, power_on_ticks=5 * wide_ticks)
    return replace(settings, loop=replace(settings.loop, period_s=1.0 / rate_hz), backend=backend, safety=safety)


def _ours(settings: Settings, seconds: float) -> tuple[int, int]:
    """(missed, grid points) of a run that enables, homes and holds, after its first tick."""
    records = records_of(settings, partial(home_and_hold, seconds))
    return int(records["missed_ticks"][1:].sum()), int(records["tick"][-1] - records["tick"][0])


def _theirs(directory: Path, settings: Settings, ticks: int) -> tuple[int, int]:
    """The same of the C++ loop."""
    return c_loop.missed(directory, settings.loop, ticks), ticks


def _figure(rate_hz: int, ours: np.ndarray, theirs: np.ndarray) -> Figure:
    """Missed deadlines (rounds, 2) in a million; in the ratio one more is counted for both, for the sake of zeros."""

    def ratio(a: np.ndarray, b: np.ndarray) -> float:
        return float((a[..., 0].sum() + 1) / a[..., 1].sum() * b[..., 1].sum() / (b[..., 0].sum() + 1))

    each = [ratio(a, b) for a, b in zip(ours, theirs, strict=True)]
    low, high = (float(q) for q in np.percentile(each, (25, 75)))
    share_ppm, reference_ppm = (float(1e6 * x[:, 0].sum() / x[:, 1].sum()) for x in (ours, theirs))
    note = f"{ours[:, 0].sum():.0f} of {ours[:, 1].sum():.0f} against {theirs[:, 0].sum():.0f}; {len(ours)} rounds"
    name, target = f"missed deadlines at {rate_hz / 1000:g} kHz", TARGETS.get(rate_hz)
    whole = ratio(ours, theirs)
    return Figure(PART, name, "ppm", share_ppm, reference_ppm, _reference(), whole, (low, high), target, note)


def _reference() -> str:
    return f"g++ {version()}"
