"""How often something went wrong with a device, for the line it has in ``rtctl devices``."""

from hal.device import Readings
from hal.troubles import Trouble

LONG_AGO = -(2**31)


class Tally:
    """Reports troubles, and counts how often each of them began.

    Attributes:
        errors: how often, by the trouble's name in lower case.
    """

    def __init__(self) -> None:
        self.errors: dict[str, int] = {}
        self._seen: dict[Trouble, int] = {}

    def report(self, tick: int, readings: Readings, trouble: Trouble, value: float) -> None:
        """Put `trouble` into the readings; it is a new one unless it was there the tick before."""
        readings.report(trouble, value)
        if tick - self._seen.get(trouble, LONG_AGO) > 1:
            self.errors[trouble.name.lower()] = self.errors.get(trouble.name.lower(), 0) + 1
        self._seen[trouble] = tick
