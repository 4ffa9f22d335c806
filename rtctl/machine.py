"""What a real-time process asks of the machine, asserted and graded (design section 4)."""

import ctypes
import gc
import os
import struct
from dataclasses import asdict, dataclass
from pathlib import Path

from hal.kernel import compiled_here
from rtctl.exchange.control import Grade
from rtctl.settings import Loop

LOCK_NOW_AND_LATER = 3
SET_DEATH_SIGNAL, SIGTERM = 1, 15


@dataclass(frozen=True)
class Check:
    """One thing real time needs, what was found, and how to get it."""

    name: str
    obtained: str
    good: bool
    remedy: str


def loop_core(cpu: int) -> int:
    """The core that `loop.cpu` names; -1 is the last one this process may use."""
    return cpu if cpu >= 0 else max(os.sched_getaffinity(0))


class Machine:
    """Takes hold of the machine for the calling thread; keep it alive as long as the loop runs.

    Nothing here raises: what cannot be had is a failed check and a lower grade.
    """

    def __init__(self, loop: Loop) -> None:
        self._dma_latency: int | None = None
        self.checks = [
            self._schedule(loop.priority),
            self._bind(loop.cpu),
            self._hold_dma_latency(),
            self._kernel(),
            self._threads(),
            self._collect(),
            self._lock_memory(),
        ]

    def grade(self) -> Grade:
        """RT if everything was obtained and nothing had to be compiled in this process, else BEST_EFFORT."""
        return Grade.RT if all(c.good for c in self.report()) else Grade.BEST_EFFORT

    def report(self) -> list[Check]:
        """All checks, the compiler's last: it depends on what has run since."""
        new = compiled_here()
        remedy = "run `rtctl warmup` at install; the cache must be writable then"
        return [*self.checks, Check("kernels from the cache", f"compiled: {', '.join(new) or 'none'}", not new, remedy)]

    def as_table(self) -> list[dict[str, object]]:
        """The report as plain data for the run directory."""
        return [asdict(c) for c in self.report()]

    def _schedule(self, priority: int) -> Check:
        remedy = "run as root, or give LimitRTPRIO= to the unit (see docs/how-to/bring-up-a-target-pc.md)"
        try:
            os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(priority))
        except OSError as error:
            return Check("SCHED_FIFO", str(error.strerror), False, remedy)
        good = os.sched_getscheduler(0) == os.SCHED_FIFO
        return Check("SCHED_FIFO", f"priority {os.sched_getparam(0).sched_priority}", good, remedy)

    def _bind(self, cpu: int) -> Check:
        count, chosen = os.cpu_count() or 1, loop_core(cpu)
        remedy = f"set loop.cpu to one of 0 .. {count - 1}; real time wants two cores or more"
        try:
            os.sched_setaffinity(0, {chosen})  # an isolated core is not among those inherited, but may be taken
        except OSError:
            return Check("own core", f"core {chosen} is not to be had", False, remedy)
        return Check("own core", f"core {chosen} of {count}", count > 1, remedy)

    def _hold_dma_latency(self) -> Check:
        """Deep idle states end while the file stays open with a zero in it."""
        try:
            self._dma_latency = os.open("/dev/cpu_dma_latency", os.O_WRONLY)
            os.write(self._dma_latency, struct.pack("i", 0))
        except OSError as error:
            return Check(
                "cpu_dma_latency", str(error.strerror), False, "run as root, or allow writing /dev/cpu_dma_latency"
            )
        return Check("cpu_dma_latency", "held at 0 us", True, "")

    def _kernel(self) -> Check:
        flag = Path("/sys/kernel/realtime")
        good = flag.exists() and flag.read_text().strip() == "1"
        return Check("PREEMPT_RT kernel", "yes" if good else "no", good, "install a PREEMPT_RT kernel")

    def _threads(self) -> Check:
        count = len(os.listdir("/proc/self/task"))  # noqa: PTH208
        return Check("one thread", str(count), count == 1, "set OPENBLAS_NUM_THREADS=1 and OMP_NUM_THREADS=1")

    def _collect(self) -> Check:
        gc.collect()
        gc.freeze()
        gc.disable()
        return Check("garbage collector off", str(not gc.isenabled()), not gc.isenabled(), "")

    def _lock_memory(self) -> Check:
        result = ctypes.CDLL(None, use_errno=True).mlockall(LOCK_NOW_AND_LATER)
        remedy = "run as root, or give LimitMEMLOCK=infinity to the unit"
        if result != 0:
            return Check("memory locked", os.strerror(ctypes.get_errno()), False, remedy)
        locked = next(line for line in Path("/proc/self/status").read_text().splitlines() if line.startswith("VmLck"))
        return Check("memory locked", locked.split(":")[1].strip(), not locked.endswith(" 0 kB"), remedy)


def die_with_parent() -> None:
    """Ask the kernel for SIGTERM when the parent ends, however it ends: no loop without a supervisor."""
    ctypes.CDLL(None).prctl(SET_DEATH_SIGNAL, SIGTERM)
