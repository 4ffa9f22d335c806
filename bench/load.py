"""Work for the machine beside what is measured: children at normal priority, started here and ended by their number."""

import contextlib
import os
import subprocess
import sys
from collections.abc import Iterator

BUSY = "from rtctl.machine import die_with_parent\ndie_with_parent()\nwhile True:\n    sum(range(1000))\n"


@contextlib.contextmanager
def busy_cores() -> Iterator[None]:
    """Every core this process may use is kept busy by a child of its own, at SCHED_OTHER, niceness 0."""
    children = []
    try:
        for core in sorted(os.sched_getaffinity(0)):
            children.append(subprocess.Popen([sys.executable, "-c", BUSY]))
            os.sched_setaffinity(children[-1].pid, {core})
        yield
    finally:
        for child in children:
            child.kill()
            child.wait()
