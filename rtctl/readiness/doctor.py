"""All looks at the machine, and the grade its real-time process will have."""

import os
import time
from collections.abc import Callable
from dataclasses import dataclass

from rtctl.exchange.control import Grade
from rtctl.readiness import core, host, kernel, packages
from rtctl.readiness.facts import Facts, Unreadable
from rtctl.readiness.finding import Finding, Verdict, costs, good, unknown
from rtctl.readiness.obtained import obtain
from rtctl.settings import Settings
from rtctl.warmup import is_warm

WATCHED_S = 1.0
"""Time between two looks at what only shows as a difference."""
MSR_REMEDY = "modprobe msr, as root, on an Intel processor"


@dataclass(frozen=True)
class Diagnosis:
    """What the machine is, and what a real-time process obtains there."""

    core: int
    findings: tuple[Finding, ...]
    grade: Grade

    @property
    def missing(self) -> list[str]:
        """What keeps the grade from RT: names of the machine's own checks that failed."""
        return [f.name for f in self.findings if f.name.startswith(OBTAINED) and f.verdict is Verdict.COSTS]


OBTAINED = "the daemon obtains: "
COST_OF = {
    "SCHED_FIFO": "under load every wake-up is late by milliseconds",
    "own core": "the loop moves between cores, with cold caches",
    "cpu_dma_latency": "the core sleeps deeply between two ticks: wake-ups twice as late",
    "PREEMPT_RT kernel": "kernel code of others can hold the core for milliseconds",
    "one thread": "a second thread can hold the interpreter when the tick is due",
    "garbage collector off": "it runs when it likes, for milliseconds",
    "memory locked": "a page fault waits for the disk",
    "kernels from the cache": "compiling takes seconds",
}


def examine(settings: Settings, facts: Facts | None = None, watched_s: float = WATCHED_S) -> Diagnosis:
    """Look at everything; nothing of the machine is changed.

    Raises:
        RtctlError: the child process that asks for real time failed.
    """
    facts = facts or Facts()
    number = settings.loop.cpu if settings.loop.cpu >= 0 else max(os.sched_getaffinity(0))
    obtained = obtain(settings)
    findings = [
        _look("preemption", lambda: kernel.preemption(facts)),
        _look("real-time throttling", lambda: kernel.throttling(facts)),
        _look("transparent huge pages", lambda: kernel.huge_pages(facts)),
        _look("clock source", lambda: kernel.clock_source(facts)),
        _look("isolated core", lambda: core.isolation(facts, number)),
        _look("kernel's tick and callbacks", lambda: core.quiet_kernel(facts, number)),
        _look("hyper-threading", lambda: core.siblings(facts, number)),
        _look("frequency governor", lambda: core.governor(facts, number)),
        _look("idle states", lambda: core.idle_states(facts, number)),
        _look("interrupts", lambda: core.interrupts(facts, number)),
        _look("virtual machine", lambda: host.hypervisor(facts)),
        *_differences(facts, number, watched_s),
        *packages.versions(),
        _compiled(settings),
        *(_obtained(check.name, check.obtained, check.good, check.remedy) for check in obtained.checks),
    ]
    return Diagnosis(number, tuple(findings), obtained.grade)


def _look(name: str, look: Callable[[], Finding], remedy: str = "") -> Finding:
    try:
        return look()
    except Unreadable as reason:
        return unknown(name, reason.what, remedy)


def _differences(facts: Facts, core: int, watched_s: float) -> list[Finding]:
    """What the host and the firmware take while we wait."""
    looks = (("stolen time", host.stolen_ticks, host.steal, ""), ("firmware interrupts (SMI)", host.smi_count, host.smi, MSR_REMEDY))  # fmt: skip
    before = [_attempt(count, facts, core) for _, count, _, _ in looks]
    time.sleep(watched_s)
    findings = []
    for (name, count, judge, remedy), first in zip(looks, before, strict=True):
        second = _attempt(count, facts, core)
        if isinstance(first, Unreadable) or isinstance(second, Unreadable):
            reason = first if isinstance(first, Unreadable) else second
            assert isinstance(reason, Unreadable)
            findings.append(unknown(name, reason.what, remedy))
        else:
            findings.append(judge(first, second, watched_s))
    return findings


def _attempt(count: Callable[[Facts, int], int], facts: Facts, core: int) -> int | Unreadable:
    try:
        return count(facts, core)
    except Unreadable as reason:
        return reason


def _compiled(settings: Settings) -> Finding:
    name = "compiled kernels"
    if is_warm(settings):
        return good(name, f"complete for {settings.robot.kind} on {settings.backend.name}")
    return costs(name, f"not complete for {settings.robot.kind} on {settings.backend.name}", "the first start takes a minute longer", "rtctl warmup")  # fmt: skip


def _obtained(name: str, found: str, is_good: bool, remedy: str) -> Finding:
    if is_good:
        return good(OBTAINED + name, found)
    return costs(OBTAINED + name, found, COST_OF.get(name, ""), remedy)
