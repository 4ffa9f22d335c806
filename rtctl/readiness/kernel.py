"""The kernel: how soon it lets go of a core, what stops a real-time thread, and how the time is read."""

import re

from rtctl.readiness.facts import Facts, Unreadable
from rtctl.readiness.finding import Finding, costs, good

ACTIVE = re.compile(r"[\[(](\w+)[\])]")
"""The kernel marks the choice in force by brackets."""
FAST_CLOCKS = {"tsc", "kvm-clock", "arch_sys_counter", "hyperv_clocksource_tsc_page"}
"""Clock sources that are read without a system call."""


def preemption(facts: Facts) -> Finding:
    """The preemption model."""
    name, release = "preemption", facts.text("proc/sys/kernel/osrelease")
    try:
        if facts.number("sys/kernel/realtime") == 1:
            return good(name, f"{release}, PREEMPT_RT")
    except Unreadable:
        pass  # only a PREEMPT_RT kernel has the file; /proc/version then names the model
    model = re.search(r"PREEMPT\w*", facts.text("proc/version"))
    try:
        chosen = ACTIVE.search(facts.text("sys/kernel/debug/sched/preempt"))
    except Unreadable:
        chosen = None
    what = f"{model.group() if model else 'no preemption'}{f', {chosen.group(1)}' if chosen else ''}"
    return costs(
        name,
        f"{release}, {what}",
        "kernel code of others can hold the core for milliseconds",
        "apt-get install linux-image-rt-amd64",
    )


def throttling(facts: Facts) -> Finding:
    """How much of a second real-time threads may have."""
    name = "real-time throttling"
    runtime_us, period_us = facts.number("proc/sys/kernel/sched_rt_runtime_us"), facts.number("proc/sys/kernel/sched_rt_period_us")  # fmt: skip
    if runtime_us < 0:
        return good(name, "off")
    share = f"{runtime_us} of {period_us} us"
    if runtime_us >= 0.9 * period_us:
        return good(name, f"{share}: stops only a loop that never sleeps")
    return costs(name, share, "the loop is stopped when it has used its share", "sysctl -w kernel.sched_rt_runtime_us=950000")  # fmt: skip


def huge_pages(facts: Facts) -> Finding:
    """Whether the kernel rearranges memory by itself."""
    name, text = "transparent huge pages", facts.text("sys/kernel/mm/transparent_hugepage/enabled")
    chosen = ACTIVE.search(text)
    if chosen is None:
        raise Unreadable(f"/sys/kernel/mm/transparent_hugepage/enabled: nothing is chosen in {text[:40]!r}")
    if chosen.group(1) != "always":
        return good(name, chosen.group(1))
    return costs(name, "always", "memory is moved while the loop runs: page faults of some 10 us", "echo madvise > /sys/kernel/mm/transparent_hugepage/enabled")  # fmt: skip


def clock_source(facts: Facts) -> Finding:
    """What the clock is read from."""
    name, source = "clock source", facts.text("sys/devices/system/clocksource/clocksource0/current_clocksource")
    if source in FAST_CLOCKS:
        return good(name, source)
    return costs(name, source, "every look at the clock costs a microsecond or more", "add clocksource=tsc tsc=reliable to the kernel's command line")  # fmt: skip
