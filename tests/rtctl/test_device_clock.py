"""The grid that follows a device: it locks to a wrong crystal, neither doubles nor drops a sample, and trusts nobody."""

import math

import numpy as np
import pytest

from hal.errors import OptionError
from hal.kernel import kernel
from rtctl import clock as clocks
from rtctl.device_clock import LOCKED_WITHIN, PROOF_TICKS, SLEW_LIMIT, ClockState
from rtctl.record import controller_table
from rtctl.settings import Loop, load

PERIOD_NS = 1_000_000
PHASE_S = 1e-4
MINUTES = 3
STAMPED = ("time_ns", "tick", "clock_error_s", "missed_ticks", "clock_moved_ns", "clock_state")
STAMPS = np.dtype([(name, controller_table(3).dtype[name]) for name in STAMPED])
"""What a clock writes into the record."""
PULLED_IN = PROOF_TICKS + 1500
"""Ticks: the proof, then half a period at 1 us a tick, and a few time constants."""


@kernel
def run(clock, record, rate, offset_ns, late_ns, jitter_ns, ticks, device_ns, rows):
    """Ticks on a simulated clock, woken late_ns (n,) after they are due; device_ns (n,): its time when they are due."""
    now = 0
    for k in range(late_ns.shape[0]):
        clocks.claim(clock[0], now, record[0])
        clock[0].woken_ns = clock[0].due_ns + late_ns[k]
        told_ns = rate * clock[0].woken_ns + offset_ns + jitter_ns[k]
        clocks.follow(clock[0], told_ns * 1e-9, record[0])
        ticks[k], device_ns[k] = clock[0].tick, rate * clock[0].due_ns + offset_ns
        rows[k] = record[0]
        now = clock[0].woken_ns + 50_000


def simulated(loop):
    """A clock whose machine time begins at zero."""
    clock = clocks.make(loop)
    clock["origin_ns"] = clock["epoch_ns"] = PERIOD_NS
    return clock


def follow_for(ticks, ppm, offset_ns, seed, clock_kind="device"):
    """(rows, tick numbers, device time when due [ns]) of a loop with the lateness of a bad machine."""
    random = np.random.default_rng(seed)
    late = random.exponential(20_000, ticks) + np.where(random.random(ticks) < 1e-4, 7.3 * PERIOD_NS, 0.0)
    jitter = random.uniform(-5_000, 5_000, ticks)
    record = np.zeros(1, STAMPS)
    rows, numbers, device_ns = np.zeros(ticks, record.dtype), np.zeros(ticks, np.int64), np.zeros(ticks)
    clock = simulated(Loop(clock=clock_kind, device_phase_s=PHASE_S))
    run(clock, record, 1 + ppm * 1e-6, offset_ns, late.astype(np.int64), jitter, numbers, device_ns, rows)
    return rows, numbers, device_ns


@pytest.mark.parametrize(("ppm", "offset_ns"), [(200.0, 0.0), (-200.0, 499_000.0), (0.0, -7.7e12), (450.0, 123_456.0)])
def test_over_minutes_the_grid_stays_with_a_crystal_that_is_off(ppm, offset_ns):
    rows, numbers, device_ns = follow_for(MINUTES * 60_000, ppm, offset_ns, 1)
    assert rows["missed_ticks"].sum() > 50, "the machine was bad enough"
    late = slice(PULLED_IN, None)
    assert (rows["clock_state"][late] == ClockState.LOCKED).all()
    error_s = (device_ns[late] / PERIOD_NS) % 1.0 * 1e-3 - PHASE_S
    assert np.abs(error_s).max() < 5e-6
    assert error_s.std() < 1e-6, "five times better than what the device tells"
    cycle = np.floor(device_ns[late] / PERIOD_NS).astype(np.int64)
    assert (np.diff(cycle) == np.diff(numbers[late])).all(), "one period of the device for every tick of the grid"
    assert np.abs(rows["clock_error_s"][late] - error_s).max() < 5.1e-6, "the record says so within the jitter"


def test_the_plain_grid_drifts_through_the_samples_of_the_same_device():
    rows, numbers, device_ns = follow_for(60_000, 200.0, 0.0, 1, "grid")
    cycle = np.floor(device_ns / PERIOD_NS).astype(np.int64)
    assert np.sum(np.diff(cycle) != np.diff(numbers)) >= 11
    assert (rows["clock_state"] == ClockState.GRID).all()
    assert not rows["clock_moved_ns"].any()
    assert np.isnan(rows["clock_error_s"]).all()


@pytest.mark.parametrize("offset_ns", [0.0, 250_000.0, 590_000.0, 610_000.0, 999_000.0])
def test_wherever_the_pull_begins_the_grid_moves_within_its_bound_and_time_goes_with_it(offset_ns):
    rows, numbers, _ = follow_for(PULLED_IN + 500, 200.0, offset_ns, 2)
    moved = rows["clock_moved_ns"].astype(np.int64)
    assert np.abs(moved).max() <= SLEW_LIMIT * PERIOD_NS
    assert not moved[:PROOF_TICKS].any(), "nothing is moved before the device's time has proved itself"
    assert rows["clock_state"][0] == ClockState.WATCHING
    assert rows["clock_state"][-1] == ClockState.LOCKED
    assert (np.diff(rows["time_ns"]) == np.diff(numbers) * PERIOD_NS + moved[:-1]).all()


