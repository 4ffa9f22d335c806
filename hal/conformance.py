"""The promises of :class:`hal.backend.Backend` as checks any backend can be put through.

A check takes a maker of fresh backends and raises AssertionError with the promise that was broken. No motor is asked to
move except in simulations, so the suite may also be run on a bench with its motors connected. Time is the tick number;
a backend with a clock of its own needs a `pace` that waits one period::

    for check in CHECKS:
        check(lambda: MyBackend(table, period_s=0.001, seed=1), pace=lambda: time.sleep(0.001))
"""

import math
import tracemalloc
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import numpy as np

from hal.backend import Backend, CompiledDevice
from hal.frames import VALID, Validity, actuator_frame, sensor_frame

Make = Callable[[], Backend]
Pace = Callable[[], object]

POWER_UP_TICKS = 500
"""Amplifiers may take this long to come up."""
SLOW_TICKS = 1000
"""The slowest group has a new sample within so many ticks."""
GROUPS = {"axes": "axis_angle_rad", "wrench": "wrench_in_sensor", "impedance": "impedance_ohm"}


class Session:
    """A backend with its two frames and a tick counter."""

    def __init__(self, backend: Backend, pace: Pace) -> None:
        self.backend, self.pace, self.tick = backend, pace, 0
        self.sensors = np.zeros(1, sensor_frame(backend.axes))
        self.actuators = np.zeros(1, actuator_frame(backend.axes))

    def read(self, skip: int = 0) -> np.void:
        """Read at the next tick, after `skip` missed ones; returns the frame's record."""
        for _ in range(min(skip, 1000) + 1):
            self.pace()
        self.tick += skip + 1
        self.backend.read(self.tick, self.sensors)
        return self.sensors[0]

    def write(self, power: int, command_v: float = 0.0) -> None:
        """Write the same command to every axis."""
        self.actuators["power"], self.actuators["command_v"] = power, command_v
        self.backend.write(self.tick, self.actuators)

    def power_up(self) -> None:
        """Ask for power as the contract says: without it first, then every tick."""
        self.read()
        self.write(0)
        for _ in range(POWER_UP_TICKS):
            powered = self.read()["powered"]
            self.write(1)
            if powered:
                return
        raise AssertionError(f"a write with power = 1 every tick gives power within {POWER_UP_TICKS} ticks")

    def ticks_until_unpowered(self, limit: int) -> int:
        """Reads without a write until power is gone, at most `limit` + 1."""
        for n in range(1, limit + 1):
            if not self.read()["powered"]:
                return n
        return limit + 1


@contextmanager
def session(make: Make, pace: Pace) -> Iterator[Session]:
    """An opened backend that is closed in any case."""
    backend = make()
    backend.open()
    try:
        yield Session(backend, pace)
    finally:
        backend.close()


def no_wait() -> None:
    """The pace of a backend whose only clock is the tick number."""


def is_a_backend(make: Make, pace: Pace = no_wait) -> None:
    """It has the verbs and the facts of the protocol."""
    pace()
    backend = make()
    require(isinstance(backend, Backend), "a backend has every member of hal.backend.Backend")
    require(backend.axes >= 1 and backend.watchdog_ticks >= 1, "axes and watchdog_ticks are at least 1")
    require(isinstance(backend.simulated, bool), "simulated is a bool")
    require(isinstance(backend.compiled(), CompiledDevice | None), "compiled() answers a CompiledDevice or None")


def opens_without_power(make: Make, pace: Pace = no_wait) -> None:
    """Neither open nor reading nor writing power = 0 energises the amplifiers."""
    with session(make, pace) as s:
        for _ in range(20):
            require(not s.read()["powered"], "an opened backend has no power before power = 1 is written")
            s.write(0)


def closes_twice_and_without_power(make: Make, pace: Pace = no_wait) -> None:
    """Close removes power, may be repeated, and leaves a backend that is silent and can be opened again."""
    with session(make, pace) as s:
        s.power_up()
        s.backend.close()
        s.backend.close()
        _is_silent(s.read(), "a closed backend")
        s.write(1)
        require(not s.read()["powered"], "a closed backend has no power, whatever is written")
        s.backend.open()
        require(not s.read()["powered"], "a backend opened again has no power")


def is_silent_before_open(make: Make, pace: Pace = no_wait) -> None:
    """Before open there are no measurements and no exceptions."""
    s = Session(make(), pace)
    _is_silent(s.read(), "a backend that is not open")
    s.write(1)
    _is_silent(s.read(), "a backend that is not open")


