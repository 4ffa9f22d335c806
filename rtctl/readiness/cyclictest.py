"""cyclictest as the physical reference: what this core can do for a thread that does nothing but wake up."""

import re
import shutil
import subprocess

import numpy as np

from hal.errors import RtctlError
from rtctl.machine import loop_core
from rtctl.readiness.times import COUNTED_NS, Times
from rtctl.settings import Settings

BIN = re.compile(r"^(\d+)\s+(\d+)\s*$", re.MULTILINE)
OVERFLOWS = re.compile(r"^# Histogram Overflows:\s*(\d+)", re.MULTILINE)
LONGEST = re.compile(r"^# Max Latencies:\s*(\d+)", re.MULTILINE)


def obstacle(settings: Settings) -> str:
    """Why there is no reference on this machine; empty if there is one."""
    if shutil.which("cyclictest") is None:
        return "no cyclictest on this machine (Debian: apt-get install rt-tests)"
    result = subprocess.run(command(settings, 1), capture_output=True, text=True)
    return f"cyclictest: {result.stderr.strip() or 'it failed'}" if result.returncode else ""


def measure(settings: Settings, seconds: float) -> Times:
    """Lateness of its wake-ups at the priority, the period and on the core of the loop.

    Raises:
        RtctlError: it failed, or told nothing.
    """
    loops = round(seconds / settings.loop.period_s)
    result = subprocess.run(command(settings, loops), capture_output=True, text=True)
    if result.returncode:
        raise RtctlError("cyclictest failed", value=result.stderr.strip()[-200:], remedy="see `rtctl doctor`")
    return read(result.stdout)


def read(text: str) -> Times:
    """What cyclictest printed with a histogram in nanoseconds. Raises RtctlError if there is nothing in it.

    Of what is beyond its histogram it tells how many there were and the longest; the others count as the bound.
    """
    times = Times()
    bins = [(int(ns), int(count)) for ns, count in BIN.findall(text) if count.strip("0")]
    beyond = sum(int(n) for n in OVERFLOWS.findall(text))
    if beyond:
        bins += [(COUNTED_NS, beyond - 1), (max(int(ns) for ns in LONGEST.findall(text)), 1)]
    if not bins:
        raise RtctlError("cyclictest told nothing", value=text[-200:], remedy="run it by hand")
    times.add(*np.array(bins).T)
    return times


def command(settings: Settings, loops: int) -> list[str]:
    """One thread, memory locked, at the priority, the period and on the core of the loop; a histogram at the end."""
    interval_us = round(settings.loop.period_s * 1e6)
    options = f"-m -q -N -p {settings.loop.priority} -i {interval_us} -l {loops} -h {COUNTED_NS} -a {loop_core(settings.loop.cpu)} -t 1"
    return ["cyclictest", *options.split()]
