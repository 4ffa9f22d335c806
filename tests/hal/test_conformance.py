"""Every installed backend keeps every promise, and every check notices a backend that does not."""

import math
from importlib.metadata import entry_points

import numpy as np
import pytest

from hal import conformance
from hal.backend import GROUP, load
from hal.conformance import CHECKS
from hal.frames import INVALID, VALID
from hal.signals import TICK, TIME, Signal, Table
from rtctl.settings import load as load_settings

TABLES: dict[str, dict] = {"rig": load_settings("planar-hil").backend.options}
"""Settings of backends that have no complete defaults."""
TRUTH = Table("Truth", (TIME, TICK, Signal("x", "f8", (), "", "")))


@pytest.mark.parametrize("check", CHECKS, ids=lambda c: c.__name__)
@pytest.mark.parametrize("name", sorted({e.name for e in entry_points(group=GROUP)} - {"hardware"}))
def test_installed_backends_keep_every_promise(name, check):
    """Real devices are not at hand; their backend is held to it on the emulated bench, as part of "rig"."""
    check(lambda: load(name, TABLES.get(name, {}), period_s=0.001, seed=7))


class Honest:
    """The smallest backend that keeps every promise; subclasses break one each."""

    axes, watchdog_ticks, simulated = 2, 10, True

    def __init__(self):
        self.opened, self.powered, self.tripped = False, False, False
        self.tick = self.good = self.sequence = 0
        self.record = np.zeros(1, TRUTH.dtype)

    def open(self):
        self.opened, self.powered, self.tripped, self.good = True, False, False, self.tick

    def close(self):
        self.opened = self.powered = False

    def trips(self):
        return self.tick - self.good > self.watchdog_ticks

    def read(self, tick, sensors):
        self.tick = tick
        self.sequence += self.opened
        if self.powered and self.trips():
            self.powered, self.tripped = False, True
        self.record["tick"] = tick
        sensors["axis_angle_rad"] = sensors["wrench_in_sensor"] = 0.5 if self.opened else math.nan
        for group in ("axes", "wrench"):
            sensors[f"{group}_sequence"] = self.sequence
            sensors[f"{group}_validity"] = VALID if self.opened else INVALID
        self.telemeter(tick, sensors)
        sensors["powered"], sensors["watchdog_tripped"] = self.powered, self.tripped

    def telemeter(self, tick, sensors):
        """Every 90th tick a sample of the impedance, the first in the 90th."""
        known = self.opened and tick >= 90
        sensors["impedance_ohm"] = 1500.0 if known else math.nan
        sensors["impedance_pair"] = tick // 90 % 21 if known else -1
        sensors["impedance_sequence"] = tick // 90
        sensors["impedance_age_ticks"] = tick % 90 if tick >= 90 else 2**31 - 1
        sensors["impedance_validity"] = VALID if known else INVALID

    def counts(self, actuators):
        return bool(np.isfinite(actuators["command_v"]).all())

    def write(self, tick, actuators):
        if not self.opened:
            return
        if not actuators["power"][0]:
            self.powered = self.tripped = False
        elif self.counts(actuators) and not self.tripped:
            self.powered, self.good = True, tick

    def compiled(self):
        return None

    def truth(self):
        return TRUTH, self.record


class WithoutTelemetry(Honest):
    """Keeps every promise too."""

    def telemeter(self, _tick, sensors):
        sensors["impedance_ohm"], sensors["impedance_pair"] = math.nan, -1


class Wordless(Honest):
    truth = None

    def __init__(self):
        super().__init__()
        self.simulated = "yes"


class Eager(Honest):
    def open(self):
        super().open()
        self.powered = True


class Clinging(Honest):
    def close(self):
        self.opened = False


class Babbling(Honest):
    def read(self, tick, sensors):
        super().read(tick, sensors)
        sensors["axes_validity"] = VALID


