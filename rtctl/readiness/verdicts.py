"""What a certificate promises, bound by bound, and whether it was kept."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

KEPT, BROKEN, UNPROVEN = "kept", "not kept", "not proven"


@dataclass(frozen=True)
class Promise:
    """One bound. `measured` gives the value from a certificate's content, None where it is not known."""

    name: str
    bound: float | str
    unit: str
    measured: Callable[[Mapping[str, Any]], float | str | None]

    def judge(self, content: Mapping[str, Any]) -> dict[str, Any]:
        """The verdict, plain values; `kept` is None for what is not known."""
        value = self.measured(content)
        if value is None:
            kept = None
        elif isinstance(value, str) or isinstance(self.bound, str):
            kept = value == self.bound
        else:
            kept = value <= self.bound
        return {"name": self.name, "bound": self.bound, "unit": self.unit, "measured": value, "kept": kept}


def _ratio(name: str) -> Callable[[Mapping[str, Any]], float | None]:
    return lambda content: content["ratios"] and content["ratios"][name]["median"]


PROMISES = (
    Promise("grade of the real-time process", "rt", "", lambda c: c["loop"]["grade"]),
    Promise("missed ticks", 0, "ticks", lambda c: c["overruns"]["missed_ticks"]),
    Promise("lateness p50 over cyclictest", 1.15, "times", _ratio("p50")),
    Promise("lateness p99 over cyclictest", 1.25, "times", _ratio("p99")),
    Promise("lateness p99.9 over cyclictest", 2.0, "times", _ratio("p99.9")),
    Promise("longest tick", 50.0, "% of the period", lambda c: round(100.0 * c["tick"]["longest_us"] / c["loop"]["period_us"], 2)),
    Promise("page faults with disk access", 0, "", lambda c: c["process"]["major_faults"]),
    Promise("growth of the resident memory in a round", 1024, "KiB", lambda c: c["process"]["growth_kib"]),
    Promise("records lost to the measurement", 0, "", lambda c: c["lost_records"]),
)  # fmt: skip


def judge(content: Mapping[str, Any]) -> dict[str, Any]:
    """`verdicts` of all promises and the `verdict` on the whole: what is incomplete or not known proves nothing."""
    verdicts = [promise.judge(content) for promise in PROMISES]
    proven = content["complete"] and all(v["kept"] is not None for v in verdicts)
    broken = any(v["kept"] is False for v in verdicts)
    return {"verdict": BROKEN if broken else KEPT if proven else UNPROVEN, "verdicts": verdicts}
