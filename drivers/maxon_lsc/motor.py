"""Thermal model of a motor whose amplifier tells nothing: I2t from what was commanded (07 section 2.1)."""

from drivers.maxon_lsc.options import LscOptions

COOL = 0.9
"""Share of the thermal limit below which a hot motor may have its peak current again."""
LAGS = 0.5
"""Share of the commanded speed below which an amplifier in speed mode is taken to drive all it can."""


class Motor:
    """Bounds a set value and follows the heat it makes.

    The current is known in mode current, follows from resistance and back-EMF in mode voltage, and is not known in mode
    speed: there an amplifier whose motor does not follow drives its peak current, and one whose motor follows is taken to
    drive the continuous current at most. The model starts cold: after a restart it knows nothing of the past.

    Attributes:
        heat: of the winding above ambient, as a share of what the continuous current makes of it for ever.
        hot: the limit was reached, and the motor has not cooled down since.
    """

    def __init__(self, options: LscOptions, period_s: float) -> None:
        self._options = options
        self._share = period_s / options.thermal_s
        self.heat, self.hot = 0.0, False

    def bound_v(self, command_v: float, speed_rad_per_s: float) -> float:
        """The part of `command_v` that limit, peak current and, for a hot motor, continuous current allow."""
        o = self._options
        most_a = o.continuous_a if self.hot else o.peak_a
        low, high = -o.command_limit_v, o.command_limit_v
        if o.gain_a_per_v is not None:
            low, high = max(low, -most_a / o.gain_a_per_v), min(high, most_a / o.gain_a_per_v)
        elif o.gain_v_per_v is not None and o.resistance_ohm is not None and o.back_emf_v_s_per_rad is not None:
            turning, drop = o.back_emf_v_s_per_rad * speed_rad_per_s, o.resistance_ohm * most_a
            low = min(max(low, (turning - drop) / o.gain_v_per_v), 0.0)  # braking must not need a command that drives
            high = max(min(high, (turning + drop) / o.gain_v_per_v), 0.0)
        return min(max(command_v, low), high)

    def current_a(self, command_v: float, speed_rad_per_s: float) -> float:
        """What `command_v` makes flow, without sign where only its size is known."""
        o = self._options
        if o.gain_a_per_v is not None:
            return o.gain_a_per_v * command_v
        if o.gain_v_per_v is not None and o.resistance_ohm is not None and o.back_emf_v_s_per_rad is not None:
            return (o.gain_v_per_v * command_v - o.back_emf_v_s_per_rad * speed_rad_per_s) / o.resistance_ohm
        assert o.gain_rad_per_s_per_v is not None
        wanted = o.gain_rad_per_s_per_v * command_v
        follows = speed_rad_per_s * wanted >= LAGS * wanted * wanted
        return o.continuous_a * COOL if follows else o.peak_a

    def pass_ticks(self, ticks: int, command_v: float, speed_rad_per_s: float, powered: bool) -> None:
        """Time has passed with this command at the amplifier."""
        load = self.current_a(command_v, speed_rad_per_s) / self._options.continuous_a if powered else 0.0
        self.heat += min(self._share * ticks, 1.0) * (load * load - self.heat)
        self.hot = self.heat >= (COOL if self.hot else 1.0)
