"""What counts tell beyond the angle: jumps, an index that drifts, a motor that stands or runs away (07 section 7)."""

from drivers.maxon_lsc.options import LscOptions

DITHER = 1
"""Counts within which an encoder at rest, or one with a cut channel, goes to and fro."""
DRIFT_COUNTS, LOST_COUNTS = 2, 8
GROWTH = 1.25
"""A motor runs away if its way in the second half of the window is longer than in the first by this factor ..."""
GROWTH_COUNTS = 2
"""... and so many counts."""


class Encoder:
    """Follows the accumulated count of one axis since it was opened.

    Attributes:
        angle_rad, speed_rad_per_s: of the output shaft, positive in the direction of the settings.
        jumped_by: counts of the last step if that was more than the motor can turn, else 0.
    """

    def __init__(self, options: LscOptions, period_s: float) -> None:
        self._rad = options.encoder_direction / options.counts_in_rad
        self._period_s = period_s
        self._most = options.max_speed_rad_per_s * options.counts_in_rad * period_s
        self._zero: int | None = None
        self._count = 0
        self.angle_rad = self.speed_rad_per_s = 0.0
        self.jumped_by = 0

    def take(self, count: int, ticks: int) -> None:
        """A new count, `ticks` after the last one."""
        if self._zero is None:
            self._zero = self._count = count
        step = count - self._count
        self._count = count
        self.jumped_by = step if abs(step) > self._most * ticks + DITHER else 0
        self.angle_rad = self._rad * (count - self._zero)
        self.speed_rad_per_s = self._rad * step / (ticks * self._period_s)


class Index:
    """Compares where the index pulses come with where the first one came, modulo a turn of the motor."""

    def __init__(self, options: LscOptions) -> None:
        self._turn = 4 * (options.lines or 1)
        self._seen: int | None = None
        self._first: int | None = None
        self.off_by = 0

    def take(self, sequence: int, latched: int) -> None:
        """How many pulses there were, and the count at the last of them."""
        if sequence == self._seen:
            return
        if self._seen is not None:
            if self._first is None:
                self._first = latched
            half = self._turn // 2
            self.off_by = (latched - self._first + half) % self._turn - half
        self._seen = sequence


class Stall:
    """Finds a motor that is driven above breakaway and does not count."""

    def __init__(self, limit_ticks: int) -> None:
        self._limit = limit_ticks
        self._place = self._still = 0

    def take(self, count: int, push: int, ticks: int) -> bool:
        """True if it stalls; `push` is the sign of a command above breakaway, 0 below."""
        if push == 0 or abs(count - self._place) > DITHER:
            self._place, self._still = count, 0
        else:
            self._still += ticks
        return self._still >= self._limit


class WrongWay:
    """Finds a motor that runs away from its command: swapped wires of the motor or the encoder.

    While a command above breakaway keeps its sign, a motor that turns against it must slow down: breakaway is what
    overcomes friction and every load of normal use. So a motor that comes back from a motion the other way, or is driven
    back by a load, makes less way in the second half of the window than in the first, or as much. One that is wired
    wrongly makes more, by the torque that should have held it. Only way against the command is looked at.
    """

    def __init__(self, window_ticks: int) -> None:
        self._half = max(window_ticks // 2, 2)
        self._counts = [0] * (2 * self._half + 1)
        self._filled = self._push = 0

    def restart(self) -> None:
        """A sample is missing: halves would not be of the same length."""
        self._filled = 0

    def take(self, count: int, push: int) -> bool:
        """True if it runs away; counts and `push` in the same direction, one call a tick."""
        if push != self._push:
            self._push, self._filled = push, 0
        if push == 0:
            return False
        size = len(self._counts)
        self._counts[self._filled % size] = count
        self._filled += 1
        if self._filled < size:
            return False
        first, middle = self._counts[self._filled % size], self._counts[(self._filled - 1 - self._half) % size]
        before, after = push * (first - middle), push * (middle - count)
        return before >= GROWTH_COUNTS and after >= GROWTH * before + GROWTH_COUNTS