def tells_validity(make: Make, pace: Pace = no_wait) -> None:
    """Valid values are finite, all others are NaN; ages are not negative."""
    with session(make, pace) as s:
        for _ in range(100):
            s.write(0)
            frame = s.read()
            for group, values in GROUPS.items():
                _values_fit_validity(frame, group, values)
                require(frame[f"{group}_age_ticks"] >= 0, f"{group}_age_ticks is never negative")
            measured = frame["impedance_validity"] == VALID
            require(
                (frame["impedance_pair"] >= 0) == measured, "impedance_pair is known while impedance_ohm is, else -1"
            )


def counts_samples(make: Make, pace: Pace = no_wait) -> None:
    """A sequence number never falls; after the first sample the age grows by the ticks without a new one."""
    with session(make, pace) as s:
        for group in GROUPS:
            frame = s.read()
            first = last = int(frame[f"{group}_sequence"])
            age = int(frame[f"{group}_age_ticks"])
            for skip in (0, 0, 3, 0, 0, 7, *([0] * 60)):
                frame = s.read(skip)
                now, new_age = int(frame[f"{group}_sequence"]), int(frame[f"{group}_age_ticks"])
                require(now >= last, f"{group}_sequence never falls")
                if now == last and now > 0:
                    require(new_age >= age + skip + 1, f"{group}_age_ticks grows while its sequence stands still")
                last, age = now, new_age
            if frame[f"{group}_validity"] == VALID:
                for _ in range(SLOW_TICKS):
                    if last > first:
                        break
                    last = int(s.read()[f"{group}_sequence"])
                require(last > first, f"{group}_sequence rises while its samples are valid")


def watchdog_removes_power(make: Make, pace: Pace = no_wait) -> None:
    """Silence longer than watchdog_ticks removes power; shorter silence does not."""
    with session(make, pace) as s:
        s.power_up()
        limit = s.backend.watchdog_ticks
        s.read(limit - 1)
        require(s.sensors[0]["powered"], f"{limit} ticks without a write (watchdog_ticks) do not remove power")
        s.write(1)
        n = s.ticks_until_unpowered(limit + 1)
        require(n <= limit + 1, f"power is gone {limit + 1} ticks after the last write")
        require(s.sensors[0]["watchdog_tripped"], "a tripped watchdog says so")


def watchdog_latches(make: Make, pace: Pace = no_wait) -> None:
    """After a trip only a write with power = 0 brings power back into reach."""
    with session(make, pace) as s:
        s.power_up()
        s.read(s.backend.watchdog_ticks + 5)
        for _ in range(20):
            s.write(1)
            frame = s.read()
            require(not frame["powered"], "a tripped watchdog keeps power off while power = 1 is written")
            require(frame["watchdog_tripped"], "a tripped watchdog stays tripped while power = 1 is written")
        s.write(0)
        require(not s.read()["watchdog_tripped"], "a write with power = 0 re-arms the watchdog")
        s.power_up()


def ignores_commands_that_are_not_finite(make: Make, pace: Pace = no_wait) -> None:
    """NaN and infinity count as no write: they neither give power nor keep it."""
    for command in (math.nan, math.inf, -math.inf):
        with session(make, pace) as s:
            for _ in range(5):
                s.read()
                s.write(1, command)
            require(not s.read()["powered"], f"a command of {command} gives no power")
            s.power_up()
            for _ in range(s.backend.watchdog_ticks + 1):
                s.write(1, command)
                s.read()
            require(not s.sensors[0]["powered"], f"commands of {command} do not hold off the watchdog")
            require(s.sensors[0]["watchdog_tripped"], f"the watchdog trips under commands of {command}")
            _values_fit_validity(s.sensors[0], "axes", GROUPS["axes"])


def always_removes_power(make: Make, pace: Pace = no_wait) -> None:
    """A write with power = 0 removes power by the next read, whatever else it says."""
    for command in (0.0, math.nan):
        with session(make, pace) as s:
            s.power_up()
            s.write(0, command)
            frame = s.read()
            require(not frame["powered"], f"power = 0 with a command of {command} removes power")
            require(not frame["watchdog_tripped"], "power that was taken away on demand is no watchdog trip")


def survives_missed_ticks(make: Make, pace: Pace = no_wait) -> None:
    """A jump of the tick number, even a huge one, is told by watchdog and validity, not by an exception."""
    with session(make, pace) as s:
        s.power_up()
        for skip in (s.backend.watchdog_ticks + 1, 100_000_000):
            frame = s.read(skip)
            require(not frame["powered"], f"{skip} missed ticks leave no power")
            for group, values in GROUPS.items():
                _values_fit_validity(frame, group, values)


