"""Every row of the failure table that concerns the card (07 section 7), through the real driver against the emulator."""

import numpy as np
import pytest

from hal.errors import BackendError
from hal.frames import INVALID, VALID
from hal.switchboard import Switchboard
from hal.troubles import Grade, Trouble, say

HEALTHY_TICKS = 5
WATCHDOG = {"watchdog_code": 3, "watchdog_interval_s": 0.02, "watchdog_line": 5}
LOOP_BACK = {"loop_back": [3, 7]}


def run(rig, ticks):
    """Troubles of some ticks in which encoder 0 turns and output 3 moves."""
    found = []
    for _ in range(ticks):
        rig.emulated.set_encoder(0, 40 * (rig.now + 1))
        rig.card.put_voltage(3, 0.2 * rig.now)
        rig.tick()
        found.append(rig.trouble)
    return found


@pytest.mark.parametrize(
    ("fault", "value", "table", "trouble", "grade", "latency_ticks"),
    [
        ("signature", 0xFFFF, {}, Trouble.CARD_LOST, Grade.FAULT, 1),
        ("signature", 0x1234, {}, Trouble.CARD_LOST, Grade.FAULT, 1),
        ("adc_never_done", 1, {}, Trouble.ADC_NOT_DONE, Grade.WARNING, 1),
        ("adc_never_done", 1, {}, Trouble.ADC_STOPPED, Grade.FAULT, 3),
        ("reference_drift", 0.008, {}, Trouble.ADC_REFERENCE, Grade.PAUSE, 1),  # +10 V out of the converter's range
        ("reference_drift", -0.008, {}, Trouble.ADC_REFERENCE, Grade.PAUSE, 1),
        ("reference_offset", 70, {}, Trouble.ADC_REFERENCE, Grade.PAUSE, 1),
        ("reference_offset", -50, {}, Trouble.ADC_REFERENCE, Grade.PAUSE, 1),
        ("dac_freeze", 4, LOOP_BACK, Trouble.DAC_MISMATCH, Grade.FAULT, 2),  # seen when the next value was written
    ],
)
def test_trouble_is_reported_in_time_and_every_tick(make_card_rig, fault, value, table, trouble, grade, latency_ticks):
    rig = make_card_rig(**table)
    assert run(rig, HEALTHY_TICKS) == [Trouble.NONE] * HEALTHY_TICKS
    rig.emulated.inject(fault, value)
    troubles, grades = [], []
    for _ in range(12):
        troubles += run(rig, 1)
        grades.append(rig.readings.trouble_grade)
        if rig.readings.trouble:
            text, remedy = say(rig.readings.trouble, rig.readings.trouble_value)
            assert "{" not in text
            assert remedy
    assert troubles.index(trouble) + 1 == latency_ticks
    assert grades[latency_ticks - 1] == grade
    lasting = trouble if trouble is not Trouble.ADC_NOT_DONE else Trouble.ADC_STOPPED
    assert troubles[3:] == [lasting] * 9


@pytest.mark.parametrize("fault", ["adc_never_done", "reference_drift", "reference_offset"])
def test_a_converter_that_cannot_be_trusted_gives_no_number_until_it_is_mended(make_card_rig, fault):
    rig = make_card_rig()
    run(rig, HEALTHY_TICKS)
    rig.emulated.inject(fault, 1 if fault == "adc_never_done" else -0.02 if fault == "reference_drift" else 90)
    sequence = rig.card.voltage_sequence
    for _ in range(5):
        run(rig, 1)
        assert rig.card.voltage_validity == INVALID
        assert np.isnan(rig.card.voltage_v).all()
        assert not rig.card.railed.any()
        assert rig.card.voltage_sequence == sequence
        assert (rig.card.count_validity == VALID).all()
    rig.emulated.inject(fault, 0)
    assert run(rig, 3) == [Trouble.NONE] * 3
    assert rig.card.voltage_validity == VALID
    assert rig.card.voltage_sequence == sequence + 3


def test_counting_of_missed_conversions_starts_anew_after_a_good_one(rig):
    for _ in range(3):
        rig.emulated.inject("adc_never_done", 1)
        assert run(rig, 2) == [Trouble.ADC_NOT_DONE] * 2
        assert rig.readings.trouble_value == 2
        rig.emulated.inject("adc_never_done", 0)
        assert run(rig, 1) == [Trouble.NONE]


