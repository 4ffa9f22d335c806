"""Every row of the failure table that concerns the telemetry, through the driver, against the emulator."""

import numpy as np
import pytest
from cim_bench import LOCAL, PEER, SAMPLE_TICKS, SWEEP_TICKS, CimBench

from drivers.cim.device import CimTelemetry
from hal.device import Site
from hal.errors import BackendError, OptionError
from hal.frames import FROZEN, INVALID, VALID
from hal.switchboard import Switchboard
from hal.troubles import Trouble

WARM = 2 * SWEEP_TICKS


@pytest.fixture
def bench():
    made = CimBench()
    made.run(WARM)
    assert made.readings.impedance_validity == VALID
    assert made.readings.trouble == Trouble.NONE
    return made


@pytest.mark.parametrize(
    ("fault", "trouble", "within_ticks", "value"),
    [
        ("silence", Trouble.TELEMETRY_SILENT, 211, 211),
        ("drop", Trouble.TELEMETRY_GAP, 2 * SAMPLE_TICKS, 1),
        ("reorder", Trouble.TELEMETRY_GAP, 2 * SAMPLE_TICKS, 1),
        ("new_run", Trouble.TELEMETRY_NEW_RUN, SAMPLE_TICKS, None),
        ("corrupt_crc", Trouble.TELEMETRY_CORRUPT, 3 * SAMPLE_TICKS, 3),
        ("bad_length", Trouble.TELEMETRY_CORRUPT, 3 * SAMPLE_TICKS, 3),
        ("foreign", Trouble.TELEMETRY_CORRUPT, 3 * SAMPLE_TICKS, 3),
        ("freeze", Trouble.TELEMETRY_FROZEN, 4 * SWEEP_TICKS, 3),
    ],
)
def test_a_fault_is_told_in_time_and_mends(bench, fault, trouble, within_ticks, value):
    bench.emulator.inject(fault)
    latency = bench.until(lambda r: r.trouble == trouble)
    assert latency + 1 <= within_ticks
    if value is not None:
        assert bench.readings.trouble_value == value
    bench.emulator.inject(fault, 0)
    bench.until(lambda r: r.trouble == Trouble.NONE and r.impedance_validity == VALID)


def test_many_corrupt_datagrams_raise_the_alarm_over_the_silence_they_cause(bench):
    bench.emulator.inject("corrupt_crc")
    bench.until(lambda r: r.impedance_age_ticks > 211)
    assert bench.readings.trouble == Trouble.TELEMETRY_CORRUPT
    assert bench.device.health().errors["refused_checksum"] == bench.readings.trouble_value
    assert bench.until(lambda r: r.impedance_validity == INVALID) < 500


def test_one_corrupt_datagram_is_counted_and_no_alarm(bench):
    bench.emulator.inject("bad_length")
    bench.run(SAMPLE_TICKS)
    bench.emulator.inject("bad_length", 0)
    heard = {bench.step().trouble for _ in range(2 * SWEEP_TICKS)}
    assert heard == {Trouble.TELEMETRY_GAP, Trouble.NONE}
    assert bench.device.health().errors["refused_length"] == 1


def test_silence_invalidates_after_half_a_second_and_not_before(bench):
    bench.until(lambda r: r.impedance_age_ticks == 0)
    bench.emulator.inject("silence")
    before = bench.readings.impedance_sequence
    for age in range(1, 501):
        r = bench.step()
        assert (r.impedance_validity, r.impedance_age_ticks) == (VALID, age)
        assert (r.trouble == Trouble.TELEMETRY_SILENT) == (age > 210)
    r = bench.step()
    assert r.impedance_validity == INVALID
    assert np.isnan(r.impedance_ohm)
    assert r.impedance_pair == -1
    assert r.impedance_sequence == before
    assert r.trouble_value == 501


def test_a_sender_that_never_came_is_silent_and_never_valid():
    bench = CimBench()
    bench.emulator.inject("silence")
    r = bench.run(1000)
    assert r.impedance_validity == INVALID
    assert r.impedance_sequence == 0
    assert (r.trouble, r.trouble_value) == (Trouble.TELEMETRY_SILENT, 999)


def test_a_new_run_is_not_continued_but_armed_anew_after_two_sweeps(bench):
    before = bench.readings.impedance_sequence
    bench.emulator.inject("new_run")
    bench.until(lambda r: r.trouble == Trouble.TELEMETRY_NEW_RUN)
    ticks = 1 + bench.until(lambda r: r.impedance_validity == VALID)
    assert 2 * SWEEP_TICKS <= ticks <= 2 * SWEEP_TICKS + SAMPLE_TICKS
    assert bench.readings.impedance_age_ticks <= 1
    assert bench.readings.impedance_sequence == before + 1
    assert bench.readings.trouble == Trouble.NONE
    assert bench.device.health().errors["withheld"] == 42


def test_a_duplicate_is_no_sample(bench):
    samples = bench.readings.impedance_sequence
    bench.emulator.inject("duplicate", 5)
    r = bench.run(5 * SAMPLE_TICKS)
    assert r.impedance_sequence == samples + 5
    assert r.trouble == Trouble.NONE
    assert bench.device.health().errors["doubles"] == 5


def test_a_late_datagram_is_no_sample(bench):
    bench.emulator.inject("reorder")
    samples = bench.readings.impedance_sequence
    r = bench.run(4 * SAMPLE_TICKS)
    assert r.impedance_sequence == samples + 3
    assert bench.device.health().errors["late"] == 1


def test_frozen_values_are_withheld_while_the_samples_go_on(bench):
    bench.emulator.inject("freeze")
    ticks = bench.until(lambda r: r.impedance_validity == FROZEN)
    assert 3 * SWEEP_TICKS < ticks <= 4 * SWEEP_TICKS
    assert np.isnan(bench.readings.impedance_ohm)
    bench.emulator.inject("freeze", 0)
    assert bench.until(lambda r: r.impedance_validity == VALID) < SAMPLE_TICKS