def changes_values_only_in_read(make: Make, pace: Pace = no_wait) -> None:
    """Write leaves the sensor frame alone, and neither verb touches the actuator frame."""
    with session(make, pace) as s:
        s.power_up()
        for _ in range(5):
            sent = s.actuators.tobytes()
            s.read()
            seen = s.sensors.tobytes()
            s.backend.write(s.tick, s.actuators)
            require(s.sensors.tobytes() == seen, "write does not change the sensor frame")
            require(s.actuators.tobytes() == sent, "read and write do not change the actuator frame")


def allocates_nothing(make: Make, pace: Pace = no_wait) -> None:
    """Reading and writing leave no memory behind."""
    with session(make, pace) as s:
        s.power_up()
        backend, sensors, actuators, tick = s.backend, s.sensors, s.actuators, s.tick

        def run(first: int, last: int) -> None:
            for t in range(first, last):
                backend.read(t, sensors)
                backend.write(t, actuators)

        run(tick + 1, tick + 300)  # beyond the integers that the interpreter keeps anyway
        tracemalloc.start()
        try:
            run(tick + 300, tick + 400)
            before, _ = tracemalloc.get_traced_memory()
            run(tick + 400, tick + 1400)
            grown = tracemalloc.get_traced_memory()[0] - before
        finally:
            tracemalloc.stop()
        require(grown < 1000, f"a thousand ticks leave no memory behind (got {grown} bytes)")


def repeats_itself(make: Make, pace: Pace = no_wait) -> None:
    """A simulation gives the same bytes for the same seed, and its kernels those of its methods."""
    with session(make, pace) as a, session(make, pace) as b:
        if not a.backend.simulated:
            return
        device = b.backend.compiled()
        for s in (a, b):
            s.power_up()
        for _ in range(200):
            frame = a.read()
            a.write(1, -1.0)
            b.tick += 1
            if device is None:
                b.backend.read(b.tick, b.sensors)
                b.write(1, -1.0)
            else:
                device.read(device.device[0], b.tick, b.sensors[0])
                b.actuators["command_v"] = -1.0
                device.write(device.device[0], b.tick, b.actuators[0])
            require(frame.tobytes() == b.sensors[0].tobytes(), "the same seed and commands give the same bytes")


def tells_the_truth_in_order(make: Make, pace: Pace = no_wait) -> None:
    """The truth of a simulation is a record laid out as its signals say, time stamp and tick first."""
    with session(make, pace) as s:
        truth = s.backend.truth()
        require(s.backend.simulated or truth is None, "only a simulation knows the truth")
        if truth is None:
            return
        table, record = truth
        require(record.shape == (1,), "the truth is a record array of shape (1,)")
        require(record.dtype == table.dtype, "the truth is laid out as its table says")
        require([x.name for x in table.signals[:2]] == ["time_ns", "tick"], "the truth starts with time_ns and tick")
        s.read(5)
        require(record["tick"][0] == s.tick, "the truth is that of the last read")


CHECKS = (
    is_a_backend,
    opens_without_power,
    closes_twice_and_without_power,
    is_silent_before_open,
    tells_validity,
    counts_samples,
    watchdog_removes_power,
    watchdog_latches,
    ignores_commands_that_are_not_finite,
    always_removes_power,
    survives_missed_ticks,
    changes_values_only_in_read,
    allocates_nothing,
    repeats_itself,
    tells_the_truth_in_order,
)
"""Every promise, one function each; the name of the function is the name of the promise."""


def require(condition: object, promise: str) -> None:
    """Raise AssertionError with the promise unless it was kept (also where Python strips asserts)."""
    if not condition:
        raise AssertionError(f"broken promise: {promise}")


def _values_fit_validity(frame: np.void, group: str, values: str) -> None:
    validity = int(frame[f"{group}_validity"])
    require(validity in set(Validity), f"{group}_validity is a hal.frames.Validity, not {validity}")
    if validity == VALID:
        require(np.isfinite(frame[values]).all(), f"valid {values} are finite")
    else:
        require(np.isnan(frame[values]).all(), f"{values} that are not valid are NaN")


def _is_silent(frame: np.void, who: str) -> None:
    for group, values in GROUPS.items():
        require(frame[f"{group}_validity"] != VALID, f"{who} has no valid {group}")
        _values_fit_validity(frame, group, values)
    require(not frame["powered"], f"{who} has no power")
