"""Declared load: work of our own beside the loop, at normal priority.

    python -m rtctl.readiness.load KIND CORE FOLDER

is one process of it, which ends with its parent.
"""

import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Any

from hal.errors import RtctlError
from rtctl.readiness.facts import Facts, Unreadable

COPIED_BYTES = 64 * 2**20
WRITTEN_BYTES = 16 * 2**20
READY = "ready"
USER, SYSTEM = 11, 12
"""Columns of /proc/PID/stat after the name: time of the processor."""


class LoadError(RtctlError):
    """The load is not what was declared."""


@dataclass(frozen=True)
class Kind:
    """One kind of load."""

    what: str
    works: tuple[str, ...]
    """of one process each, on every core but for the disk"""


KINDS = {
    "idle": Kind("nothing of ours", ()),
    "cpu": Kind("on every core a process that computes", ("cpu",)),
    "memory": Kind("on every core a process that copies 64 MiB to and fro", ("memory",)),
    "disk": Kind("a process that writes files of 16 MiB and waits until each is on the disk", ("disk",)),
    "all": Kind("on every core one process that computes and one that copies 64 MiB to and fro, and one that writes files of 16 MiB to the disk", ("cpu", "memory", "disk")),
}  # fmt: skip


class Load:
    """Runs a kind of load while the context lasts.

    Args:
        kind: name in KINDS.
        folder: on the disk that is to be written to.
        loop_core: gets its share, also where it is isolated.
    """

    def __init__(self, kind: str, folder: Path, loop_core: int) -> None:
        self.kind, self._folder = kind, folder
        self._cores = sorted(os.sched_getaffinity(0) | {loop_core})
        self._processes: list[subprocess.Popen[str]] = []

    def __enter__(self) -> "Load":
        self._scratch = tempfile.TemporaryDirectory(dir=self._folder, prefix="load-")
        try:
            for work in KINDS[self.kind].works:
                for core in self._cores if work != "disk" else [-1]:
                    command = [sys.executable, "-m", __name__, work, str(core), self._scratch.name]
                    # a process group of its own: Ctrl-C reaches us, and we end it
                    self._processes.append(subprocess.Popen(command, stdout=subprocess.PIPE, text=True, process_group=0))  # fmt: skip
            for process in self._processes:
                assert process.stdout is not None
                if process.stdout.readline().strip() != READY:
                    raise LoadError("a process of the load did not start", value=self.kind, remedy="see above")
        except BaseException:
            self._end()
            raise
        self._begun_s = time.monotonic()
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:  # fmt: skip
        self._end()

    def check(self) -> None:
        """Raises LoadError if a process of the load has ended."""
        dead = [p.returncode for p in self._processes if p.poll() is not None]
        if dead:
            raise LoadError("a process of the load has ended", value=dead, remedy="see above; certify anew")

    def declared(self) -> dict[str, Any]:
        """What runs beside the loop, and the time of the processors it has used of all time; None if nobody tells."""
        return {
            "kind": self.kind,
            "what": KINDS[self.kind].what,
            "processes": len(self._processes),
            "cores": self._cores,
            "used_s": self._used_s(),
            "lasted_s": round(time.monotonic() - self._begun_s, 1),
        }

    def _used_s(self) -> float | None:
        try:
            stats = [Facts().text(f"proc/{p.pid}/stat").rpartition(")")[2].split() for p in self._processes]
        except Unreadable:
            return None
        return sum(int(words[USER]) + int(words[SYSTEM]) for words in stats) / os.sysconf("SC_CLK_TCK")

    def _end(self) -> None:
        for process in self._processes:
            process.kill()
        for process in self._processes:
            process.communicate()
        self._scratch.cleanup()


def compute() -> Callable[[], object]:
    """Nothing but arithmetic."""
    return lambda: sum(range(100_000))


def copy() -> Callable[[], object]:
    """More memory than the caches hold."""
    first = bytearray(os.urandom(2**20) * (COPIED_BYTES // 2**20))
    second = bytearray(COPIED_BYTES)

    def once() -> None:
        second[:], first[:] = first, second

    return once


def write(folder: Path) -> Callable[[], object]:
    """Files that are overwritten again and again."""
    content, file = os.urandom(WRITTEN_BYTES), folder / "written"

    def once() -> None:
        with file.open("wb") as target:
            target.write(content)
            os.fsync(target.fileno())

    return once


def main() -> int:
    """Work until the parent is gone."""
    kind, core, folder = sys.argv[1], int(sys.argv[2]), Path(sys.argv[3])
    parent = os.getppid()
    if core >= 0:
        os.sched_setaffinity(0, {core})
    work = {"cpu": compute, "memory": copy, "disk": lambda: write(folder)}[kind]()
    work()
    print(READY, flush=True)
    while os.getppid() == parent:
        work()
    return 0


if __name__ == "__main__":
    sys.exit(main())
