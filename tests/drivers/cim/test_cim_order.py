"""Sequence numbers, times, runs, and the sender's clock."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.cim.icz1 import Icz1, encode
from drivers.cim.minimal import Minimal
from drivers.cim.pairs import Pairs
from drivers.cim.sample import Sample
from drivers.cim.sender_clock import SenderClock
from drivers.cim.session import believed_ohm
from drivers.cim.stream import Stream, Verdict, signed_difference

PERIOD_US = 70_000


def sample(number, start=0, run=1, **others):
    """The sample with this number in its run, as a good sender sends it."""
    position = number % 21
    return Sample(
        5_000_000 + PERIOD_US * number, 21 - position, 2000.0, 22 - position, run, (start + number) % 2**32, position, 21,
        number // 21, **others,
    )  # fmt: skip


@given(st.integers(0, 2**32 - 1), st.integers(-(2**31), 2**31 - 1))
def test_signed_difference_wraps(earlier, by):
    assert signed_difference((earlier + by) % 2**32, earlier) == by


@given(
    st.integers(0, 2**32 - 1),
    st.lists(st.integers(0, 60), min_size=1, max_size=40),
)
def test_whatever_the_network_does_only_newer_samples_pass_and_all_others_are_counted(start, numbers):
    stream = Stream(0.07)
    newest, passed = None, 0
    for number in numbers:
        is_newer = newest is None or number > newest
        assert (stream.judge(sample(number, start)) is Verdict.OLD) == (not is_newer)
        if is_newer:
            assert stream.lost == (0 if newest is None else number - newest - 1)
            newest, passed = number, passed + 1
    counts = stream.counts
    assert passed + counts["doubles"] + counts["late"] == len(numbers)
    assert counts["odd_steps"] == counts["odd_order"] == 0


def test_a_sequence_that_goes_on_with_a_time_that_does_not_is_refused():
    stream = Stream(0.07)
    stream.judge(sample(5))
    assert stream.judge(replace(sample(6), time_us=sample(5).time_us)) is Verdict.OLD


def test_odd_steps_and_odd_order_are_counted():
    stream = Stream(0.07)
    stream.judge(sample(0))
    stream.judge(replace(sample(1), time_us=5_030_000, position=4))
    assert (stream.counts["odd_steps"], stream.counts["odd_order"]) == (1, 1)


def test_another_run_and_another_length_of_sweep():
    stream = Stream(0.07)
    stream.judge(sample(100))
    assert not stream.is_of_another_sweep(sample(101))
    assert stream.is_of_another_sweep(replace(sample(101), sweep_length=20))
    assert stream.judge(sample(0, run=2)) is Verdict.NEW_RUN
    assert stream.judge(sample(101)) is Verdict.NEW_RUN  # two senders that fight show as restarts, again and again


def test_without_numbers_time_tells_losses_lateness_and_restarts():
    stream, layout = Stream(0.07), Minimal()
    verdicts, lost = [], []
    for time_s in (100.0, 100.07, 100.07, 100.28, 100.21, 100.35, 3.0):
        verdicts.append(stream.judge(layout.decode(memoryview(layout.encode(time_s, 3, 900.0)))))
        lost.append(stream.lost)
    assert [v.name for v in verdicts] == ["NEXT", "NEXT", "OLD", "NEXT", "OLD", "NEXT", "NEW_RUN"]
    assert lost == [0, 0, 0, 2, 0, 0, 0]


@given(st.lists(st.integers(0, 400_000), min_size=1, max_size=300), st.integers(0, 2**63))
def test_a_mapped_time_is_never_after_the_arrival_nor_before_the_smallest_delay_met(delays, boot):
    clock, smallest = SenderClock(), None
    for n, delay in enumerate(delays):
        taken = n * PERIOD_US
        arrival = taken + delay
        host = clock.host_us(boot + taken, arrival)
        assert host <= arrival
        smallest = delay if smallest is None else min(smallest, delay)
        assert host - taken >= smallest


def test_a_slow_quartz_is_followed():
    """100 ppm for an hour: ages stay within what a window of samples drifts, 3 ms, and the delay itself."""
    clock, rng = SenderClock(), np.random.default_rng(1)
    worst = 0
    for n in range(50_000):
        taken = n * PERIOD_US
        arrival = taken + 500 + int(rng.exponential(1000))
        host = clock.host_us(round(taken * (1 - 1e-4)), arrival)
        worst = max(worst, abs(host - taken - 500))
    assert worst < 4000


@pytest.mark.parametrize(
    ("active", "back", "step", "tip", "pair"),
    [
        (21, 22, 1, 22, 0), (22, 21, 1, 22, 0), (1, 2, 1, 22, 20), (1, 2, 1, 1, 0), (21, 22, 1, 1, 20),
        (20, 22, 2, 22, 0), (1, 3, 2, 22, 19), (3, None, 1, 22, 18), (3, None, 2, 22, 17), (3, None, 1, 1, 2),
        (22, None, 1, 22, -1), (3, 5, 1, 22, -1), (3, 0, 1, 22, -1), (3, 4, 2, 22, -1),
    ],
)  # fmt: skip
def test_pairs_count_from_the_tip(active, back, step, tip, pair):
    assert Pairs(step, tip).pair_of(Sample(0, active, 1000.0, back)) == pair


@pytest.mark.parametrize(
    ("ohm", "flags", "passed_on"),
    [
        (28_800.0, {}, 28_800.0), (3.0, {}, 3.0), (2000.0, {}, 2000.0), (2000.0, {"is_open": True}, 28_800.0),
        (30_000.0, {"is_open": True}, 30_000.0), (2000.0, {"is_short": True}, 20.0), (2000.0, {"at_compliance": True}, 28_800.0),
    ],
)  # fmt: skip
def test_what_the_sender_calls_open_or_short_is_no_plausible_number(ohm, flags, passed_on):
    data = encode(Sample(1, 1, ohm, 2, 1, 1, 0, 21, **flags))
    assert believed_ohm(Icz1().decode(memoryview(data))) == passed_on
