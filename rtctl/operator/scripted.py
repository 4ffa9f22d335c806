"""An operator without hands: does what a script says, for tests and for trying a set-up without a device."""

import time
from collections.abc import Sequence

from rtctl.operator.publisher import Sample


class Scripted:
    """A device that gives each (duration [s], sample) of `script` in turn, and then ends."""

    def __init__(self, script: Sequence[tuple[float, Sample]]) -> None:
        self._script = tuple(script)
        self._begin_s: float | None = None

    def sample(self, now_s: float) -> Sample | None:
        """See :class:`rtctl.operator.publisher.Device`; the script begins with the first call."""
        if self._begin_s is None:
            self._begin_s = now_s
        left_s = now_s - self._begin_s
        for duration_s, sample in self._script:
            if left_s < duration_s:
                return sample
            left_s -= duration_s
        return None

    def wait(self, timeout_s: float) -> None:
        """Let the time pass."""
        time.sleep(timeout_s)
