"""Notices the end of the real-time process."""

import os
import select
import time

PERIOD_S = 0.1


class ProcessWatch:
    """Watches the process with a given number; a zombie counts as dead."""

    def __init__(self) -> None:
        self._pid, self._fd, self._dead, self._next_s = 0, -1, False, 0.0

    def died(self, pid: int) -> bool:
        """True once process `pid` has ended; 0 is nobody, who cannot end. Looks ten times a second."""
        now = time.monotonic()
        if pid != self._pid:
            self._open(pid)
        elif not self._dead and self._fd >= 0 and now >= self._next_s:
            self._next_s = now + PERIOD_S
            self._dead = bool(select.select([self._fd], [], [], 0)[0])
        return self._dead

    def close(self) -> None:
        """Stop watching."""
        if self._fd >= 0:
            os.close(self._fd)
            self._fd = -1

    def _open(self, pid: int) -> None:
        self.close()
        self._pid, self._dead = pid, False
        if pid:
            try:
                self._fd = os.pidfd_open(pid)
            except ProcessLookupError:
                self._dead = True
