"""The axes that are wired to one card. The first of them that is read reads them all: eight calls cost more than two."""

import numpy as np

from drivers.maxon_lsc import watch
from drivers.maxon_lsc.state import AXIS
from hal.card import AnalogCard
from hal.device import Readings


class AxesOfCard:
    """Their states, side by side.

    Attributes:
        state (n,): of AXIS. command_v, enabled (n,): what was written last.
        held, ready, found (n,): see :func:`drivers.maxon_lsc.watch.follow`.
    """

    def __init__(self, card: AnalogCard) -> None:
        self.card = card
        self._fresh = self.state = np.zeros(0, AXIS)
        self._make()

    def _make(self) -> None:
        n = len(self._fresh)
        self.state, self.command_v, self.found = self._fresh.copy(), np.zeros(n), np.zeros(n, np.int64)
        self.enabled, self.held, self.ready = (np.zeros(n, np.bool_) for _ in range(3))
        self._tick = -1

    def add(self, state: np.ndarray) -> int:
        """Take in an axis with a fresh `state` (1,) of AXIS; returns its place."""
        self._fresh = np.concatenate([self._fresh, state])
        self._make()
        return len(self._fresh) - 1

    def restart(self, place: int) -> None:
        """Forget what was known of one axis."""
        self.state[place] = self._fresh[place]
        self.command_v[place] = self.found[place] = 0
        self.enabled[place] = self.held[place] = self.ready[place] = False
        self._tick = -1

    def exercise(self) -> None:
        """Run all that a tick runs, on states that nobody uses: what has to be compiled is compiled then."""
        other = AxesOfCard(self.card)
        other.add(self._fresh)
        other.read(0, Readings(int(self._fresh["axis"].max()) + 1))

    def read(self, tick: int, r: Readings) -> None:
        """Read all axes, unless this was done in this tick."""
        if tick == self._tick:
            return
        self._tick = tick
        c = self.card
        watch.follow(
            self.state, tick, self.command_v, self.enabled, self.held, self.ready, self.found,
            c.line, c.count_sequence, c.count_validity, c.count, c.count_error, c.index_sequence, c.index_count,
            r.axis_validity, r.axis_angle_rad, r.axis_sequence, r.axis_age_ticks, r.axis_powered, r.axis_fault,
        )  # fmt: skip
