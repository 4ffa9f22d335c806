"""A transducer on a card through its real driver: the wrench, and every row of the failure table that concerns it."""

from pathlib import Path

import numpy as np
import pytest

from drivers.ati.daq import AtiDaq
from drivers.ati.gauges import SETTLED
from hal.errors import BackendError, OptionError
from hal.frames import FROZEN, INVALID, SATURATED, VALID
from hal.troubles import Trouble
from sim_backends.emulators.ati_daq import EmulatedAtiDaq

HERE = Path(__file__).parent
TABLE = {"card": "card", "inputs": [0, 1, 2, 3, 4, 5], "calibration": str(HERE / "newer.cal")}


@pytest.fixture
def rig(lockstep):
    return make(lockstep)


def make(lockstep, **changes):
    rig = lockstep()
    rig.sensor, rig.transducer = rig.add(AtiDaq, EmulatedAtiDaq, "force", {**TABLE, **changes})
    return rig


@pytest.mark.parametrize(
    "changes",
    [
        {},
        {"inputs": [5, 3, 1, 0, 2, 4]},
        {"calibration": str(HERE / "older.cal"), "t_out_input": 7},
        {"translation_mm": [3.0, -8.0, 21.0], "rotation_deg": [20.0, -35.0, 140.0]},
        {"zero_v": [0.3, -0.2, 0.1, 0.05, -0.4, 0.2]},
    ],
)
def test_wrench_on_the_bench_is_the_wrench_that_is_read(lockstep, changes):
    rig = make(lockstep, **changes)
    rig.transducer.dither_v[:] = 3e-4
    if "t_out_input" in changes:
        rig.transducer.t_out_v += 0.7
    loads = np.random.default_rng(3).uniform(-1, 1, (50, 6)) * [2, 2, 2, 30, 30, 30]
    for load in loads:
        rig.bench.wrench_in_sensor[:] = load
        r = rig.step()
        assert r.wrench_validity == VALID
        assert r.wrench_in_sensor[:3] == pytest.approx(load[:3], abs=0.015)
        assert r.wrench_in_sensor[3:] == pytest.approx(load[3:], abs=0.2)
    assert (r.wrench_sequence, r.wrench_age_ticks) == (50, 0)


def test_seventh_channel_matters(lockstep):
    rig = make(lockstep, calibration=str(HERE / "older.cal"), t_out_input=7)
    rig.bench.wrench_in_sensor[2] = 5.0
    rig.steps(2)
    rig.transducer.t_out_v += 1.0
    gauges = rig.station.emulators["card"].volts[:6].copy()
    assert rig.step().wrench_in_sensor[2] == pytest.approx(5.0, abs=0.02)
    assert abs(rig.station.emulators["card"].volts[:6] - gauges).max() > 0.01, "the gauges did move"


@pytest.mark.parametrize("gauge", [1, 4, 6])
def test_one_gauge_at_its_rail_spoils_all_six_at_once(rig, gauge):
    rig.steps(30)
    rig.transducer.inject("gauge_rail", gauge)
    r = rig.step()
    assert r.wrench_validity == SATURATED
    assert np.isnan(r.wrench_in_sensor).all()
    assert (r.trouble, r.trouble_value) == (Trouble.GAUGE_SATURATED, gauge)
    rig.transducer.inject("gauge_rail", 0)
    assert rig.until(lambda r: r.wrench_validity == VALID) == SETTLED


def test_a_single_sample_at_the_rail_is_never_valid_and_trust_comes_back_slowly(rig):
    rig.steps(5)
    seen = []
    for i in range(40):
        rig.transducer.inject("gauge_rail", 3 if i % 4 == 0 else 0)
        seen.append(rig.step().wrench_validity)
    assert set(seen) == {SATURATED}


def test_a_cut_cable_is_told_from_a_gauge(rig):
    rig.steps(5)
    rig.transducer.inject("cable_off")
    r = rig.step()
    assert (r.wrench_validity, r.trouble) == (SATURATED, Trouble.GAUGE_CABLE)
    rig.transducer.inject("cable_off", 0)
    assert rig.until(lambda r: r.wrench_validity == VALID) == SETTLED


@pytest.mark.parametrize(
    ("changes", "bad_v"),
    [({}, 0.0), ({}, -1.7), ({"calibration": str(HERE / "older.cal")}, 0.2)],
)
def test_t_out_alone_tells_of_a_cable_as_well(lockstep, changes, bad_v):
    rig = make(lockstep, t_out_input=7, **changes)
    assert rig.steps(30) == {0}
    rig.transducer.t_out_v = bad_v
    r = rig.step()
    assert (r.wrench_validity, r.trouble) == (INVALID, Trouble.GAUGE_CABLE)
    assert np.isnan(r.wrench_in_sensor).all()


@pytest.mark.parametrize("gauge", [1, 5])
def test_a_frozen_gauge_is_found_after_twenty_equal_words(rig, gauge):
    rig.steps(100)
    rig.transducer.inject("gauge_freeze", gauge)
    assert rig.until(lambda r: r.wrench_validity == FROZEN) == 20
    assert (rig.readings.trouble, rig.readings.trouble_value) == (Trouble.GAUGE_FROZEN, gauge)
    assert np.isnan(rig.readings.wrench_in_sensor).all()
    rig.transducer.inject("gauge_freeze", 0)
    assert rig.step().wrench_validity == VALID


