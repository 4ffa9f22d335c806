"""What raw gauge signals tell of a transducer before anybody computes a force (07 sections 0, 3.3, 7).

One gauge at its rail spoils all six components, and a cut cable drives every gauge there: hence raw signals, never
resolved forces. Gauges are counted from 1.
"""

import math

GAUGES = 6
SETTLED = 5
"""Samples in a row without any gauge at its rail before a wrench is trusted again; the first at the rail ends trust."""
MEMORY = 1.0 / 256
"""Weight of a sample in the running mean of squares."""


class Gauges:
    """Follows six gauges sample by sample; a repeated sample must not be given again.

    Attributes:
        railed, frozen: number of such a gauge, 0 for none.
        all_railed: every gauge is.
        settled: no gauge was at its rail for some samples.
        noise_v: rms of the noisiest gauge. It is taken from the differences of neighbouring samples, each of which counts
            to a bound only: neither a load that changes slowly nor a blow is noise.

    Args:
        frozen_samples: so many equal words in a row are no accident.
        noise_limit_v: what the noise will be compared with; larger differences count as four times that.
    """

    def __init__(self, frozen_samples: int, noise_limit_v: float) -> None:
        self._limit, self._most = frozen_samples, (4.0 * noise_limit_v) ** 2
        self._codes, self._same = [-(2**31)] * GAUGES, [0] * GAUGES
        self._volts, self._squares = [math.nan] * GAUGES, [0.0] * GAUGES
        self._clean = SETTLED
        self.railed = self.frozen = 0
        self.all_railed, self.settled, self.noise_v = False, True, 0.0

    def take(self, codes: list[int], volts: list[float], railed: list[bool]) -> None:
        """A new sample: converter words, volts, and which gauges are at their rails; six each."""
        before, same = self._codes, self._same
        self.frozen = 0
        for i, code in enumerate(codes):
            if code == before[i]:
                same[i] += 1
                if same[i] >= self._limit and not self.frozen:
                    self.frozen = i + 1
            else:
                same[i] = 0
        self._codes = codes
        if True in railed:
            self.railed, self.all_railed, self._clean = railed.index(True) + 1, False not in railed, 0
            self._volts[:] = [math.nan] * GAUGES
        else:
            self.railed, self.all_railed, self._clean = 0, False, self._clean + 1
            self._listen(volts)
        self.settled = self._clean >= SETTLED

    def _listen(self, volts: list[float]) -> None:
        last, squares = self._volts, self._squares
        if last[0] == last[0]:  # not after a gap
            for i, v in enumerate(volts):
                step = v - last[i]
                squares[i] += MEMORY * (min(step * step, self._most) - squares[i])
            self.noise_v = math.sqrt(0.5 * max(squares))
        self._volts = volts
