"""Telemetry against the numbers of 04 sections 3 and 4, and its schedule against a table of ticks."""

import math

import numpy as np
import pytest

from hal.errors import OptionError
from hal.frames import INVALID, VALID
from sim_backends.plant import device
from sim_backends.plant.backend import PlantBackend
from sim_backends.plant.impedance import CONTACTS, bipolar_ohm, measure
from sim_backends.plant.noise import normals

EXACT = {"series_ohm": [0.0, 0.0], "noise_ohm": 0.0}
OPEN_OHM, PAIR_TICKS = 28_800.0, 70


def telemetry(seed=1, inject=None, **options):
    """An IMPEDANCE record of a plant with exact readings, if nothing else is said."""
    table = {"impedance": {**EXACT, **options}, "inject": inject or {}}
    return PlantBackend(table, period_s=0.001, seed=seed).compiled().device[0]["impedance"]


def samples(record, count, seed=9):
    """(pair, ohm) of the next samples."""
    seen = []
    for _ in range(count):
        measure(record, np.uint64(seed), (int(record["sequence"]) + 1) * PAIR_TICKS)
        seen.append((int(record["pair"]), float(record["ohm"])))
    return seen


def test_the_power_law_of_04_section_4():
    record = telemetry()
    record["modiolar_distance_mm"][:4] = 0.20, 0.25, 0.35, 0.55
    z = [bipolar_ohm(record, k, k + 1) for k in range(3)]
    assert z == pytest.approx([2262.574, 1911.386, 1595.954], abs=5e-4)


@pytest.mark.parametrize(("distance_mm", "ohm"), [(0.635993 / 0.62, 1300.0), (0.171101 / 0.62, 2000.0)])
def test_the_inversion_of_04_section_3(distance_mm, ohm):
    record = telemetry()
    record["modiolar_distance_mm"] = distance_mm
    assert bipolar_ohm(record, 3, 4) == pytest.approx(ohm, abs=1e-2)


def test_beyond_the_largest_area_and_below_the_least_distance_nothing_changes():
    record = telemetry()
    record["modiolar_distance_mm"][:6] = 1.5, 1.5, 0.03, 0.05, -0.2, 0.05
    assert bipolar_ohm(record, 0, 1) == pytest.approx(1260.623, abs=1e-3)
    nearest = bipolar_ohm(record, 2, 3)
    assert nearest == bipolar_ohm(record, 4, 5)
    assert nearest == pytest.approx(83.2 * (0.05 * 0.62) ** -1.317 + 1149.0)
    assert nearest < OPEN_OHM


def test_the_area_of_a_wide_pair_is_that_of_one_pitch():
    record = telemetry(pair_step=2)
    record["modiolar_distance_mm"] = np.linspace(0.2, 0.8, CONTACTS)
    near, far = record["modiolar_distance_mm"][[0, 2]]
    assert samples(record, 1) == [(0, pytest.approx(83.2 * ((near + far) / 2 * 0.62) ** -1.317 + 1149.0))]


@pytest.mark.parametrize(("step", "pairs"), [(1, 21), (2, 20)])
def test_a_sweep_goes_from_the_tip_through_all_pairs_and_begins_again(step, pairs):
    record = telemetry(pair_step=step)
    assert [pair for pair, _ in samples(record, 2 * pairs + 1)] == [*range(pairs), *range(pairs), 0]


def test_contacts_lie_behind_the_tip_one_pitch_apart():
    record = telemetry(first_contact_mm=0.8, pitch_mm=0.6)
    assert record["contact_from_tip_mm"] == pytest.approx(0.8 + 0.6 * np.arange(22))


def test_in_a_bath_every_pair_reads_the_largest_area():
    record = telemetry(bath=True)
    record["modiolar_distance_mm"][:5] = 0.3
    assert [ohm for _, ohm in samples(record, 21)] == pytest.approx([83.2 * 0.8**-1.317 + 1149.0] * 21)


def test_a_pair_that_is_not_all_inside_reads_open():
    record = telemetry()
    record["modiolar_distance_mm"][:5] = 0.3
    ohms = [ohm for _, ohm in samples(record, 21)]
    assert max(ohms[:4]) < 2000.0
    assert ohms[4:] == [OPEN_OHM] * 17


