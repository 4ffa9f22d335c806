"""The emulated card by itself: driven with bare port accesses, from the register map, and as unforgiving as the real one."""

import numpy as np
import pytest

from hal.emulator import Bench, Station, load
from hal.errors import BackendError
from hal.seams import OPERATION, TIMED_OUT, Kind
from hal.switchboard import Switchboard
from sim_backends.emulators.sensoray526 import CardPorts, EmulatedSensoray526
from sim_backends.emulators.sensoray526_card import CARD, make_card

BASE = 0x2C0


class Registers:
    """Single accesses to an emulated card."""

    def __init__(self, **table):
        self.board = Switchboard()
        self.card = EmulatedSensoray526("card", table, Station(0.001, 7, self.board))
        self.card.record["noise_lsb"] = 0.0
        self.ports = self.board.ports(BASE, 0x40)

    def do(self, kind, offset, value=0, mask=0, limit=0):
        operations = np.array([(kind, BASE + offset, value, mask, limit, -7)], OPERATION)
        self.timed_out = self.ports.execute(operations)
        return int(operations["result"][0])

    def read(self, offset):
        return self.do(Kind.READ, offset)

    def write(self, offset, word):
        return self.do(Kind.WRITE, offset, word)

    def poll(self, offset, mask, limit):
        return self.do(Kind.POLL, offset, mask, mask, limit)

    def scan(self, word):
        self.write(0x0E, 4)
        self.write(0x06, word)
        assert self.poll(0x0E, 4, 1000) != TIMED_OUT
        self.write(0x0E, 4)

    def result(self, channel):
        self.write(0x06, channel << 1)
        word = self.read(0x08)
        return word - 0x10000 if word & 0x8000 else word

    def count(self, channel=0):
        low = self.read(0x12 + 8 * channel)
        return self.read(0x14 + 8 * channel) << 16 | low


@pytest.fixture
def registers():
    return Registers()


def expected(card, voltage_v):
    return round(float(card.record["adc_gain"][0]) * voltage_v + float(card.record["adc_offset"][0]))


def test_is_found_by_its_kind():
    assert load("sensoray526") is EmulatedSensoray526


def test_signature_and_a_missing_card(registers):
    assert registers.read(0x34) == 0x526A
    registers.card.inject("signature", 0xFFFF)
    registers.write(0x0A, 0x0401)
    assert (registers.read(0x34), registers.read(0x0A), registers.read(0x0E)) == (0xFFFF, 0xFFFF, 0xFFFF)
    registers.card.inject("signature", 0)
    assert registers.read(0x34) == 0x526A
    assert registers.read(0x0A) == 0x00FF  # what was written to nobody did not arrive


@pytest.mark.parametrize("offset", [0x01, 0x33, 0x41])
def test_odd_ports_are_misuse(registers, offset):
    with pytest.raises(BackendError, match=r"odd port|outside"):
        registers.read(offset)


@pytest.mark.parametrize("offset", [-2, 0x40, 0x100])
def test_ports_of_somebody_else_are_misuse(registers, offset):
    with pytest.raises(BackendError, match="outside the card"):
        registers.write(offset, 0)


@pytest.mark.parametrize(
    ("offset", "word"),
    [
        (0x34, 0x0003),  # an EEPROM write would destroy the calibration
        (0x34, 0x0205),  # beyond its words
        (0x16, 0x1480),  # counts by software
        (0x16, 0x0500),  # waits for a hardware enable
        (0x36, 0),
    ],
)
def test_what_no_driver_should_do_is_misuse(registers, offset, word):
    with pytest.raises(BackendError, match=r"no reason|no such register"):
        registers.write(offset, word)


def test_other_arrays_than_operations_are_refused(registers):
    with pytest.raises(TypeError, match="OPERATION"):
        registers.ports.execute(np.zeros(3, np.int32))
    with pytest.raises(TypeError, match="CARD"):
        CardPorts(np.zeros(2, CARD))


def test_polling_stops_at_its_limit_or_when_the_bit_comes(registers):
    assert registers.poll(0x0E, 4, 5) == TIMED_OUT
    assert registers.timed_out == 1
    registers.write(0x06, 0x0021)  # one channel, no settling: 10 accesses
    assert registers.poll(0x0E, 4, 9) == TIMED_OUT
    assert registers.poll(0x0E, 4, 1) & 4
    assert registers.timed_out == 0


def test_status_bits_are_cleared_by_writing_ones_and_by_nothing_else(registers):
    registers.scan(0x0021)
    registers.write(0x06, 0x0021)
    registers.poll(0x0E, 4, 20)
    registers.write(0x04, 1)
    assert registers.read(0x0E) & 6 == 6
    assert registers.read(0x0E) & 6 == 6
    registers.write(0x0E, 0)
    assert registers.read(0x0E) & 6 == 6
    registers.write(0x0E, 4)
    assert registers.read(0x0E) & 6 == 2
    registers.write(0x06, 0x0021)
    assert registers.read(0x0E) & 4 == 0