class Rig:
    """A loop beside a device whose time the test tells, tick by tick."""

    def __init__(self):
        self.clock = simulated(Loop(clock="device", device_phase_s=PHASE_S))
        self.record = np.zeros(1, STAMPS)
        self.machine_ns, self.device_ns = 0, 0.0

    def ticks(self, number, speed=1.0, tell=lambda device_s: device_s):
        """Run; the device's clock is `speed` times as fast as the machine's. Returns the rows."""
        rows = np.zeros(number, self.record.dtype)
        for k in range(number):
            step(self.clock, self.record, self.machine_ns, 0.0, True)
            woken = int(self.clock["due_ns"][0]) + 20_000
            self.device_ns += speed * (woken - self.machine_ns)
            self.machine_ns = woken
            self.clock["woken_ns"] = woken
            step(self.clock, self.record, 0, float(tell(self.device_ns * 1e-9)), False)
            rows[k] = self.record[0]
        return rows


@kernel
def step(clock, record, now_ns, device_s, claims):
    if claims:
        clocks.claim(clock[0], now_ns, record[0])
    else:
        clocks.follow(clock[0], device_s, record[0])


@pytest.fixture
def locked():
    rig = Rig()
    rows = rig.ticks(PULLED_IN, 1.0002)
    assert rows["clock_state"][-1] == ClockState.LOCKED
    return rig


FROZEN = 12.5
ABSURD = {
    "not a number": (1.0002, lambda _: math.nan),
    "infinite": (1.0002, lambda _: math.inf),
    "frozen": (1.0002, lambda _: FROZEN),
    "huge": (1.0002, lambda s: s * 1e12),
    "5 % fast": (1.05, lambda s: s),
    "5 % slow": (0.95, lambda s: s),
    "1200 ppm fast": (1.0012, lambda s: s),
    "backwards": (-1.0, lambda s: s),
}


RUNAWAY_TICKS = {"5 % fast": 20, "5 % slow": 20, "1200 ppm fast": 4000}
"""It takes so long to be three quarters of a period away from a grid that is moved as fast as may be."""


@pytest.mark.parametrize("name", ABSURD)
def test_an_absurd_time_is_refused_and_the_grid_held(locked, name):
    speed, tell = ABSURD[name]
    rows = locked.ticks(5 * PROOF_TICKS, speed, tell)
    refused = np.flatnonzero(rows["clock_state"] == ClockState.REFUSED)
    assert len(refused), "told by a signal"
    first = refused[0]
    assert (rows["clock_state"][first:] == ClockState.REFUSED).all()
    assert not rows["clock_moved_ns"][first:].any()
    assert np.isnan(rows["clock_error_s"][first:]).all()
    assert first <= RUNAWAY_TICKS.get(name, 1)


@pytest.mark.parametrize("jump_s", [150e-6, -150e-6, 0.5, -3.0])
def test_after_a_jump_the_device_has_to_prove_itself_again(locked, jump_s):
    locked.device_ns += jump_s * 1e9
    rows = locked.ticks(2 * PROOF_TICKS + 1500, 1.0002)
    assert rows["clock_state"][1] == ClockState.REFUSED, "as of the tick after"
    assert (rows["clock_state"][1:PROOF_TICKS] == ClockState.REFUSED).all()
    assert rows["clock_state"][-1] == ClockState.LOCKED
    assert abs(rows["clock_error_s"][-1]) < LOCKED_WITHIN * 1e-3


def test_a_device_that_was_never_plausible_never_moves_the_grid():
    rows = Rig().ticks(4 * PROOF_TICKS, 1.05)
    assert not rows["clock_moved_ns"].any()
    assert set(rows["clock_state"]) == {ClockState.WATCHING, ClockState.REFUSED}


def test_every_way_over_the_grid_is_counted():
    """A tick that takes long, a wake-up that comes late, a moved grid: what is missed is what has no tick."""
    random = np.random.default_rng(3)
    clock, record = simulated(Loop(clock="device")), np.zeros(1, STAMPS)
    now, served, missed = 0, 0, 0
    for _ in range(3000):
        step(clock, record, now, 0.0, True)
        served, missed = served + 1, missed + int(record["missed_ticks"][0])
        assert record["tick"][0] + 1 == served + missed
        due = int(clock["due_ns"][0])
        assert due > now - PERIOD_NS, "no grid point that is long over"
        assert due <= now + PERIOD_NS + 1000, "nor one left out that could be served"
        woken = due + int(random.exponential(20_000) + (random.random() < 0.05) * random.uniform(0, 9) * PERIOD_NS)
        now = woken + int(random.exponential(300_000) + (random.random() < 0.05) * random.uniform(0, 9) * PERIOD_NS)
        clock["origin_ns"] += random.integers(-1000, 1001)
    assert missed > 500


@pytest.mark.parametrize(
    "overrides",
    [
        ("loop.clock=device", "loop.device_phase_s=0.001"),
        ("loop.spin_us=100", "loop.period_s=0.0001"),
        ("loop.spin_us=101",),
        ("loop.clock=quartz",),
    ],
)
def test_settings_that_cannot_be_are_refused(overrides):
    with pytest.raises(OptionError, match=r"loop\."):
        load("planar-sim", overrides)