@pytest.mark.parametrize(
    ("step", "channel", "dead"), [(1, 0, {0}), (1, 7, {6, 7}), (1, 21, {20}), (2, 7, {5, 7}), (2, 21, {19})]
)
def test_a_broken_lead_opens_the_pairs_of_its_contact(step, channel, dead):
    record = telemetry(pair_step=step, inject={"open_channel_after_s": 0.0, "open_channel": channel})
    record["modiolar_distance_mm"] = 0.3
    readings = samples(record, CONTACTS - step)
    assert {pair for pair, ohm in readings if ohm == OPEN_OHM} == dead


def test_a_short_is_between_two_contacts():
    record = telemetry(inject={"short_channel_after_s": 0.0, "short_channel": 4})
    record["modiolar_distance_mm"] = 0.3
    readings = dict(samples(record, 21))
    assert 0.0 < readings[4] < 100.0
    assert all(ohm > 1000.0 for pair, ohm in readings.items() if pair != 4)


def test_failures_wait_for_their_time():
    inject = {"open_channel_after_s": 1.5, "open_channel": 3, "short_channel_after_s": 1.5, "short_channel": 5}
    record = telemetry(inject=inject)
    record["modiolar_distance_mm"] = 0.3
    first, second = dict(samples(record, 21)), dict(samples(record, 21))  # a sweep takes 1.47 s
    assert all(1000 < ohm < 3000 for ohm in first.values())
    assert {pair for pair, ohm in second.items() if not 1000 < ohm < 3000} == {2, 3, 5}


def test_noise_has_the_rms_of_its_option_and_series_resistance_its_bounds():
    record = telemetry(noise_ohm=120.0, series_ohm=[200.0, 700.0])
    record["modiolar_distance_mm"] = 0.4
    ohms = np.array([ohm for _, ohm in samples(record, 21 * 200)]).reshape(200, 21)
    means = ohms.mean(axis=0) - (83.2 * (0.4 * 0.62) ** -1.317 + 1149.0)
    assert (ohms - ohms.mean(axis=0)).std() == pytest.approx(120.0, rel=0.05)
    assert means.min() > 200.0 - 30.0
    assert means.max() < 700.0 + 30.0
    assert np.ptp(means) > 100.0


def test_series_resistance_belongs_to_the_seed():
    one, again, other = (telemetry(seed, series_ohm=[100.0, 500.0])["series_ohm"] for seed in (3, 3, 4))
    assert np.array_equal(one, again)
    assert not np.array_equal(one, other)


def test_the_noise_is_not_that_of_the_wrench():
    record = telemetry(noise_ohm=1.0)
    record["modiolar_distance_mm"] = 0.4
    clean = bipolar_ohm(record, 0, 1)
    noise = np.array([ohm for _, ohm in samples(record, 400, seed=5)]) - clean
    wrench = np.empty((400, 6))
    for n in range(400):
        normals(np.uint64(5), n, wrench[n])
    streams = np.column_stack((noise, wrench))
    assert np.abs(np.corrcoef(streams.T)[0, 1:]).max() < 0.2
    assert not set(np.round(noise, 9)) & set(np.round(wrench.ravel(), 9))


def test_a_large_resistance_ends_at_the_open_circuit_and_a_noisy_short_above_zero():
    record = telemetry(noise_ohm=500.0, inject={"short_channel_after_s": 0.0, "short_channel": 0}, factor_ohm=1e4)
    record["modiolar_distance_mm"] = 0.05
    readings = samples(record, 21 * 30)
    assert min(ohm for pair, ohm in readings if pair == 0) == 1.0
    assert {ohm for pair, ohm in readings if pair > 0} == {OPEN_OHM}


