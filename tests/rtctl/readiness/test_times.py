"""Times: counted exactly, whatever their number, and read from what cyclictest prints."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hal.errors import RtctlError
from rtctl.readiness import cyclictest
from rtctl.readiness.times import COUNTED_NS, Times
from rtctl.settings import load

SOME_NS = st.lists(st.integers(0, 3 * COUNTED_NS), min_size=1, max_size=60)


def times_of(*blocks) -> Times:
    times = Times()
    for block in blocks:
        times.add(np.array(block, np.int32))
    return times


@given(SOME_NS, SOME_NS, st.sampled_from([0.1, 25.0, 50.0, 99.0, 99.9, 100.0]))
def test_percentiles_are_those_of_all_times_together(first, second, percent):
    times, other = times_of(first), times_of(second)
    times.merge(other)
    assert times.count == len(first) + len(second)
    assert times.percentile_ns(percent) == np.percentile(first + second, percent, method="inverted_cdf")
    assert times.longest_ns == max(first + second)
    assert times.longer_than(COUNTED_NS // 2) == sum(t > COUNTED_NS // 2 for t in first + second)


@given(SOME_NS)
def test_the_histogram_holds_every_time_in_its_bin(some):
    told = times_of(some).histogram()
    assert sum(told["counts"]) == len(some)
    assert len(told["edges_us"]) == len(told["counts"]) + 1
    expected, _ = np.histogram(np.maximum(some, 100) * 1e-3, np.array(told["edges_us"]))
    assert np.abs(np.cumsum(expected) - np.cumsum(told["counts"])).max() <= sum(
        any(abs(t * 1e-3 / e - 1) < 1e-3 for e in told["edges_us"]) for t in some
    ), "but for times on an edge, which is told with four digits"


def test_without_times_there_is_no_percentile():
    assert Times().histogram() == {"edges_us": [], "counts": []}
    with pytest.raises(ValueError, match="no times"):
        Times().percentile_ns(50.0)


PRINTED = """# /dev/cpu_dma_latency set to 0us
# Histogram
000000 000000
012345 000003
019999 000001
# Total: 000000004
# Min Latencies: 12345
# Avg Latencies: 14000
# Max Latencies: {longest}
# Histogram Overflows: {beyond}
# Histogram Overflow at cycle number:
# Thread 0: 00017 00018
"""


def test_what_cyclictest_prints_is_read():
    times = cyclictest.read(PRINTED.format(longest="000000019999", beyond="00000"))
    assert (times.count, times.percentile_ns(75.0), times.longest_ns) == (4, 12345, 19999)


def test_wake_ups_beyond_its_histogram_are_not_forgotten():
    times = cyclictest.read(PRINTED.format(longest="000007654321", beyond="00002"))
    assert (times.count, times.longest_ns) == (6, 7_654_321)
    assert times.longer_than(999_999) == 2


def test_a_cyclictest_that_tells_nothing_is_an_error():
    with pytest.raises(RtctlError, match="told nothing"):
        cyclictest.read("# Histogram\n000000 000000\n")


def test_the_reference_runs_as_the_loop_does():
    words = cyclictest.command(load("planar-sim", ["loop.cpu=1", "loop.priority=70", "loop.period_s=0.002"]), 500)
    options = dict(zip(words[words.index("-p") :: 2], words[words.index("-p") + 1 :: 2], strict=True))
    assert options == {"-p": "70", "-i": "2000", "-l": "500", "-h": str(COUNTED_NS), "-a": "1", "-t": "1"}


def test_without_cyclictest_it_is_said(monkeypatch):
    monkeypatch.setattr(cyclictest.shutil, "which", lambda _: None)
    assert "rt-tests" in cyclictest.obstacle(load("planar-sim"))
