"""Settings of one axis: an encoder, a motor and its amplifier, wired to an analog card."""

import math
from dataclasses import dataclass

from hal.errors import OptionError
from hal.options import option

GAINS = {"current": "gain_a_per_v", "speed": "gain_rad_per_s_per_v", "voltage": "gain_v_per_v"}
"""The setting that says what a volt of set value means, by the amplifier's mode."""


@dataclass(frozen=True, kw_only=True)
class LscOptions:
    """Settings of a device "lsc_axis". Angles and speeds are those of the gear's output shaft."""

    axis: int = option(low=0, high=15, doc="which motor of the robot this is, counted from 0; the stylet's is the last")
    card: str = option(doc="name of the analog card it is wired to")
    counter: int = option(low=0, high=15, doc="the card's counter for the encoder")
    output: int = option(low=0, high=15, doc="the card's analog output for the set value")
    enable_line: int = option(low=0, high=31, doc="digital output to the amplifier's Enable")
    ready_line: int = option(low=0, high=31, doc="digital input, pulled up, from the amplifier's Ready")
    lines: int | None = option(None, low=1, high=100000, doc="lines of the encoder in a turn of the motor, counted x4")
    gear: float = option(1.0, low=0.01, high=100000.0, doc="turns of the motor for one of the output shaft")
    counts_per_rad: float | None = option(None, low=0.1, high=1e8, unit="1/rad", doc="instead of lines and gear")
    index: bool = option(True, doc="the encoder has an index pulse, one in a turn of the motor")
    encoder_direction: int = option(1, low=-1, high=1, doc="-1 if the count falls when the angle shall rise")
    command_direction: int = option(1, low=-1, high=1, doc="-1 if a positive set value turns the motor backwards")
    max_speed_rad_per_s: float = option(
        low=0.01, high=1e5, unit="rad/s", doc="no-load speed at full supply; more is a jump of the count"
    )

    mode: str = option(choices=tuple(GAINS), doc="what the amplifier's switches make of the set value")
    gain_a_per_v: float | None = option(None, low=1e-4, high=10.0, unit="A/V", doc="mode current")
    gain_rad_per_s_per_v: float | None = option(None, low=1e-3, high=1e4, unit="rad/s/V", doc="mode speed")
    gain_v_per_v: float | None = option(None, low=0.01, high=10.0, unit="V/V", doc="mode voltage")
    resistance_ohm: float | None = option(None, low=1e-3, high=1e4, unit="ohm", doc="of the winding, for mode voltage")
    back_emf_v_s_per_rad: float | None = option(
        None, low=0.0, high=1e4, unit="V s/rad", doc="volts at the motor for a rad/s of the output, for mode voltage"
    )
    command_limit_v: float = option(10.0, low=0.01, high=10.0, unit="V", doc="hard clamp of the set value")
    breakaway_v: float = option(
        2.0, low=0.01, high=10.0, unit="V", doc="set value that surely turns the motor; above homing.command_limit_v"
    )
    stall_s: float = option(
        0.05, low=0.005, high=1.0, unit="s", doc="above breakaway without a count for so long: stalled"
    )
    wrong_way_s: float = option(
        0.02, low=0.004, high=1.0, unit="s", doc="time over which a motor must run away to be judged"
    )

    continuous_a: float = option(low=1e-3, high=20.0, unit="A", doc="current that the motor bears for ever")
    peak_a: float = option(low=1e-3, high=40.0, unit="A", doc="largest current that is ever asked for")
    thermal_s: float = option(low=0.1, high=1e4, unit="s", doc="thermal time constant of the winding")

    def check(self, where: str) -> None:
        """What a single bound cannot say. Raises OptionError."""
        if (self.lines is None) == (self.counts_per_rad is None):
            raise OptionError(f"{where}: set either lines (with gear) or counts_per_rad", value=self.lines)
        if self.index and self.lines is None:
            raise OptionError(f"{where}: an index can only be checked with lines", remedy="set lines and gear, or index = false")  # fmt: skip
        for name in ("encoder_direction", "command_direction"):
            if getattr(self, name) == 0:
                raise OptionError(f"{where}.{name} must have a sign", value=0, bound="1 or -1")
        for mode, name in GAINS.items():
            if (getattr(self, name) is not None) != (mode == self.mode):
                raise OptionError(f"{where}: mode {self.mode} needs {GAINS[self.mode]} and no other gain", value=name)
        for name in ("resistance_ohm", "back_emf_v_s_per_rad"):
            if (getattr(self, name) is not None) != (self.mode == "voltage"):
                raise OptionError(f"{where}: {name} belongs to mode voltage", value=getattr(self, name), remedy="it must be there in this mode, and in no other")  # fmt: skip
        if self.peak_a < self.continuous_a:
            raise OptionError(
                f"{where}.peak_a is out of bounds", value=self.peak_a, bound=f"at least {self.continuous_a:g} A"
            )
        if self.breakaway_v >= self.command_limit_v:
            raise OptionError(f"{where}.breakaway_v is out of bounds", value=self.breakaway_v, bound=f"below {self.command_limit_v:g} V", remedy="a command that is never given finds no cut wire")  # fmt: skip

    @property
    def counts_in_rad(self) -> float:
        """Counts for a radian of the output shaft, whichever way they were set."""
        if self.counts_per_rad is not None:
            return self.counts_per_rad
        assert self.lines is not None  # see `check`
        return 4 * self.lines * self.gear / (2 * math.pi)
