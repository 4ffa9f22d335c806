"""Everything that may hold a loop: how one sees it, in what words one says it, and what to do about it."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from rtctl.attribution.budget import BETWEEN, WAKE_UP, Hold
from rtctl.attribution.evidence import STEP_MS, Counters, Evidence, Sighting
from rtctl.stages import USUAL_SWITCHES

MINOR_FAULT_NS = 10_000
"""What a page fault without disk costs at most."""
ENOUGH = 0.5
"""Share of the hold that a cause must account for to be named as the one."""
UNUSUAL = 5.0
"""Interrupts so many times as frequent as before are worth a word,"""
MANY = 50
"""and if there were more than this of them."""
SLOW = 0.7
"""A core below this share of its highest frequency is worth a word."""
OF_DEVICES = ("read", "write")
MAY_SLEEP = (*OF_DEVICES, "prepare", BETWEEN)
"""Parts that are not compiled code of ours from end to end."""


@dataclass(frozen=True)
class Case:
    """One tick over budget: its longest part, its record and the one before (if known), what is usual, and the rest."""

    hold: Hold
    row: Any
    before: Any
    usual_switches: int
    evidence: Evidence

    @property
    def where(self) -> str:
        """The part, to follow a verb."""
        return {WAKE_UP: "before it woke up", BETWEEN: "between two ticks"}.get(self.hold.part, f"in {self.hold.part}")

    @property
    def sightings(self) -> list[Sighting]:
        """Of the loop before this record was out."""
        first = -1 if self.before is None else int(self.before["tick"]) - 1
        return [s for s in self.evidence.sightings if first <= s.tick < int(self.row["tick"])]

    @property
    def counted(self) -> Counters:
        """What was counted around it; nothing known if nobody looked."""
        return self.evidence.counted or Counters(0)

    def accounts(self, ms: float | None) -> bool:
        """So much time is enough to explain it."""
        return ms is not None and 1e6 * ms >= ENOUGH * self.hold.held_ns

    @property
    def run_wait_ms(self) -> float | None:
        """Time the thread wanted its core and did not have it, beyond what is usual; None if it is not known."""
        wait, usual = self.counted.run_wait_ms, self.evidence.usual
        if wait is None or usual is None or usual.run_wait_ms is None or usual.tick <= 0:
            return wait
        return max(0.0, wait - usual.run_wait_ms * self.counted.tick / usual.tick)

    def slept(self) -> int:
        """Times the thread went to sleep beside the wait for the tick; before that, beside what it does in every tick."""
        usual = max(USUAL_SWITCHES, self.usual_switches) if self.hold.part == WAKE_UP else USUAL_SWITCHES
        return max(0, int(self.row["voluntary_switches"]) - usual)


@dataclass(frozen=True)
class Cause:
    """One thing that may hold a loop. `found` says it in words, or is empty when there is no sign of it."""

    name: str
    found: Callable[[Case], str]
    remedy: str
    hint: bool = False
    """it may have made things worse, but does not explain them"""


def _stopped(case: Case) -> str:
    if any(s.loop.state in "Tt" for s in case.sightings):
        return "its process was seen stopped (SIGSTOP, SIGTSTP or a debugger)"
    if case.slept() and case.hold.part not in MAY_SLEEP:
        return f"it was put to sleep {case.where}: its process was stopped (a signal, a debugger, a freezer)"
    return ""


def _displaced(case: Case) -> str:
    seen = {str(rival): rival for s in case.sightings for rival in s.rivals if rival.may_displace(s.loop)}
    if seen:
        return f"{' and '.join(seen)} ran on core {int(case.row['core'])} in its place"
    times, waited = int(case.row["involuntary_switches"]), case.run_wait_ms
    wait = "" if waited is None else f" (run-queue wait {waited:.1f} ms)"
    if times:
        often = "" if times == 1 else f" {times} times"
        return f"another thread took core {int(case.row['core'])} away from it{often}{wait}"
    return f"another thread ran on core {int(case.row['core'])}{wait}" if case.accounts(waited) else ""


def _slept(case: Case) -> str:
    times = case.slept()
    if not times or case.hold.part not in MAY_SLEEP:
        return ""
    disk = ", for a disk" if any(s.loop.state == "D" for s in case.sightings) else ""
    who = "the driver of a device waited" if case.hold.part in OF_DEVICES else "something was waited for"
    return f"it went to sleep {'once' if times == 1 else f'{times} times'} {case.where}{disk}: {who}"


def _major(case: Case) -> str:
    count = int(case.row["major_faults"])
    return f"{_plural(count, 'page fault')} with disk access {case.where}" if count else ""


def _minor(case: Case) -> str:
    count = int(case.row["minor_faults"])
    enough = count * MINOR_FAULT_NS >= ENOUGH * case.hold.held_ns
    return f"{_plural(count, 'page fault')} {case.where}" if enough else ""


def _few_minor(case: Case) -> str:
    count = int(case.row["minor_faults"])
    return f"{_plural(count, 'page fault')}, too few to explain it" if count and not _minor(case) else ""


def _stolen(case: Case) -> str:
    stolen = case.counted.steal_ms
    if not stolen or not case.accounts(stolen):
        return ""
    return f"the host stole {stolen:.0f} ms from core {int(case.row['core'])} within {case.counted.tick} ticks, in steps of {STEP_MS:.0f} ms"


def _collected(case: Case) -> str:
    count = case.counted.collections
    return f"the interpreter collected garbage, {_plural(count, 'time')}: it is switched on" if count else ""


def _worked(case: Case) -> str:
    switched = case.row["voluntary_switches"] != USUAL_SWITCHES or case.row["involuntary_switches"]
    if case.hold.part not in MAY_SLEEP or switched or _major(case) or _minor(case):
        return ""
    who = {"prepare": "the planner", BETWEEN: "the interpreter"}.get(case.hold.part, "the driver of a device")
    return f"it neither slept nor lost its core: {who} worked that long, unless the core itself stood still"


def _moved(case: Case) -> str:
    if case.before is None or case.before["core"] == case.row["core"]:
        return ""
    return f"it was moved from core {int(case.before['core'])} to {int(case.row['core'])}"


def _interrupted(case: Case) -> str:
    counted, usual = case.counted, case.evidence.usual
    if usual is None or counted.tick <= 0 or usual.tick <= 0:
        return ""
    loud = []
    for now, before in ((counted.interrupts, usual.interrupts), (counted.softirqs, usual.softirqs)):
        for name, count in (now or {}).items():
            expected = (before or {}).get(name, 0) * counted.tick / usual.tick
            if count > max(MANY, UNUSUAL * expected):
                loud.append(f"{name} {count} (usually {expected:.0f})")
    if not loud:
        return ""
    return f"unusually many interrupts on core {int(case.row['core'])} within {counted.tick} ticks: {', '.join(loud)}"


def _slow_core(case: Case) -> str:
    if case.evidence.frequency_mhz is None:
        return ""
    now, highest = case.evidence.frequency_mhz
    return f"core {int(case.row['core'])} ran at {now:.0f} of {highest:.0f} MHz" if now < SLOW * highest else ""


def _plural(count: int, what: str) -> str:
    return f"{count} {what}{'' if count == 1 else 's'}"


CAUSES = (
    Cause("stopped", _stopped, "never stop or debug the real-time process while it runs"),
    Cause("displaced", _displaced, "give the loop the highest priority and a core of its own (`rtctl doctor`)"),
    Cause("slept", _slept, "a driver must not wait in read or write: let it answer with what it has, and the age of that"),
    Cause("disk", _major, "let the process lock its memory (LimitMEMLOCK=infinity), and do not swap"),
    Cause("page faults", _minor, "let the process lock its memory (LimitMEMLOCK=infinity)"),
    Cause("collected", _collected, "leave the garbage collector of the real-time process off: a driver has switched it on"),
    Cause("stolen", _stolen, "run on a machine of its own: no virtual one keeps time when its host is busy"),
    Cause("worked", _worked, "measure that stage with `make bench`; what always needs so long needs a slower loop"),
    Cause("moved", _moved, "bind the loop to a core (loop.cpu), and allow it in the affinity it is started with", hint=True),
    Cause("interrupts", _interrupted, "keep interrupts off the loop's core (irqaffinity, `rtctl doctor`)", hint=True),
    Cause("few page faults", _few_minor, "let the process lock its memory (LimitMEMLOCK=infinity)", hint=True),
    Cause("slow core", _slow_core, "choose the governor `performance`", hint=True),
)  # fmt: skip
"""Strongest sign first: what was seen, then what was counted for this tick, then what was counted around it."""
