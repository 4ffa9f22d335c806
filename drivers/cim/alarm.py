"""A rate alarm: some refused datagrams are the way of networks, many are somebody with another layout."""

from collections import deque

ALARM, ALARM_S = 3, 1.0
"""So many refused datagrams within this time are reported."""
COUNTED_MAX = 1000


class Alarm:
    """Counts events of the last second."""

    def __init__(self, period_s: float) -> None:
        self._ticks = deque[int](maxlen=COUNTED_MAX)
        self._window = round(ALARM_S / period_s)

    def note(self, tick: int, events: int = 1) -> None:
        """So many events at `tick`."""
        self._ticks.extend([tick] * min(events, COUNTED_MAX))

    def rate(self, tick: int) -> int:
        """How many there were in the second before `tick`; 0 where they are too few for an alarm."""
        while self._ticks and tick - self._ticks[0] >= self._window:
            self._ticks.popleft()
        return len(self._ticks) if len(self._ticks) >= ALARM else 0
