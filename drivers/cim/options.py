"""Settings of the device kind "cim"."""

from dataclasses import dataclass

from hal.errors import OptionError
from hal.options import option


@dataclass(frozen=True)
class CimOptions:
    """Where the telemetry comes from, how it is laid out, and which pair is which."""

    peer: str = option(doc='the only sender that is listened to, "address:port"')
    local: str = option(doc='where it sends to: an address of this machine, "address:port"')
    decoder: str = option("icz1", doc="layout of the datagrams: an entry point of rtctl.cim_decoders")
    decoder_options: dict = option({}, doc="options of the layout, as its own reference says")
    pair_step: int = option(1, low=1, high=2, doc="as impedance.pair_step: 1 is BP+0, 21 pairs; 2 is BP+1, 20 pairs")
    tip_electrode: int = option(22, low=1, high=22, doc="number of the apical electrode: 22 on Nucleus arrays, else 1")
    sample_period_s: float = option(0.07, low=0.001, high=1.0, unit="s", doc="from sample to sample of the sender")
    late_s: float = option(0.21, low=0.01, high=10.0, unit="s", doc="silence of the link that is reported")
    silent_s: float = option(0.5, low=0.02, high=10.0, unit="s", doc="silence of the link that makes it invalid")
    frozen_sweeps: int = option(
        3, low=2, high=100, doc="sweeps that repeat one before, bit by bit, and are not believed"
    )
    record_to: str = option("", doc="directory for recordings of all raw datagrams; empty for none")

    def check(self, where: str) -> None:
        """What bounds alone cannot say. Raises OptionError."""
        if self.tip_electrode not in (1, 22):
            raise OptionError(f"{where}.tip_electrode is neither end of the array", value=self.tip_electrode, bound="1 | 22")  # fmt: skip
        if not self.sample_period_s < self.late_s < self.silent_s:
            raise OptionError(f"{where}: the limits of silence are in the wrong order", value=f"late_s = {self.late_s:g}, silent_s = {self.silent_s:g}", bound=f"sample_period_s = {self.sample_period_s:g} < late_s < silent_s")  # fmt: skip