class Unfounded(Honest):
    def read(self, tick, sensors):
        super().read(tick, sensors)
        sensors["wrench_in_sensor"][0, 2] = math.nan


class Ageless(Honest):
    def read(self, tick, sensors):
        super().read(tick, sensors)
        sensors["wrench_sequence"] = 3


class Pairless(Honest):
    def telemeter(self, tick, sensors):
        super().telemeter(tick, sensors)
        sensors["impedance_pair"] = -1


class Youthful(Honest):
    def telemeter(self, tick, sensors):
        super().telemeter(tick, sensors)
        sensors["impedance_age_ticks"] = 0


class Repeating(Honest):
    def telemeter(self, tick, sensors):
        super().telemeter(tick, sensors)
        sensors["impedance_sequence"], sensors["impedance_age_ticks"] = min(tick // 90, 1), max(tick - 90, 0)


class Unwatched(Honest):
    def trips(self):
        return False


class Hasty(Honest):
    def trips(self):
        return self.tick - self.good >= self.watchdog_ticks


class Forgetful(Honest):
    def write(self, tick, actuators):
        self.tripped = False
        super().write(tick, actuators)


class Credulous(Honest):
    def counts(self, _):
        return True


class Stubborn(Honest):
    def write(self, tick, actuators):
        if self.counts(actuators):
            super().write(tick, actuators)


class Raising(Honest):
    def read(self, tick, sensors):
        if tick > 10_000:
            raise TimeoutError
        super().read(tick, sensors)


class Meddling(Honest):
    def write(self, tick, actuators):
        super().write(tick, actuators)
        actuators["command_v"] += 1.0


class Hoarding(Honest):
    def __init__(self):
        super().__init__()
        self.seen = []

    def read(self, tick, sensors):
        super().read(tick, sensors)
        self.seen.append(sensors.copy())


class Fickle(Honest):
    def read(self, tick, sensors):
        super().read(tick, sensors)
        sensors["axis_angle_rad"] = id(self)


class Disordered(Honest):
    def truth(self):
        return Table("Disordered", (TIME, TRUTH.signals[2], TICK)), self.record


@pytest.mark.parametrize("check", CHECKS, ids=lambda c: c.__name__)
@pytest.mark.parametrize("honest", [Honest, WithoutTelemetry])
def test_an_honest_backend_passes(check, honest):
    check(honest)


@pytest.mark.parametrize(
    ("check", "broken"),
    [
        (conformance.is_a_backend, Wordless),
        (conformance.opens_without_power, Eager),
        (conformance.closes_twice_and_without_power, Clinging),
        (conformance.is_silent_before_open, Babbling),
        (conformance.tells_validity, Unfounded),
        (conformance.tells_validity, Pairless),
        (conformance.counts_samples, Ageless),
        (conformance.counts_samples, Youthful),
        (conformance.counts_samples, Repeating),
        (conformance.watchdog_removes_power, Unwatched),
        (conformance.watchdog_removes_power, Hasty),
        (conformance.watchdog_latches, Forgetful),
        (conformance.ignores_commands_that_are_not_finite, Credulous),
        (conformance.always_removes_power, Stubborn),
        (conformance.changes_values_only_in_read, Meddling),
        (conformance.survives_missed_ticks, Unwatched),
        (conformance.allocates_nothing, Hoarding),
        (conformance.repeats_itself, Fickle),
        (conformance.tells_the_truth_in_order, Disordered),
    ],
    ids=lambda v: v.__name__,
)
def test_every_check_notices_its_broken_promise(check, broken):
    with pytest.raises(AssertionError, match="broken promise"):
        check(broken)


def test_every_check_is_shown_to_fail():
    shown = test_every_check_notices_its_broken_promise.pytestmark[0].args[1]
    assert {check for check, _ in shown} == set(CHECKS)


def test_an_exception_of_a_backend_is_not_hidden():
    with pytest.raises(TimeoutError):
        conformance.survives_missed_ticks(Raising)
