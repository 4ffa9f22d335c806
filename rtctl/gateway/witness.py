"""Looks at the machine for the loop, from outside it: counters now and then, threads while no record comes.

Everything is read from /proc and /sys, and may be missing: then it is not known, never zero.
"""

import os
import time
from pathlib import Path

import numpy as np

from rtctl.attribution.evidence import Counters, Sighting, Thread
from rtctl.exchange.control import Word, get

CLOCK_TICK_MS = 1e3 / os.sysconf("SC_CLK_TCK")
STEAL = 8
"""Place in a line of /proc/stat."""
SCAN_S = 0.01
"""A search through all threads ends after this: the tick waits for the gateway's heartbeat."""
FIFO, RR, DEADLINE = 1, 2, 6


class Witness:
    """Watches the thread of the loop in process `Word.REAL_TIME_PID`, which has one thread only.

    control: the control words.
    proc, cpus: where the system tells about itself; another place in tests.
    """

    def __init__(
        self, control: np.ndarray, proc: Path = Path("/proc"), cpus: Path = Path("/sys/devices/system/cpu")
    ) -> None:
        self._control, self._proc, self._cpus = control, proc, cpus
        self.virtual = " hypervisor" in _read(proc / "cpuinfo")

    def keep_off(self, core: int) -> None:
        """Have the calling thread run on other cores, if there are any: on that of the loop it is held together with it."""
        others = os.sched_getaffinity(0) - {core}
        if others:
            os.sched_setaffinity(0, others)

    def tick(self) -> int:
        """The loop's last tick."""
        return int(get(self._control, Word.TICK))

    def count(self, core: int) -> Counters:
        """All counters as they are now, those of a core for `core`."""
        pid = get(self._control, Word.REAL_TIME_PID)
        wait = _read(self._proc / f"{pid}/schedstat").split()
        return Counters(
            tick=self.tick(),
            steal_ms=self._steal_ms(core),
            run_wait_ms=int(wait[1]) * 1e-6 if len(wait) == 3 else None,
            interrupts=_column(_read(self._proc / "interrupts"), core, named_by_last=True),
            softirqs=_column(_read(self._proc / "softirqs"), core),
            collections=get(self._control, Word.GARBAGE_COLLECTIONS),
        )

    def look(self) -> Sighting | None:
        """The loop's thread and those who may have its core; None if it is gone."""
        tick, pid = self.tick(), get(self._control, Word.REAL_TIME_PID)
        loop = _thread(self._proc / f"{pid}/stat")
        if loop is None:
            return None
        rivals = self._rivals(loop) if loop.state == "R" else ()
        return Sighting(tick, loop, rivals)

    def frequency_mhz(self, core: int) -> tuple[float, float] | None:
        """(now, at most) of a core; None where nobody tells."""
        folder = self._cpus / f"cpu{core}/cpufreq"
        now, highest = _read(folder / "scaling_cur_freq"), _read(folder / "cpuinfo_max_freq")
        return (int(now) * 1e-3, int(highest) * 1e-3) if now and highest else None

    def _steal_ms(self, core: int) -> float | None:
        for line in _read(self._proc / "stat").splitlines():
            words = line.split()
            if words and words[0] == f"cpu{core}" and len(words) > STEAL:
                return int(words[STEAL]) * CLOCK_TICK_MS
        return None

    def _rivals(self, loop: Thread) -> tuple[Thread, ...]:
        """Threads of others that want the core of the loop and may have it, as far as the time allows."""
        until, found = time.monotonic() + SCAN_S, []
        processes = sorted(int(name) for name in os.listdir(self._proc) if name.isdecimal())  # noqa: PTH208
        for process in reversed(processes):  # the newest first: what ran well until now did so beside the old ones
            if time.monotonic() > until:
                break
            if process != loop.pid:
                for stat in _stats_of_threads(f"{self._proc}/{process}/task"):
                    thread = _thread(stat)
                    if thread is not None and thread.may_displace(loop):
                        found.append(thread)
        return tuple(found)


def _read(path: Path | str) -> str:
    """The text of a file of the system; empty if there is none, or it may not be read."""
    try:
        with open(path, "rb", buffering=0) as file:  # noqa: PTH123
            return file.readall().decode(errors="replace")
    except OSError:
        return ""


def _stats_of_threads(tasks: str) -> list[str]:
    """Where the system tells about each thread of a process; none if it is gone."""
    try:
        return [f"{tasks}/{number}/stat" for number in os.listdir(tasks)]  # noqa: PTH208
    except OSError:
        return []


def _thread(stat: Path | str) -> Thread | None:
    """What /proc/PID/stat says; None if the thread is gone."""
    head, _, rest = _read(stat).rpartition(")")
    words = rest.split()
    if len(words) < 39:
        return None
    pid, _, name = head.partition(" (")
    policy = int(words[38])
    return Thread(
        int(pid), name, words[0], core=int(words[36]), priority=int(words[37]) if policy in (FIFO, RR) else 0,
        deadline=policy == DEADLINE,
    )  # fmt: skip


def _column(text: str, core: int, named_by_last: bool = False) -> dict[str, int] | None:
    """Counts of one core in a table of the kernel, by the name of their source; None if it has no such column."""
    lines = text.splitlines()
    cores = lines[0].split() if lines else []
    if f"CPU{core}" not in cores:
        return None
    at, counts = cores.index(f"CPU{core}"), {}
    for line in lines[1:]:
        name, _, rest = line.partition(":")
        words = rest.split()
        if len(words) >= len(cores):
            name = name.strip()
            if named_by_last and name.isdecimal() and len(words) > len(cores):
                name = f"{words[-1]} (irq {name})"
            counts[name] = int(words[at])
    return counts