def test_a_slow_conversion_is_not_taken_for_the_next_one(make_card_rig):
    """Done bits and results of a scan that came too late must not pass for the scan that was started after it."""
    rig = make_card_rig()
    rig.emulated.record["noise_lsb"] = 0.0
    rig.emulated.record["settle_accesses"] = 100
    rig.emulated.set_input(0, 1.0)
    assert run(rig, 1) == [Trouble.ADC_NOT_DONE]
    rig.emulated.set_input(0, 2.0)
    rig.emulated.record["settle_accesses"] = 15
    assert run(rig, 1) == [Trouble.NONE]
    assert rig.card.voltage_v[0] == pytest.approx(2.0, abs=1e-3)


def test_a_lost_card_stays_lost_until_it_is_opened_anew(rig):
    """Its counters may have started again, so a signature that comes back proves nothing about positions."""
    run(rig, HEALTHY_TICKS)
    rig.emulated.inject("signature", 0xFFFF)
    assert run(rig, 1) == [Trouble.CARD_LOST]
    assert rig.readings.trouble_value == 0xFFFF
    assert not rig.card.count_validity.any()
    assert rig.card.voltage_validity == INVALID
    assert np.isnan(rig.card.voltage_v).all()
    assert rig.card.line.all()  # as open lines read: an amplifier's Ready is not given
    rig.emulated.inject("signature", 0)
    assert run(rig, 3) == [Trouble.CARD_LOST] * 3
    rig.card.close()
    rig.card.open()
    assert run(rig, 3) == [Trouble.NONE] * 3
    assert rig.card.count_validity.all()


@pytest.mark.parametrize("channel", range(6))
def test_a_stale_channel_is_bit_identical_while_the_others_dither(rig, channel):
    """What comedi's channels 2 to 7 do; the sensor's driver counts how long a gauge stays the same."""
    rig.emulated.inject("stale_channel", 1 + channel)
    seen = []
    for _ in range(20):
        run(rig, 1)
        seen.append(rig.card.code[:6].copy())
    frozen = (np.array(seen) == seen[0]).all(axis=0)
    assert frozen.tolist() == [k == channel for k in range(6)]
    rig.emulated.inject("stale_channel", 0)
    rig.emulated.set_input(channel, 3.0)
    run(rig, 1)
    assert rig.card.voltage_v[channel] == pytest.approx(3.0, abs=2e-3)


@pytest.mark.parametrize(("voltage_v", "railed"), [(9.93, False), (10.05, True), (-9.93, False), (-10.05, True)])
def test_an_input_at_its_rail_is_flagged_in_the_same_tick(rig, voltage_v, railed):
    run(rig, 1)
    rig.emulated.set_input(2, voltage_v)
    run(rig, 1)
    assert rig.card.railed.tolist() == [k == 2 and railed for k in range(8)]
    assert rig.card.voltage_validity == VALID


def test_a_railed_input_is_injected_and_mended(rig):
    rig.emulated.inject("input_rail", 1)
    run(rig, 1)
    assert rig.card.railed[0]
    rig.emulated.inject("input_rail", 0)
    run(rig, 1)
    assert not rig.card.railed.any()


def test_a_frozen_encoder_stands_still_and_has_lost_what_it_missed(rig):
    run(rig, 4)
    rig.emulated.inject("encoder_freeze", 1)
    standing = int(rig.card.count[0])
    for _ in range(4):
        run(rig, 1)
        assert rig.card.count[0] == standing
    rig.emulated.inject("encoder_freeze", 0)
    run(rig, 2)
    assert rig.card.count[0] == standing + 80


def test_dropped_edges_show_against_the_index(rig):
    rig.emulated.set_index(0, 1000)
    rig.emulated.inject("encoder_drop", 1)
    run(rig, 60)
    assert rig.card.count[0] == 2160
    assert rig.card.index_count[0] == 1800
    assert rig.card.index_sequence[0] == 2


def test_a_glitch_is_a_jump_of_one_tick(rig):
    run(rig, 3)
    before = int(rig.card.count[0])
    rig.emulated.inject("encoder_glitch", 1)
    run(rig, 1)
    assert rig.card.count[0] - before == 5040
    run(rig, 1)
    assert rig.card.count[0] - before == 5080


def test_illegal_steps_are_flagged_while_they_last(rig):
    run(rig, 1)
    rig.emulated.inject("ecap", 2)
    for _ in range(3):
        run(rig, 1)
        assert rig.card.count_error.tolist() == [False, True, False, False]
    rig.emulated.inject("ecap", 0)
    run(rig, 1)
    assert not rig.card.count_error.any()
    assert rig.card.errors["count_error"] == 3