def test_results_are_per_channel_and_stale_without_conversion(registers):
    registers.card.set_input(0, 1.0)
    registers.card.set_input(3, -4.0)
    registers.scan(0x8000 | 1 << 5 | 1 << 8 | 1)
    assert registers.result(0) == expected(registers.card, 1.0)
    assert registers.result(3) == expected(registers.card, -4.0)
    registers.card.set_input(0, 2.0)
    registers.card.set_input(3, 5.0)
    registers.scan(0x8000 | 1 << 5 | 1)  # comedi's mistake: converts 0, reads 3
    assert registers.result(0) == expected(registers.card, 2.0)
    assert registers.result(3) == expected(registers.card, -4.0)


def test_reading_before_the_scan_is_done_gives_the_last_result(registers):
    registers.card.set_input(0, 1.0)
    registers.scan(0x0021)
    registers.card.set_input(0, 2.0)
    registers.write(0x06, 0x0021)
    assert registers.result(0) == expected(registers.card, 1.0)
    registers.card.sense(1, Bench(0))
    assert registers.result(0) == expected(registers.card, 2.0)


def test_channels_smear_without_the_settling_delay(registers):
    registers.card.set_input(0, 8.0)
    registers.scan(1 << 5 | 1 << 6 | 1)
    assert registers.result(0) == expected(registers.card, 8.0)
    assert registers.result(1) == expected(registers.card, 4.0)
    registers.scan(0x8000 | 1 << 5 | 1 << 6 | 1)
    assert registers.result(1) == expected(registers.card, 0.0)


def test_settling_takes_its_time(registers):
    for word, accesses in ((1 << 5 | 1 << 6 | 1, 20), (0x8000 | 1 << 5 | 1 << 6 | 1, 50)):
        registers.write(0x0E, 4)
        registers.write(0x06, word)
        assert registers.poll(0x0E, 4, accesses - 1) == TIMED_OUT
        assert registers.poll(0x0E, 4, 1) != TIMED_OUT


def test_the_converter_ends_at_its_codes(registers):
    registers.card.set_input(0, 40.0)
    registers.card.set_input(1, -40.0)
    registers.scan(0x8000 | 3 << 5 | 1)
    assert (registers.result(0), registers.result(1)) == (32767, -32768)


def test_the_eeprom_holds_little_endian_doubles_of_this_very_card(registers):
    words = []
    for address in range(0x24):
        registers.write(0x0E, 0x80)
        assert not registers.read(0x0E) & 0x80
        registers.write(0x34, address << 3 | 5)
        assert registers.poll(0x0E, 0x80, 100) & 0x80
        words.append(registers.read(0x32))
    values = np.array(words, "<u2").view("<f8")
    np.testing.assert_array_equal(values[0:8:2], registers.card.record["dac_gain"][0])
    np.testing.assert_array_equal(values[1:8:2], registers.card.record["dac_offset"][0])
    assert values[8] == registers.card.record["reference_v"][0]
    assert not (values[0:8:2] == 3276.8).any()


@pytest.mark.parametrize(("clock", "quarters"), [(0, 4), (1, 2), (2, 1), (3, 1)])
def test_counts_per_line(registers, clock, quarters):
    registers.write(0x16, 0x0080 | clock << 9)
    registers.card.set_encoder(0, 1000)
    assert registers.count() == 1000 // quarters
    registers.card.set_encoder(0, -1000)
    assert registers.count() == 2**24 - 1000 // quarters


def test_a_counter_that_is_not_enabled_stands(registers):
    registers.write(0x16, 0x0400)
    registers.card.set_encoder(0, 1000)
    registers.write(0x16, 0x0480)
    registers.card.set_encoder(0, 1010)
    assert registers.count() == 10


def test_the_low_word_latches_all_24_bits(registers):
    registers.write(0x16, 0x0480)
    registers.card.set_encoder(0, 0x01FFFF)
    assert registers.read(0x12) == 0xFFFF
    registers.card.set_encoder(0, 0x020000)
    assert registers.read(0x14) == 1  # of the latched count
    assert registers.count() == 0x020000


@pytest.mark.parametrize("preload", [0, 1])
def test_each_preload_register_is_loaded_when_selected(registers, preload):
    for number, value in ((0, 0x123456), (1, 0x654321)):
        registers.write(0x1E, number << 14)
        registers.write(0x1C, value >> 16)
        registers.write(0x1A, value & 0xFFFF)
    registers.write(0x1E, 0x0480 | preload << 14)
    registers.write(0x20, 0x4000)
    assert registers.count(1) == (0x654321 if preload else 0x123456)
    registers.write(0x20, 0x8000)
    assert registers.count(1) == 0


