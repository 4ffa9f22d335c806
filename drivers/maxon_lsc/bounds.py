"""Bounds of a set value: the hard clamp, the peak current, and the continuous one for a hot motor."""

from drivers.maxon_lsc.options import LscOptions


class Bounds:
    """What may be asked of an amplifier; in mode speed the current is its own business, and only the clamp counts."""

    def __init__(self, options: LscOptions) -> None:
        self._options = options
        self._most_v = options.command_limit_v
        self._peak_v = self._hot_v = self._most_v
        if options.gain_a_per_v is not None:
            self._peak_v = min(self._most_v, options.peak_a / options.gain_a_per_v)
            self._hot_v = min(self._most_v, options.continuous_a / options.gain_a_per_v)
        self.needs_speed = options.mode == "voltage"

    def apply(self, command_v: float, hot: bool) -> float:
        """The part of `command_v` that is allowed; in mode voltage see :meth:`apply_at`."""
        most_v = self._hot_v if hot else self._peak_v
        if command_v > most_v:
            return most_v
        return command_v if command_v >= -most_v else -most_v

    def apply_at(self, command_v: float, hot: bool, speed_rad_per_s: float) -> float:
        """In mode voltage, where the current depends on the speed; 0 V, the short that brakes, is always allowed."""
        o = self._options
        assert o.gain_v_per_v is not None
        assert o.resistance_ohm is not None
        assert o.back_emf_v_s_per_rad is not None
        turning_v = o.back_emf_v_s_per_rad * speed_rad_per_s
        drop_v = o.resistance_ohm * (o.continuous_a if hot else o.peak_a)
        low_v = min(max(-self._most_v, (turning_v - drop_v) / o.gain_v_per_v), 0.0)
        high_v = max(min(self._most_v, (turning_v + drop_v) / o.gain_v_per_v), 0.0)
        return min(max(command_v, low_v), high_v)
