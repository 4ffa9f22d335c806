"""Control loops of an emulated drive: current, speed, position with its profile, and the ramp of a stop.

Angles are those of the motor in the drive's own sense of rotation.
"""

import math

from sim_backends.emulators.epos_objects import Entry, key
from sim_backends.emulators.epos_rotor import Rotor

RPM = math.pi / 30.0
PPM, CSP, CST, POSITION, VELOCITY, CURRENT = 1, 8, 10, -1, -2, -3
TORQUE_MODES, POSITION_MODES, CYCLIC = (CST, CURRENT), (PPM, CSP, POSITION), (CSP, CST)
SPEED_GAIN_A_S, SPEED_INTEGRAL_A, POSITION_GAIN_S = 0.03, 1.5, 60.0
"""Gains of the cascade; on a real drive its own tuning writes them to 30A1 and 30A2."""
STANDSTILL_RAD_S, PATIENCE_S = 1.0, 0.1
"""A stop is over below this speed, or so long after its ramp has come to zero."""


class Loops:
    """Loops of one drive.

    Attributes:
        counts_per_rad: of the encoder. current_set_a: what the drive asks of its current loop.
        rotor: the drive's own motor, which turns in all modes but the torque modes; there the bench's turns, if there is one.
    """

    def __init__(self, generation: str) -> None:
        self.is_epos4 = generation == "epos4"
        self.counts_per_rad = 1.0
        self.rotor = Rotor()
        self.current_set_a = 0.0
        self._bench_rad = self._bench_rate = 0.0
        self._zero_rad = 0.0
        self._on_bench = self._turned_bench = False

    def start(self, objects: dict[int, Entry]) -> None:
        """After a reset the encoder counts from zero."""
        self._o, self._mode = objects, objects[key(0x6060)]
        self._shown = [objects[key(index)] for index in (0x6064, 0x6062, 0x606C)]
        self._shown_current = objects[key(0x6077 if self.is_epos4 else 0x6078)]
        self._rated = objects[key(0x3001, 1) if self.is_epos4 else key(0x6410, 1)]
        self._limit = objects[key(0x3001, 2) if self.is_epos4 else key(0x6410, 2)]
        self._set_rad = self._goal = self._rate = self._integral_a = 0.0
        self._span_s = self._late_s = self._ramp_s = 0.0
        self._acknowledged = self._limited = False
        self._turned_bench = self.turns_bench
        self._zero_rad = self._shaft_rad

    @property
    def mode(self) -> int:
        """Of 6060."""
        return self._mode.value

    @property
    def turns_bench(self) -> bool:
        """The bench's rotor turns, and not the drive's own."""
        return self._on_bench and self.mode in TORQUE_MODES

    @property
    def angle_rad(self) -> float:
        """Of the shaft that the encoder sits on; it goes on counting when a mode makes another motor turn."""
        if self.turns_bench != self._turned_bench:
            counted = self._shaft_rad - self._zero_rad
            self._turned_bench = self.turns_bench
            self._zero_rad = self._shaft_rad - counted
        return self._shaft_rad - self._zero_rad

    @property
    def _shaft_rad(self) -> float:
        return self._bench_rad if self._turned_bench else self.rotor.angle_rad

    @property
    def rate_rad_per_s(self) -> float:
        """Of the same."""
        return self._bench_rate if self.turns_bench else self.rotor.rate_rad_per_s

    def sense(self, angle_rad: float, dt_s: float) -> None:
        """The bench's rotor has come to an angle."""
        self._bench_rate = (angle_rad - self._bench_rad) / dt_s if self._on_bench else 0.0
        self._bench_rad, self._on_bench = angle_rad, True

    def begin(self) -> None:
        """The power stage is up: hold where the shaft is."""
        self._set_rad, self._goal = self.angle_rad, round(self.angle_rad * self.counts_per_rad)
        self._rate = self._integral_a = self._span_s = self._late_s = 0.0
        self._acknowledged = False

    def begin_stop(self) -> None:
        """A ramp from the present speed."""
        self._rate, self._ramp_s, self._integral_a = self.rate_rad_per_s, 0.0, 0.0

    @property
    def stopped(self) -> bool:
        """The ramp has come to zero, and so has the shaft, or it takes too long."""
        return self._rate == 0.0 and (abs(self.rate_rad_per_s) < STANDSTILL_RAD_S or self._ramp_s > PATIENCE_S)

    def advance(self, dt_s: float, following: bool, ramping: bool, powered: bool, word: int) -> bool:
        """One period; True when the following error has been too large for too long."""
        self.current_set_a, failed = 0.0, False
        if ramping:
            self._brake(dt_s)
        elif following and self.mode in TORQUE_MODES:
            self.current_set_a = self._asked_current_a()
        elif following and self.mode == VELOCITY:
            self._rate = self._o[key(0x206B)].value * RPM
            self._hold_rate(dt_s)
        elif following and self.mode in POSITION_MODES:
            self._track(dt_s, word)
            failed = self._is_behind(dt_s)
        limit_a = self._limit.value / 1e3
        self.current_set_a = min(max(self.current_set_a, -limit_a), limit_a)
        if not self.turns_bench:
            self.rotor.turn(self.current_set_a, powered, dt_s)
        return failed

    def _asked_current_a(self) -> float:
        if self.mode == CURRENT:
            return self._o[key(0x2030)].value / 1e3
        return (self._o[key(0x6071)].value + self._o[key(0x60B2)].value) * self._rated.value / 1e6

    def _brake(self, dt_s: float) -> None:
        step = self._o[key(0x6085)].value * RPM * dt_s
        self._rate = math.copysign(max(abs(self._rate) - step, 0.0), self._rate)
        if self._rate == 0.0:
            self._ramp_s += dt_s
        self._hold_rate(dt_s)

    def _hold_rate(self, dt_s: float) -> None:
        fastest = self._o[key(0x6080) if self.is_epos4 else key(0x607F)].value * RPM
        error = min(max(self._rate, -fastest), fastest) - self.rate_rad_per_s
        self._integral_a = min(max(self._integral_a + SPEED_INTEGRAL_A * error * dt_s, -1.0), 1.0)
        self.current_set_a = SPEED_GAIN_A_S * error + self._integral_a

    def _track(self, dt_s: float, word: int) -> None:
        """Set-point of the position loop, then the cascade."""
        before = self._set_rad
        goal_rad = self._goal_counts(word) / self.counts_per_rad
        if self.mode == PPM:
            self._profile(goal_rad, dt_s)
        elif self.mode == CSP:
            share = min(dt_s / self._span_s, 1.0) if self._span_s > 0.0 else 1.0
            self._set_rad += share * (goal_rad - self._set_rad)
            self._span_s = max(self._span_s - dt_s, 0.0)
        else:
            self._set_rad = goal_rad
        self._rate = (self._set_rad - before) / dt_s + POSITION_GAIN_S * (self._set_rad - self.angle_rad)
        self._hold_rate(dt_s)

    def _goal_counts(self, word: int) -> float:
        asked = self._o[key(0x607A) if self.is_epos4 else key(0x2062)].value
        if self.mode == PPM:
            if word & 0x10 and not self._acknowledged:
                self._goal = asked
            self._acknowledged = bool(word & 0x10)
        elif asked != self._goal:
            self._goal = asked
            if self.mode == CSP:  # a new set value is reached one interpolation period later
                self._span_s = self._o[key(0x60C2, 1)].value * 10.0 ** self._o[key(0x60C2, 2)].value
        allowed = min(max(self._goal, self._o[key(0x607D, 1)].value), self._o[key(0x607D, 2)].value)
        self._limited = allowed != self._goal
        return allowed

    def _profile(self, goal_rad: float, dt_s: float) -> None:
        way = goal_rad - self._set_rad
        fastest = self._o[key(0x6081)].value * RPM
        braking = math.sqrt(2.0 * self._o[key(0x6084)].value * RPM * abs(way))
        self._set_rad += math.copysign(min(abs(way), min(fastest, braking) * dt_s), way)

    def _is_behind(self, dt_s: float) -> bool:
        error = abs(self._set_rad - self.angle_rad) * self.counts_per_rad
        self._late_s = self._late_s + dt_s if error > self._o[key(0x6065)].value else 0.0
        patience_s = self._o[key(0x6066)].value / 1e3 if self.is_epos4 else 0.0
        return self._late_s > patience_s

    def flags(self, following: bool) -> int:
        """Bits of the statusword that belong to the mode: 11 limit, 12 follows or acknowledges, 13 following error."""
        word = 0x0800 if self._limited and following else 0
        if following and (self.mode in CYCLIC or (self.mode == PPM and self._acknowledged)):
            word |= 0x1000
        if self._late_s > 0.0 and self.mode in POSITION_MODES:
            word |= 0x2000
        return word

    def show(self) -> None:
        """Bring the objects that tell of the motion up to date."""
        position, demand, speed = self._shown
        position.value = _int32(math.floor(self.angle_rad * self.counts_per_rad + 0.5))
        demand.value = _int32(round(self._set_rad * self.counts_per_rad))
        speed.value = _int32(round(self.rate_rad_per_s / RPM))
        current_ma = self.current_set_a * 1e3
        self._shown_current.value = _int16(round(1e3 * current_ma / self._rated.value if self.is_epos4 else current_ma))


def _int32(value: int) -> int:
    return (value + 2**31) % 2**32 - 2**31


def _int16(value: int) -> int:
    return min(max(value, -(2**15)), 2**15 - 1)