@pytest.mark.parametrize(("control", "event", "latched"), [(0x0800, 4, 100), (0x0400, 2, 101)])
def test_an_index_latches_and_flags_by_edge(registers, control, event, latched):
    registers.card.set_index(0, 100)
    registers.write(0x18, control)
    registers.write(0x16, 0x2480)
    registers.write(0x18, control | 0xF)
    registers.card.set_encoder(0, 50)
    registers.write(0x18, control | 0xF)
    assert registers.read(0x18) & 0xF == 0
    registers.card.set_encoder(0, 130)
    assert registers.read(0x18) & event
    assert registers.count() == latched
    registers.card.set_encoder(0, 140)
    assert registers.count() == latched
    registers.write(0x18, control | 6)
    assert registers.read(0x18) & 0xF == 0
    registers.write(0x16, 0x0480)
    assert registers.count() == 140


def test_the_index_level_is_seen_on_the_index_only(registers):
    registers.card.set_index(0, 100)
    levels = []
    for position in (99, 100, 101):
        registers.card.set_encoder(0, position)
        levels.append(registers.read(0x18) >> 5 & 1)
    assert levels == [0, 1, 0]


def test_index_and_rollover_load_the_preload(registers):
    registers.card.set_index(0, 100)
    registers.write(0x14, 0)
    registers.write(0x12, 1000)
    registers.write(0x16, 0x0480 | 0x10)
    registers.card.set_encoder(0, 130)
    assert registers.count() == 1030
    registers.write(0x16, 0x0480 | 0x04)
    registers.write(0x18, 0x8000)
    registers.card.set_encoder(0, 129)
    assert registers.count() == 1000
    assert registers.read(0x18) & 8


def test_error_capture_is_an_event(registers):
    registers.card.inject("ecap", 3)
    assert registers.read(0x28) & 1
    registers.write(0x28, 1)
    assert not registers.read(0x28) & 1
    registers.card.sense(1, Bench(0))
    assert registers.read(0x28) & 1


def test_counter_events_reach_the_status_where_they_are_let_through(registers):
    registers.card.inject("ecap", 2)
    assert not registers.read(0x0E) & 0x78
    registers.write(0x20, 0x0040)
    assert registers.read(0x0E) & 0x78 == 0x20


def test_outputs_move_at_the_start_only_and_all_together(registers):
    record = registers.card.record
    for channel, code in enumerate((0x0000, 0x4000, 0xC000, 0xFFFF)):
        registers.write(0x04, channel << 1)
        registers.write(0x08, code)
    assert record["code"][0].tolist() == [0x8000] * 4
    registers.write(0x04, 1)
    assert record["code"][0].tolist() == [0x0000, 0x4000, 0xC000, 0xFFFF]
    assert registers.card.output_v(1) == pytest.approx((0x4000 - 32743.6) / 3251.44)
    registers.write(0x04, 8)
    assert record["code"][0].tolist() == [0x8000] * 4


def test_a_frozen_output_holds(registers):
    registers.card.inject("dac_freeze", 1)
    registers.write(0x08, 0x1234)
    registers.write(0x04, 1)
    assert registers.card.record["code"][0, 0] == 0x8000


def test_lines_have_directions_by_groups(registers):
    registers.card.set_line(1, False)
    registers.card.set_line(6, False)
    assert registers.read(0x0A) == 0b1011_1101
    assert not any(registers.card.line_out(k) for k in range(8))  # inputs drive nothing
    registers.write(0x0A, 0x0400 | 0b0000_1010)
    assert registers.read(0x0A) == 0x0400 | 0b1011_1010
    assert [registers.card.line_out(k) for k in range(8)] == [False, True, False, True] + [False] * 4


def test_the_watchdog_expires_latches_and_starts_anew_from_off():
    registers = Registers(watchdog_interval_s=0.005)
    bench = Bench(0)
    registers.card.sense(0, bench)
    registers.card.sense(50, bench)
    assert not registers.card.watchdog_expired()
    registers.write(0x02, 0x0B)
    for tick in range(51, 60):
        registers.card.sense(tick, bench)
        registers.write(0x02, 0x0B)
    assert not registers.card.watchdog_expired()
    registers.card.sense(64, bench)
    assert registers.card.watchdog_expired()
    registers.write(0x02, 0x0B)
    assert registers.card.watchdog_expired()
    registers.write(0x02, 0x00)
    registers.write(0x02, 0x0B)
    assert not registers.card.watchdog_expired()


def test_the_card_lives_where_the_station_puts_it():
    """A driver in another process has ports of its own on the same memory."""
    somewhere = np.zeros(1, CARD)

    class Shared(Station):
        def card_memory(self, base, dtype):
            assert (base, dtype) == (BASE, CARD)
            return somewhere

    card = EmulatedSensoray526("card", {}, Shared(0.001, 1, Switchboard()))
    registers = Registers()
    registers.ports = CardPorts(somewhere)
    registers.write(0x16, 0x0480)
    card.set_encoder(0, 9)
    assert registers.count() == 9


def test_two_cards_of_different_seeds_differ_in_noise_only():
    a, b = make_card(BASE, 1), make_card(BASE, 2)
    assert a["random"] != b["random"]
    a["random"] = b["random"]
    assert a.tobytes() == b.tobytes()