def test_a_stale_channel_is_found_although_the_references_make_its_voltage_dither(rig):
    """The word stands still, and calibrating it with fresh references gives another voltage every time."""
    rig.steps(50)
    card, read = rig.site.devices["card"], rig.site.devices["card"].read
    stuck, random = int(card.code[2]), np.random.default_rng(1)

    def stale(tick, readings):
        read(tick, readings)
        card.code[2] = stuck
        card.voltage_v[:] = card.code * 20 / 65536 * (1 + 1e-4 * random.standard_normal())

    card.read = stale
    ticks = rig.until(lambda r: r.trouble == Trouble.GAUGE_FROZEN)
    assert ticks <= 20
    assert rig.readings.trouble_value == 3


def test_healthy_noise_never_looks_frozen_and_a_silent_bench_does(rig):
    assert rig.steps(5000) == {0}
    rig.transducer.dither_v[:] = 0.0
    assert Trouble.GAUGE_FROZEN in rig.steps(25)


@pytest.mark.parametrize(
    ("share", "trouble"),
    [
        (0.78, 0),
        (0.82, Trouble.LOAD_HIGH),
        (-0.97, Trouble.LOAD_HIGH),
        (1.03, Trouble.LOAD_OVER_RATED),
        (-2.0, Trouble.LOAD_OVER_RATED),
    ],
)
def test_overload_is_judged_by_the_ratings_of_the_file(rig, share, trouble):
    rig.steps(5)
    rig.transducer.inject("overload", share)
    r = rig.step()
    assert r.trouble == trouble
    assert r.wrench_validity == VALID
    if trouble:
        assert r.trouble_value == pytest.approx(100 * abs(share), abs=1.5)
    assert r.wrench_in_sensor[2] == pytest.approx(18 * share, abs=0.1)


def test_a_torque_counts_in_its_own_units(rig):
    rig.bench.wrench_in_sensor[4] = 0.9 * 250
    assert rig.step().trouble == Trouble.LOAD_HIGH


def test_noise_is_reported_and_a_load_that_changes_is_none(rig):
    rig.physics = lambda bench: bench.wrench_in_sensor.__iadd__([0.005, 0, 0, 0, 0, 0])
    assert rig.steps(2000) == {0}
    rig.physics = None
    rig.bench.wrench_in_sensor[:] = [0, 0, -5.0, 0, 0, 0]
    assert rig.steps(500) == {0}, "nor is a blow"
    rig.transducer.inject("noise", 10)
    ticks = rig.until(lambda r: r.trouble == Trouble.GAUGE_NOISE)
    assert ticks < 100
    assert 0.005 < rig.readings.trouble_value < 0.02
    assert rig.readings.wrench_validity == VALID
    rig.transducer.inject("noise", 0)
    assert rig.until(lambda r: r.trouble == 0) < 1500


def test_drift_shows_in_the_wrench_until_something_gives(rig):
    rig.transducer.inject("drift", 1.0)
    rig.steps(100)
    assert abs(rig.readings.wrench_in_sensor[2]) > 0.2
    assert rig.until(lambda r: r.trouble == Trouble.LOAD_OVER_RATED, most=20000) < 10000


def test_without_a_conversion_there_is_no_wrench_and_an_old_one_says_so(rig):
    rig.steps(5)
    card = rig.site.devices["card"]
    card.silent = True
    assert [int(rig.step().wrench_age_ticks) for _ in range(30)] == list(range(1, 31))
    assert rig.readings.wrench_validity == VALID, "a repeated sample is old, not frozen"
    card.voltage_validity = INVALID
    r = rig.step()
    assert (r.wrench_validity, r.wrench_age_ticks) == (INVALID, 31)
    assert np.isnan(r.wrench_in_sensor).all()


@pytest.mark.parametrize(
    ("changes", "says"),
    [
        ({"calibration": str(HERE / "older.cal")}, "t_out_input"),
        ({"inputs": [0, 1, 2, 3, 4]}, "list of 6"),
        ({"inputs": [0, 1, 2, 3, 4, 4]}, "twice"),
        ({"inputs": [0, 1, 2, 3, 4, 5.5]}, "whole"),
        ({"t_out_input": 5}, "twice"),
        ({"inputs": [0, 1, 2, 3, 4, 12]}, "input 12"),
        ({"part": "SI-9-0.125"}, "set part"),
        ({"calibration": "nowhere.cal"}, "cannot be read"),
        ({"frozen": 3}, "unknown"),
    ],
)
def test_settings_that_do_not_fit_are_refused(lockstep, changes, says):
    with pytest.raises(OptionError, match=says):
        AtiDaq("force", {**TABLE, **changes}, lockstep().site)


def test_emulator_refuses_what_it_does_not_know(rig, lockstep):
    for fault, value in (("lightning", 1), ("gauge_rail", 7), ("gauge_freeze", 0.5)):
        with pytest.raises(BackendError):
            rig.transducer.inject(fault, value)
    with pytest.raises(BackendError, match="card"):
        EmulatedAtiDaq("force", TABLE, lockstep(card=False).station)


def test_probe_gives_the_zero_and_health_the_calibration(lockstep):
    rig = make(lockstep, zero_v=[0.5, 0, 0, 0, 0, 0])
    rig.steps(30)
    findings = {f.what: f for f in rig.sensor.probe()}
    assert all(f.good for f in findings.values())
    volts = [float(v) for v in findings["gauge voltages"].found.split()]
    assert volts == pytest.approx([0.5, 0, 0, 0, 0, 0], abs=0.01)
    rig.transducer.inject("cable_off")
    rig.steps(3)
    assert not {f.what: f for f in rig.sensor.probe()}["transducer's cable"].good
    assert "FT00002" in rig.sensor.health().identity
    assert rig.sensor.health().errors == {"gauge_cable": 1}
