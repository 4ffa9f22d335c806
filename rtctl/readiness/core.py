"""The loop's core: who else may run there, and what makes it slow to wake."""

import re

from rtctl.readiness.facts import Facts, Unreadable, cores_of
from rtctl.readiness.finding import Finding, costs, good

DEEP_US = 20


def isolation(facts: Facts, core: int) -> Finding:
    """Whether the scheduler keeps others away."""
    name, isolated = "isolated core", facts.cores("sys/devices/system/cpu/isolated")
    if core in isolated:
        return good(name, f"core {core} is isolated")
    return costs(name, f"core {core} is not", "other processes share its caches, and run there while the loop sleeps", f"add isolcpus=managed_irq,domain,{core} to the kernel's command line")  # fmt: skip


def quiet_kernel(facts: Facts, core: int) -> Finding:
    """Whether the kernel's own tick and callbacks stay away."""
    name, line = "kernel's tick and callbacks", facts.text("proc/cmdline")
    missing = [option for option in ("nohz_full", "rcu_nocbs") if not _names(line, option, core)]
    if not missing:
        return good(name, f"nohz_full and rcu_nocbs name core {core}")
    return costs(name, f"{' and '.join(missing)} do not name core {core}", "the kernel's housekeeping interrupts the loop, some us each", f"add nohz_full={core} rcu_nocbs={core} to the kernel's command line")  # fmt: skip


def _names(line: str, option: str, core: int) -> bool:
    value = re.search(rf"(?:^|\s){option}=(\S+)", line)
    return value is not None and (value.group(1) == "all" or core in cores_of(value.group(1), "proc/cmdline"))


def siblings(facts: Facts, core: int) -> Finding:
    """Whether another thread shares the core's arithmetic."""
    name, threads = "hyper-threading", facts.cores(f"sys/devices/system/cpu/cpu{core}/topology/thread_siblings_list")
    others = sorted(threads - {core})
    if not others:
        return good(name, f"core {core} has no sibling")
    return costs(name, f"shares its arithmetic with {', '.join(map(str, others))}", "the tick takes up to twice as long while the sibling works", "echo off > /sys/devices/system/cpu/smt/control")  # fmt: skip


def governor(facts: Facts, core: int) -> Finding:
    """Whether the frequency is left alone."""
    name, chosen = "frequency governor", facts.text(f"sys/devices/system/cpu/cpu{core}/cpufreq/scaling_governor")
    if chosen == "performance":
        return good(name, chosen)
    return costs(name, chosen, "the tick begins at a low frequency and takes longer", "cpupower frequency-set -g performance")  # fmt: skip


def idle_states(facts: Facts, core: int) -> Finding:
    """How deep the core may sleep between two ticks; the daemon holds it awake if it may write /dev/cpu_dma_latency."""
    name, deepest, deepest_us = "idle states", "none", 0
    for state in facts.folders(f"sys/devices/system/cpu/cpu{core}/cpuidle", "state*"):
        latency_us = facts.number(f"{state}/latency")
        if facts.number(f"{state}/disable") == 0 and latency_us > deepest_us:
            deepest, deepest_us = facts.text(f"{state}/name"), latency_us
    found = f"deepest {deepest}, {deepest_us} us to wake"
    if deepest_us <= DEEP_US:
        return good(name, found)
    return costs(name, found, "wake-ups are late by that much unless cpu_dma_latency is held, see below", "cpupower idle-set -D 20")  # fmt: skip


def interrupts(facts: Facts, core: int) -> Finding:
    """Which interrupts of devices may come to the core."""
    name, allowed, known = "interrupts", [], 0
    for path in facts.folders("proc/irq", "*/smp_affinity_list"):
        try:
            cores = facts.cores(path)
        except Unreadable:
            continue  # a device that has gone since
        known += 1
        if core in cores:
            allowed.append(int(path.split("/")[-2]))
    if not known:
        raise Unreadable("/proc/irq: not one interrupt tells where it goes")
    if not allowed:
        return good(name, f"none of {known} may come to core {core}")
    return costs(name, f"{len(allowed)} of {known} may come to core {core}: {', '.join(map(str, sorted(allowed)[:6]))}{' ...' if len(allowed) > 6 else ''}", "each interrupts the loop for 5 to 50 us", f"add irqaffinity={_others(facts, core)} to the kernel's command line")  # fmt: skip


def _others(facts: Facts, core: int) -> str:
    rest = sorted(facts.cores("sys/devices/system/cpu/online") - {core})
    return ",".join(map(str, rest)) or "0"
