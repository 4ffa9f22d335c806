"""What can be known of the machine around a tick over budget."""

from collections.abc import Mapping
from dataclasses import dataclass, field

Counts = Mapping[str, int]
STEP_MS = 10.0
"""The kernel counts stolen time in steps of this."""


@dataclass(frozen=True)
class Counters:
    """What the system had counted when tick `tick` was the last; None where this kernel does not say.

    steal_ms, interrupts and softirqs are those of the loop's core, run_wait_ms and collections those of its thread.
    """

    tick: int
    steal_ms: float | None = None
    run_wait_ms: float | None = None
    interrupts: Counts | None = None
    softirqs: Counts | None = None
    collections: int = 0
    """of garbage, by the interpreter of the loop"""

    def since(self, before: "Counters") -> "Counters":
        """What was added since `before`; `tick` is the number of ticks between."""
        return Counters(
            self.tick - before.tick,
            _less(self.steal_ms, before.steal_ms),
            _less(self.run_wait_ms, before.run_wait_ms),
            _each_less(self.interrupts, before.interrupts),
            _each_less(self.softirqs, before.softirqs),
            self.collections - before.collections,
        )


@dataclass(frozen=True)
class Thread:
    """One thread as the system shows it: state R runs or wants to, S sleeps, D waits for a disk, T is stopped."""

    pid: int
    name: str
    state: str
    core: int
    priority: int
    """of SCHED_FIFO or SCHED_RR; 0 for all others"""
    deadline: bool = False
    """SCHED_DEADLINE, which comes before every priority"""

    def __str__(self) -> str:
        kind = "deadline" if self.deadline else f"real-time priority {self.priority}" if self.priority else "normal"
        return f"{self.name} (pid {self.pid}, {kind})"

    def may_displace(self, other: "Thread") -> bool:
        """It wants the core of `other`, and the scheduler may give it to it."""
        wants = self.state == "R" and self.core == other.core and self.pid != other.pid
        return wants and (self.deadline or self.priority >= other.priority)


@dataclass(frozen=True)
class Sighting:
    """The loop's thread, seen while no record came after that of `tick`, and who might have its core."""

    tick: int
    loop: Thread
    rivals: tuple[Thread, ...] = ()


@dataclass(frozen=True)
class Evidence:
    """Everything beside the records themselves.

    Attributes:
        counted: what was counted over some ticks around the one over budget; None if nobody looked.
        usual: the same over ticks before those.
        sightings: of the loop while it was held.
        frequency_mhz: of the loop's core, now and at most; None where this kernel does not say.
        virtual: the machine is a virtual one.
    """

    counted: Counters | None = None
    usual: Counters | None = None
    sightings: tuple[Sighting, ...] = field(default=())
    frequency_mhz: tuple[float, float] | None = None
    virtual: bool = False


def _less(now: float | None, before: float | None) -> float | None:
    return None if now is None or before is None else now - before


def _each_less(now: Counts | None, before: Counts | None) -> Counts | None:
    return None if now is None or before is None else {name: count - before.get(name, 0) for name, count in now.items()}