def test_on_the_bench_a_pair_is_read_every_70_ms(drive):
    bench = drive()
    assert np.isnan(bench.sensors["impedance_ohm"][0])
    assert (bench.sensors["impedance_validity"][0], bench.sensors["impedance_pair"][0]) == (INVALID, -1)
    seen = []
    for tick in range(1, 22 * PAIR_TICKS + 10):
        frame = bench.run(1, power=0)
        seen.append([int(frame[f"impedance_{n}"]) for n in ("sequence", "pair", "age_ticks")])
        assert frame["impedance_validity"] == (VALID if tick >= PAIR_TICKS else INVALID)
    expected = [[n := t // PAIR_TICKS, (n - 1) % 21, t - n * PAIR_TICKS] for t in range(1, 22 * PAIR_TICKS + 10)]
    assert seen[PAIR_TICKS - 1 :] == expected[PAIR_TICKS - 1 :]
    assert all(s[:2] == [0, -1] for s in seen[: PAIR_TICKS - 1])


def test_a_slower_loop_reads_as_many_pairs_in_a_second():
    backend = PlantBackend({}, period_s=0.002, seed=1)
    assert backend.compiled().device[0]["impedance"]["period_ticks"] == PAIR_TICKS // 2


def test_outside_the_cochlea_every_pair_is_open(drive):
    bench = drive()
    for loaded in (0, 1):
        bench.load_array(loaded)
        bench.run(200, power=0)
        assert bench.sensors["impedance_ohm"][0] == OPEN_OHM


def test_missed_ticks_miss_samples_and_change_no_other(drive):
    every, jump = drive(), drive()
    for bench in (every, jump):
        bench.run(10, power=0)
    every.run(490, power=0)
    jump.read(500)
    for name in ("ohm", "pair", "sequence", "age_ticks", "validity"):
        assert every.sensors[f"impedance_{name}"] == jump.sensors[f"impedance_{name}"], name
    jump.read(10**8)
    assert jump.sensors["impedance_sequence"][0] == 10**8 // PAIR_TICKS


def test_telemetry_that_stops_ages_and_is_dead_after_half_a_second(drive):
    bench = drive({"inject": {"impedance_silent_after_s": 0.2}})
    last = 2 * PAIR_TICKS
    frame = bench.run(last + 500, power=0)
    assert (frame["impedance_sequence"], frame["impedance_age_ticks"], frame["impedance_validity"]) == (2, 500, VALID)
    frame = bench.run(1, power=0)
    assert (frame["impedance_sequence"], frame["impedance_age_ticks"], frame["impedance_validity"]) == (2, 501, INVALID)
    assert math.isnan(frame["impedance_ohm"])
    assert frame["impedance_pair"] == -1
    assert (frame["axes_validity"], frame["wrench_validity"]) == (VALID, VALID)


def test_a_new_session_begins_a_new_sweep(drive):
    bench = drive()
    bench.run(300, power=0)
    bench.backend.close()
    assert np.isnan(bench.read(bench.tick + 1)["impedance_ohm"])
    bench.backend.open()
    assert bench.read(bench.tick + 1)["impedance_sequence"] == 0
    bench.run(PAIR_TICKS, power=0)
    assert (bench.sensors["impedance_sequence"][0], bench.sensors["impedance_pair"][0]) == (1, 0)


def test_distances_of_the_tick_reach_the_frame(drive):
    """What the array's owner writes between two ticks is what the sample due then shows."""
    bench = drive({"impedance": EXACT})
    bench.run(PAIR_TICKS - 1, power=0)
    bench.device["impedance"]["modiolar_distance_mm"] = 0.2 + 0.01 * np.arange(CONTACTS)
    measure(bench.device["impedance"], np.uint64(0), PAIR_TICKS)
    expected = 83.2 * ((0.2 + 0.21) / 2 * 0.62) ** -1.317 + 1149.0
    assert bench.device["impedance"]["ohm"] == pytest.approx(expected)
    device._sample_impedance(bench.device, bench.sensors[0])
    assert bench.sensors["impedance_ohm"][0] == pytest.approx(expected)


@pytest.mark.parametrize(
    ("table", "match"),
    [
        ({"impedance": {"pair_step": 3}}, r"impedance\.pair_step"),
        ({"impedance": {"noise_ohm": -1.0}}, r"impedance\.noise_ohm"),
        ({"impedance": {"exponent": 1.0}}, r"impedance\.exponent"),
        ({"impedance": {"series_ohm": [500.0, 100.0]}}, "not an interval"),
        ({"impedance": {"first_contact_mm": 5.0}}, "not on the array"),
        ({"inject": {"open_channel": 22}}, r"inject\.open_channel"),
        (
            {"impedance": {"pair_step": 2}, "inject": {"short_channel_after_s": 1.0, "short_channel": 20}},
            "begins no pair",
        ),
    ],
)
def test_bad_options_are_refused(table, match):
    with pytest.raises(OptionError, match=match):
        PlantBackend(table, period_s=0.001, seed=0)
