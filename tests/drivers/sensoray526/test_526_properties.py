"""What holds for any counts, any converter, any calibration and any register contents."""

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from drivers.sensoray526 import counters, scan
from drivers.sensoray526.eeprom import parse
from hal.errors import BackendError
from hal.frames import INVALID, VALID
from hal.seams import TIMED_OUT, Kind
from hal.troubles import Trouble
from sim_backends.emulators.sensoray526_card import set_factory

HALF = 2**23
REFUSALS = (Trouble.CARD_LOST, Trouble.ADC_NOT_DONE, Trouble.ADC_REFERENCE)


@given(st.lists(st.integers(-HALF, HALF - 1), min_size=1, max_size=40))
def test_unwrapping_is_exact_for_any_steps_below_half_the_range(steps):
    """Against Python's own integers; the sum goes far beyond 24 bits."""
    raw, count = np.zeros(4, np.int64), np.zeros(4, np.int64)
    rest = np.zeros(4, np.bool_), np.zeros(4, np.int64), np.zeros(4, np.int64), np.zeros(1, np.int32)
    words = np.zeros((1, 3), np.int32)
    truth = 0
    for step in steps:
        truth += step
        words[0, 1], words[0, 2] = truth & 0xFFFF, truth >> 16 & 0xFF
        counters.decode(words, np.array([2]), 0, 0, raw, count, *rest)
        assert count[2] == truth
    assert not count[[0, 1, 3]].any()


