"""Which pair of contacts two electrodes are: electrodes by the manufacturer's numbers, pairs counted from the tip.

Electrode 22 of a Nucleus array is the apical one; `tip_electrode` says 1 for arrays that are numbered the other way. Contact c
counts from the tip, 0 to 21, and pair k is contacts k and k + `pair_step`, as in the controller's `impedance.pair_step`: 1 for
BP+0, 21 pairs, 2 for BP+1, 20 pairs.
"""

from dataclasses import dataclass

from drivers.cim.sample import ELECTRODES, Sample


@dataclass(frozen=True)
class Pairs:
    """The pairs of a sweep."""

    step: int
    tip_electrode: int

    @property
    def count(self) -> int:
        """How many there are."""
        return ELECTRODES - self.step

    def contact(self, electrode: int) -> int:
        """Contact 0 .. 21 from the tip, of an electrode 1 .. 22."""
        return ELECTRODES - electrode if self.tip_electrode == ELECTRODES else electrode - 1

    def pair_of(self, sample: Sample) -> int:
        """The pair that was measured, -1 if it is none of the sweep.

        A layout without the return electrode means BP+n, where the return is the electrode `step` numbers higher.
        """
        back = sample.active + self.step if sample.back is None else sample.back
        if not 1 <= back <= ELECTRODES:
            return -1
        one, other = self.contact(sample.active), self.contact(back)
        return min(one, other) if abs(one - other) == self.step else -1