def test_suppressed_and_added_index_pulses(rig):
    rig.emulated.set_index(0, 1000)
    rig.emulated.inject("index_suppress", 1)
    run(rig, 40)
    assert rig.card.index_sequence[0] == 0
    rig.emulated.inject("index_suppress", 0)
    rig.emulated.inject("index_add", 1)
    run(rig, 1)
    assert rig.card.index_sequence[0] == 1
    assert rig.card.index_count[0] == 1600


def test_an_index_that_latched_nothing_is_counted_and_not_used(rig):
    """A pulse in the few accesses in which the counter latches on read leaves the latch as it was."""
    run(rig, 1)
    rig.emulated.record["events"][0, 0] |= 4
    rig.emulated.record["latch"][0, 0] = 0x400000
    run(rig, 1)
    assert rig.card.errors["index_missed"] == 1
    assert rig.card.index_sequence[0] == 0


@pytest.mark.parametrize("direction", [1, -1])
def test_the_wrap_of_24_bits_goes_unnoticed(make_card_rig, direction):
    rig = make_card_rig(opened=False)
    rig.emulated.inject("preset_near_wrap", 100 if direction > 0 else 2**23)
    rig.card.open()
    rig.emulated.set_index(0, 90)
    for tick in range(1, 21):
        rig.emulated.set_encoder(0, direction * 40 * tick)
        rig.tick()
        assert rig.card.count[0] == direction * 40 * tick
    assert rig.card.index_count[0] == direction * 720


def test_a_dead_driver_opens_the_enable_chain_and_is_told_so(make_card_rig):
    rig = make_card_rig(**WATCHDOG)
    run(rig, 5)
    rig.emulated.inject("stop_petting", 1)
    tripped = []
    for _ in range(25):
        run(rig, 1)
        tripped.append(rig.readings.watchdog_tripped)
    assert tripped.index(True) == 20 - 1
    assert all(tripped[20 - 1 :])
    assert rig.emulated.watchdog_expired()
    rig.emulated.inject("stop_petting", 0)
    rig.demand.clear_faults = True
    run(rig, 2)
    assert not rig.readings.watchdog_tripped


def test_outputs_hold_what_a_dead_driver_wrote_last(make_card_rig):
    """Why the watchdog has to be in the enable chain."""
    rig = make_card_rig(**WATCHDOG)
    rig.card.put_voltage(0, 4.0)
    rig.tick()
    for _ in range(100):
        rig.emulated.sense(rig.now, rig.bench)
        rig.now += 1
    assert rig.emulated.output_v(0) == pytest.approx(4.0, abs=1e-3)
    assert rig.emulated.watchdog_expired()


@pytest.mark.parametrize(
    ("fault", "value", "words"),
    [
        ("signature", 0xFFFF, "526A | 526B"),
        ("signature", 0x526C, "jumpers J1"),
        ("eeprom_corrupt", 1, "no calibration: gain of output 0"),
        ("adc_never_done", 1, "does not finish"),
    ],
)
def test_a_broken_card_is_not_opened(make_card_rig, fault, value, words):
    rig = make_card_rig(opened=False)
    rig.emulated.inject(fault, value)
    with pytest.raises(BackendError) as caught:
        rig.card.open()
    assert words in str(caught.value)
    rig.card.close()


def test_a_silent_eeprom_is_not_believed(make_card_rig):
    rig = make_card_rig(opened=False)
    rig.emulated.record["eeprom_accesses"] = 2**30
    with pytest.raises(BackendError, match="36 of 36 words"):
        rig.card.open()


@pytest.mark.parametrize("signature", [0x526A, 0x526B])
def test_both_revisions_are_opened(make_card_rig, signature):
    rig = make_card_rig(opened=False)
    rig.emulated.inject("signature", signature)
    rig.card.open()
    assert run(rig, 2) == [Trouble.NONE] * 2


def test_no_card_at_all(make_card_rig):
    rig = make_card_rig(opened=False)
    rig.card._site.seams = Switchboard()
    with pytest.raises(BackendError, match="got 'FFFF'"):
        rig.card.open()


def test_unknown_faults_are_refused(rig):
    with pytest.raises(BackendError, match="adc_never_done"):
        rig.emulated.inject("fire")