def test_an_array_in_air_is_open_everywhere_and_not_frozen():
    bench = CimBench()
    bench.ohm = lambda *_: 28_800.0
    r = bench.run(6 * SWEEP_TICKS)
    assert (r.impedance_validity, r.impedance_ohm, r.trouble) == (VALID, 28_800.0, Trouble.NONE)


@pytest.mark.parametrize(("fault", "ohm"), [("open", 28_800.0), ("short", 20.0)])
@pytest.mark.parametrize("pair", [0, 20])
def test_opens_and_shorts_are_samples_of_their_pair_alone(bench, fault, ohm, pair):
    bench.emulator.inject(fault, 1 + pair)
    read = {}
    for _ in range(SWEEP_TICKS):
        r = bench.step()
        read[r.impedance_pair] = r.impedance_ohm
    assert read.pop(pair) == pytest.approx(ohm)
    assert all(1500.0 < z < 2500.0 for z in read.values())
    assert len(read) == 20


def test_an_electrode_that_is_left_out_is_told_after_two_sweeps(bench):
    inner = bench.emulator.sense
    bench.emulator.sense = lambda tick, b: b.impedance_pair != 5 and inner(tick, b)
    ticks = bench.until(lambda _: bench.device.health().errors["stale_pairs"] > 0)
    assert SWEEP_TICKS < ticks <= 2 * SWEEP_TICKS + SAMPLE_TICKS
    assert (bench.readings.trouble, bench.readings.trouble_value) == (Trouble.TELEMETRY_GAP, 1)
    bench.run(SWEEP_TICKS)
    assert bench.device.health().errors["stale_pairs"] == 1


@pytest.mark.parametrize("tip", [1, 22])
@pytest.mark.parametrize("step", [1, 2])
def test_pairs_are_those_of_the_bench_whatever_the_numbering(tip, step):
    bench = CimBench(pair_step=step, tip_electrode=tip)
    bench.ohm = lambda pair, _: 1000.0 + pair
    for _ in range(2 * SWEEP_TICKS):
        r = bench.step()
        assert r.impedance_validity == VALID
        assert (r.impedance_pair, r.impedance_ohm) == (bench.bench.impedance_pair, 1000.0 + r.impedance_pair)


def test_electrodes_of_another_step_are_refused():
    bench = CimBench(pair_step=2)
    bench.emulator._step = 1
    r = bench.run(1000)
    assert r.impedance_validity == INVALID
    assert r.trouble == Trouble.TELEMETRY_CORRUPT
    assert bench.device.health().errors["refused_pair"] == 15


def test_waiting_samples_come_one_a_tick_with_their_own_ages(bench):
    last = bench.readings.impedance_sequence
    tick = bench.tick
    for n in range(10):  # the controller's computer was busy
        bench.bench.impedance_sequence += 1
        bench.bench.impedance_pair = n
        bench.emulator.sense(tick + 70 * n, bench.bench)
    bench.emulator.sense = lambda *_: None
    bench.tick += 640
    for n in range(10):
        r = bench.step()
        assert (r.impedance_sequence, r.impedance_pair) == (last + 1 + n, n)
        assert r.impedance_age_ticks == pytest.approx(640 + n - 70 * n, abs=1)
        assert r.impedance_validity == VALID
    assert bench.step().impedance_sequence == last + 10


def test_samples_that_do_not_fit_into_the_queue_are_counted(bench):
    before = bench.readings.impedance_sequence
    for n in range(50):
        bench.bench.impedance_sequence += 1
        bench.bench.impedance_pair = n % 21
        bench.emulator.sense(bench.tick + 70 * n, bench.bench)
    bench.tick += 70 * 50
    bench.emulator.sense = lambda *_: None
    assert bench.step().trouble == Trouble.TELEMETRY_GAP
    r = bench.run(60)
    assert r.impedance_sequence - before == 42
    assert bench.device.health().errors["overflows"] == 8


def test_ages_follow_the_fastest_datagram_not_the_sender():
    """A delay that grows from one datagram to the next shows in the age, though the arrival is recent."""
    bench = CimBench()
    bench.run(SWEEP_TICKS)
    inner = bench.emulator.sense
    bench.emulator.sense = lambda tick, b: inner(tick - 30, b)
    bench.until(lambda r: r.impedance_sequence > 25)
    assert bench.readings.impedance_age_ticks == 30


def test_probe_names_what_is_missing():
    bench = CimBench(sample_period_s=0.002, late_s=0.01, silent_s=0.02)
    findings = bench.device.probe()
    assert [f.good for f in findings] == [False, True, False]
    for n in range(21):
        bench.bench.impedance_sequence, bench.bench.impedance_pair, bench.bench.impedance_ohm = n + 1, n, 900.0
        bench.emulator.sense(70 * n, bench.bench)
    assert [f.good for f in bench.device.probe()] == [True, True, True]


def test_settings_are_refused_with_what_to_do():
    with pytest.raises(OptionError, match="tip_electrode"):
        CimBench(tip_electrode=11)
    with pytest.raises(OptionError, match="silence"):
        CimBench(late_s=0.6)
    with pytest.raises(OptionError, match="speaks another layout"):
        CimBench(decoder="minimal")
    with pytest.raises(OptionError, match=r"icz1 \| minimal"):
        CimTelemetry("cim", {"local": LOCAL, "peer": PEER, "decoder": "icz2"}, Site(0.001, 50, Switchboard()))
    with pytest.raises(BackendError, match="silence"):
        CimBench().emulator.inject("explode")
