"""The grid clock: never early, never drifting, and honest about what it skipped."""

import time

import numpy as np
import pytest

from hal.kernel import kernel
from rtctl import clock as clocks
from rtctl.record import controller_table

PERIOD_S, PERIOD_NS = 0.002, 2_000_000


@kernel
def wait(clock, record):
    clocks.wait(clock[0], record[0])


@kernel
def stamp(clock, record):
    clocks.stamp_duration(clock[0], record[0])


@kernel
def now(clock):
    return clocks.now_ns(clock[0])


@pytest.fixture
def record():
    return np.zeros(1, controller_table(3).dtype)


@pytest.fixture
def clock(record):
    spare = clocks.grid(PERIOD_S)
    wait(spare, record)  # whatever has to be compiled or loaded
    stamp(spare, record)
    now(spare)
    return clocks.grid(PERIOD_S)


def ticked(clock, record, before=lambda: None):
    before()
    wait(clock, record)
    return record[0].copy()


def test_the_first_tick_is_number_zero_one_period_after_the_grid_was_made(clock, record):
    r = ticked(clock, record)
    assert r["tick"] - r["missed_ticks"] == 0
    assert r["time_ns"] == clock["epoch_ns"][0] + r["tick"] * PERIOD_NS


def test_every_wake_up_is_at_its_grid_point_or_later_and_the_grid_never_drifts(clock, record):
    origin, epoch = int(clock["origin_ns"][0]), int(clock["epoch_ns"][0])
    last = -1
    for k in range(60):
        r = ticked(clock, record, lambda k=k: time.sleep(0.0007 * (k % 9)))
        tick = int(r["tick"])
        assert time.monotonic_ns() >= origin + tick * PERIOD_NS, "never early"
        assert r["lateness_ns"] >= 0
        assert clock["woken_ns"][0] == origin + tick * PERIOD_NS + int(r["lateness_ns"])
        assert r["time_ns"] == epoch + tick * PERIOD_NS
        assert tick == last + 1 + r["missed_ticks"], "what was skipped is counted"
        last = tick


def test_an_overrun_skips_to_the_next_grid_point_and_counts(clock, record):
    first = int(ticked(clock, record)["tick"])
    blocked_from = time.monotonic_ns()
    time.sleep(5.5 * PERIOD_S)
    called = time.monotonic_ns()
    wait(clock, record)
    missed, tick = int(record["missed_ticks"][0]), int(record["tick"][0])
    assert tick == first + 1 + missed
    assert missed >= (called - blocked_from) // PERIOD_NS - 1
    due = int(clock["origin_ns"][0]) + tick * PERIOD_NS
    assert called < due, "the grid point it woke for was still to come when it began to wait"
    later = ticked(clock, record)
    assert later["tick"] == tick + 1 + later["missed_ticks"]


def test_a_grid_point_is_never_used_twice(clock, record):
    ticks = [int(ticked(clock, record)["tick"]) for _ in range(20)]
    assert (np.diff(ticks) >= 1).all()


def test_a_clock_that_jumped_ahead_of_its_ticks_still_goes_forward(clock, record):
    clock["tick"] = 1000  # as if the grid point had been served before its time
    clock["origin_ns"] -= 998 * PERIOD_NS
    r = ticked(clock, record)
    assert r["tick"] == 1001 + r["missed_ticks"]


def test_the_duration_is_counted_from_the_wake_up(clock, record):
    wait(clock, record)
    time.sleep(0.003)
    before = now(clock)
    stamp(clock, record)
    assert record["tick_ns"][0] >= 3_000_000
    assert record["tick_ns"][0] >= before - clock["woken_ns"][0]


def test_huge_delays_stay_inside_their_fields(clock, record):
    clock["woken_ns"] -= 10**12
    stamp(clock, record)
    assert record["tick_ns"][0] == 2**31 - 1