@settings(max_examples=25)
@given(
    positions=st.lists(st.integers(-3_000_000, 3_000_000), min_size=1, max_size=12), turn=st.integers(50_000, 90_000)
)
def test_count_and_index_are_exact_through_card_and_driver(make_card_rig, positions, turn):
    rig = make_card_rig()
    rig.emulated.set_index(0, turn)
    before = 0
    for position in positions:
        rig.emulated.set_encoder(0, position)
        rig.tick()
        assert rig.card.count[0] == position
        entered = (
            (position // turn > before // turn) if position > before else (-(-position // turn) < -(-before // turn))
        )
        if entered:
            assert rig.card.index_count[0] % turn == 0
            assert min(before, position) <= rig.card.index_count[0] <= max(before, position)
        before = position
    assert rig.card.errors["index_missed"] == 0


@settings(max_examples=60)
@given(
    gain=st.floats(-0.0095, -0.0005),
    offset=st.floats(-49.0, 30.0),
    reference_v=st.floats(9.97, 10.0),
    voltages=st.lists(st.floats(-9.8, 9.8), min_size=6, max_size=6),
)
def test_a_converters_gain_and_offset_cancel(make_card_rig, gain, offset, reference_v, voltages):
    """What is left is the rounding of three codes: 1 LSB where the input is small, up to 2 at the ends."""
    gain_codes = 3276.8 * (1.0 + gain)
    assume(round(gain_codes * reference_v + offset) < 0x7FFF)
    rig = make_card_rig(opened=False)
    record = rig.emulated.record
    record["noise_lsb"], record["reference_v"] = 0.0, reference_v
    record["adc_gain"], record["adc_offset"] = 32768.0 * (1.0 + gain) / reference_v, offset
    assume(round(float(record["adc_gain"][0]) * reference_v + offset) < 0x7FFF)
    set_factory(record, tuple(record["dac_gain"][0]), tuple(record["dac_offset"][0]))
    rig.card.open()
    for channel, voltage_v in enumerate(voltages):
        rig.emulated.set_input(channel, voltage_v)
    rig.tick()
    assert rig.card.voltage_validity == VALID
    lsb_v = 1.0 / record["adc_gain"][0]
    for channel, voltage_v in enumerate(voltages):
        assert abs(rig.card.voltage_v[channel] - voltage_v) <= lsb_v * (1.0 + abs(voltage_v) / 10.0)


@settings(max_examples=40)
@given(
    gain=st.lists(st.floats(0.9501, 1.0499), min_size=4, max_size=4),
    offset=st.lists(st.floats(0.9501, 1.0499), min_size=4, max_size=4),
    voltages=st.lists(st.floats(-9.0, 9.0), min_size=4, max_size=4),
)
def test_an_output_carries_what_was_put_to_half_an_lsb(make_card_rig, gain, offset, voltages):
    rig = make_card_rig(opened=False)
    true_gain, true_offset = tuple(3276.8 * g for g in gain), tuple(32768.0 * o for o in offset)
    set_factory(rig.emulated.record, true_gain, true_offset)
    rig.card.open()
    for channel, voltage_v in enumerate(voltages):
        assert abs(rig.emulated.output_v(channel)) <= 0.5 / true_gain[channel] * (1 + 1e-9)
        rig.card.put_voltage(channel, voltage_v)
    rig.tick()
    for channel, voltage_v in enumerate(voltages):
        code = true_gain[channel] * voltage_v + true_offset[channel]
        if 0 <= code <= 0xFFFF:
            assert abs(rig.emulated.output_v(channel) - voltage_v) <= (0.5 + 1e-6) / true_gain[channel]
        else:
            assert rig.emulated.record["code"][0, channel] in (0, 0xFFFF)


@given(st.lists(st.integers(0, 0xFFFF), min_size=36, max_size=36))
def test_no_random_words_pass_for_a_calibration(words):
    with pytest.raises(BackendError, match="no calibration"):
        parse(np.array(words, np.uint16))


class Soup:
    """Ports of a card that answers `signature` and else anything, once it is `on`."""

    def __init__(self, ports):
        self.ports, self.on, self.signature, self.draw = ports, False, 0, None

    def execute(self, operations):
        if not self.on:
            return self.ports.execute(operations)
        for o in operations:
            if o["kind"] == Kind.READ:
                o["result"] = self.signature if o["port"] & 0x3F == 0x34 else self.draw(st.integers(0, 0xFFFF))
            elif o["kind"] == Kind.POLL:
                o["result"] = self.draw(st.sampled_from([TIMED_OUT, 4]))
        return int((operations["result"][operations["kind"] == Kind.POLL] == TIMED_OUT).sum())

    def close(self):
        self.ports.close()


@settings(max_examples=60)
@given(data=st.data(), signature=st.sampled_from([0x526A, 0x526B, 0x526C, 0xFFFF, 0]))
def test_garbage_never_raises_and_is_never_a_number_without_signature_and_references(make_card_rig, data, signature):
    soups = []

    def wrap(ports):
        soups.append(Soup(ports))
        return soups[0]

    rig = make_card_rig(wrap)
    soup = soups[0]
    soup.on, soup.signature, soup.draw = True, signature, data.draw
    rig.tick()
    known = signature in (0x526A, 0x526B)
    assert (rig.trouble is Trouble.CARD_LOST) is not known
    assert rig.card.count_validity.all() == known
    valid = rig.card.voltage_validity == VALID
    assert valid or (rig.card.voltage_validity == INVALID and rig.trouble in REFUSALS)
    assert np.isfinite(rig.card.voltage_v[:6]).all() == valid
    if valid:
        assert known
        assert (np.abs(rig.card.voltage_v[:6]) < 10.2).all()


@given(st.lists(st.integers(0, 0xFFFF), min_size=8, max_size=8))
def test_any_scan_gives_finite_voltages_within_bounds_or_says_so(words):
    """Whatever the converter reads: accepted references bound the scale to within a percent."""
    voltage_v, railed = np.full(8, np.nan), np.zeros(8, np.bool_)
    off = scan.decode(np.array(words, np.int32), np.arange(6), 10.0, np.zeros(8, np.int32), voltage_v, railed)
    if not off:
        assert (np.abs(voltage_v[:6]) <= 10.15).all()
