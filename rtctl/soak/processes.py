"""What the processes of a daemon hold, looked at from outside: memory, descriptors, threads, shared memory, disk."""

import os
import time
from dataclasses import dataclass
from pathlib import Path

MODULES = {"supervisor": "", "real-time": "rtctl.realtime", "gateway": "rtctl.gateway"}


@dataclass(frozen=True)
class Sample:
    """One process at one moment. Sizes in KiB."""

    time_s: float
    role: str
    pid: int
    resident_kib: int
    shared_kib: int
    threads: int
    descriptors: int


def children(supervisor: int) -> dict[str, int]:
    """Role -> process id of the supervisor and its children that live; of several gateways the newest."""
    found = {"supervisor": supervisor}
    for entry in Path("/proc").iterdir():
        if not entry.name.isdigit():
            continue
        try:
            state, parent = (entry / "stat").read_text().rsplit(")", 1)[1].split()[:2]
            words = (entry / "cmdline").read_text().split("\0")
        except OSError:  # it has just ended
            continue
        if int(parent) == supervisor and state != "Z":
            for role, module in MODULES.items():
                if module and module in words:
                    found[role] = max(found.get(role, 0), int(entry.name))
    return found


def sample(role: str, pid: int) -> Sample | None:
    """Look at a process; None if it has ended."""
    try:
        status = dict(line.split(":", 1) for line in Path(f"/proc/{pid}/status").read_text().splitlines())
        descriptors = len(os.listdir(f"/proc/{pid}/fd"))  # noqa: PTH208  # a count, no paths
        numbers = [int(status[name].split()[0]) for name in ("VmRSS", "RssShmem", "Threads")]
    except (OSError, KeyError):  # gone, or a zombie, which has no memory
        return None
    return Sample(time.monotonic(), role, pid, numbers[0], numbers[1], numbers[2], descriptors)


def size_bytes(directory: Path) -> int:
    """What the files of a folder take."""
    return sum(file.stat().st_size for file in directory.iterdir() if file.is_file())
