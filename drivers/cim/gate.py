"""From a datagram to a sample that may be used: layout, electrodes, sweep, order. The device and the relay share it."""

from collections import Counter

from drivers.cim.pairs import Pairs
from drivers.cim.sample import Decoder, Refusal, Sample
from drivers.cim.stream import Stream, Verdict


class Gate:
    """Judges datagrams one after the other.

    Attributes:
        pair: of the last sample that was let through.
        refusals: how many datagrams were refused, by reason. stream: order and losses.
    """

    def __init__(self, decoder: Decoder, pairs: Pairs, sample_period_s: float) -> None:
        self._decoder, self._pairs = decoder, pairs
        self.refusals: Counter[Refusal] = Counter()
        self.stream = Stream(sample_period_s)
        self.pair = -1

    def judge(self, data: memoryview) -> tuple[Sample, Verdict] | Refusal:
        """The sample in a datagram and what it is to those before it. Never raises."""
        result = self._judge(data)
        if isinstance(result, Refusal):
            self.refusals[result] += 1
        return result

    def counts(self) -> dict[str, int]:
        """All counters by name."""
        return {**self.stream.counts, **{f"refused_{why.value}": n for why, n in self.refusals.items()}}

    def _judge(self, data: memoryview) -> tuple[Sample, Verdict] | Refusal:
        sample = self._decoder.decode(data)
        if isinstance(sample, Refusal):
            return sample
        pair = self._pairs.pair_of(sample)
        if pair < 0:
            return Refusal.PAIR
        if self.stream.is_of_another_sweep(sample):
            return Refusal.SWEEP
        self.pair = pair
        return sample, self.stream.judge(sample)
