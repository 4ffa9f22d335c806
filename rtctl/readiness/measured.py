"""What is gathered for a certificate, round by round."""

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from rtctl.readiness.times import Times
from rtctl.readiness.usage import Usage, gained

PERCENTILES = {"p50": 50.0, "p90": 90.0, "p99": 99.0, "p99.9": 99.9, "p99.99": 99.99}
COUNTED = ("minor_faults", "major_faults", "voluntary_switches", "involuntary_switches")


@dataclass
class Distribution:
    """Times of all rounds together, and the percentiles of each."""

    all: Times = field(default_factory=Times)
    rounds: list[list[float]] = field(default_factory=list)
    """(rounds, percentiles) [µs]"""

    def add_round(self, times: Times) -> None:
        """Take in the times of one more round."""
        self.all.merge(times)
        self.rounds.append(_percentiles_us(times))

    def as_table(self) -> dict[str, Any]:
        """Plain data."""
        return {
            "count": self.all.count,
            "percentiles_us": dict(zip(PERCENTILES, _percentiles_us(self.all), strict=True)),
            "longest_us": round(self.all.longest_ns * 1e-3, 3),
            "histogram": self.all.histogram(),
            "rounds_us": self.rounds,
        }


def _percentiles_us(times: Times) -> list[float]:
    return [round(times.percentile_ns(percent) * 1e-3, 3) for percent in PERCENTILES.values()]


def ratios(ours: Distribution, theirs: Distribution) -> dict[str, dict[str, float]]:
    """Ours over theirs for each percentile: median and quartiles over the rounds, and of all rounds together."""
    each = np.array(ours.rounds) / np.array(theirs.rounds)
    together = np.array(_percentiles_us(ours.all)) / np.array(_percentiles_us(theirs.all))
    quartiles = np.percentile(each, (25, 50, 75), axis=0)
    return {
        name: {
            "low_quartile": _short(quartiles[0, k]),
            "median": _short(quartiles[1, k]),
            "high_quartile": _short(quartiles[2, k]),
            "together": _short(together[k]),
        }
        for k, name in enumerate(PERCENTILES)
    }


def _short(value: float) -> float:
    return float(f"{value:.4g}")


def process_table(usages: list[tuple[Usage, Usage]]) -> dict[str, Any]:
    """The real-time process over the rounds: (begin, end) of each. None where the kernel did not tell."""
    first, last = usages[0][0], usages[-1][1]
    each = [gained(before, after) for before, after in usages]
    totals = {name: _unless_unknown([e[name] for e in each], sum) for name in COUNTED}
    return {
        "resident_begin_kib": first.resident_kib,
        "resident_end_kib": last.resident_kib,
        "growth_kib": _unless_unknown([e["resident_kib"] for e in each], max),
        "locked_kib": last.locked_kib,
        **totals,
    }


def _unless_unknown(values: list[int | None], combine: Any) -> int | None:
    known = [v for v in values if v is not None]
    return combine(known) if len(known) == len(values) else None
