"""The card's driver in health: what it writes, in which order, and what it makes of what it reads."""

import dataclasses
import re
import tomllib
from pathlib import Path

import numpy as np
import pytest

from drivers.sensoray526.device import Sensoray526
from hal import options
from hal.card import AnalogCard
from hal.device import NEVER, Readings, Site, load
from hal.emulator import Station
from hal.errors import BackendError, OptionError
from hal.frames import INVALID, VALID
from hal.kernel import loaded
from hal.seams import Kind
from hal.switchboard import Switchboard
from sim_backends.emulators.sensoray526 import EmulatedSensoray526

BASE = 0x300


def told(o):
    """An access as text: letter, offset, and what is written."""
    written = f"={o['value']:04X}" if o["kind"] == Kind.WRITE else ""
    return f"{'RWP'[o['kind']]}{o['port'] - BASE:02X}{written}"


class Spy:
    """Ports that remember every access as text."""

    def __init__(self, ports):
        self.ports, self.batches = ports, []

    def execute(self, operations):
        timed_out = self.ports.execute(operations)
        self.batches.append([told(o) for o in operations])
        return timed_out

    def close(self):
        self.ports.close()


@pytest.fixture
def spied(make_card_rig):
    """A rig and the batches of its second tick."""
    found = []

    def wrap(ports):
        found.append(Spy(ports))
        return found[0]

    rig = make_card_rig(wrap)
    rig.tick()
    found[0].batches.clear()
    rig.tick()
    return rig, found[0].batches


def site(board=None):
    return Site(0.001, 50, board or Switchboard())


def test_is_found_by_its_kind_and_is_an_analog_card():
    assert load("sensoray526") is Sensoray526
    assert isinstance(Sensoray526("a", {}, site()), AnalogCard)


def test_a_tick_is_three_batches_in_the_order_of_the_manual(spied):
    """Words written out from 07 sections 1.2 and 1.3, not from the driver's own names."""
    _, batches = spied
    assert len(batches) == 3
    first, second, third = batches
    assert first[:3] == ["R34", "W0E=0004", "W06=E7E1"]  # delay, ten bits for 0..5, +10 V and 0 V, start
    assert first[3:10] == ["R18", "R12", "R14", "W16=0480", "R12", "R14", "W16=2480"]  # latched index, then the count
    assert [op for op in first[10:31] if op[0] == "R"] == [
        f"R{0x10 + 8 * n + o:02X}" for n in (1, 2, 3) for o in (8, 2, 4, 2, 4)
    ]
    assert first[31:] == ["R0A"]
    assert second[:6] == ["W18=0800", "W20=0800", "W28=0800", "W30=0800", "P0E", "W0E=0004"]
    collected = [second[i : i + 2] for i in range(6, len(second), 2)]
    assert collected == [[f"W06={channel << 1:04X}", "R08"] for channel in (8, 9, 0, 1, 2, 3, 4, 5)]
    assert [op[:3] for op in third] == ["W04", "W08"] * 4 + ["W04", "W0A"]
    assert third[0:8:2] == ["W04=0000", "W04=0002", "W04=0004", "W04=0006"]
    assert third[8] == "W04=0001"


def test_nothing_moves_before_the_one_start(make_card_rig):
    """An output that is staged but not started would be skewed against the others."""
    seen = []

    class Watching(Spy):
        def execute(self, operations):
            for i in range(len(operations)):
                self.ports.execute(operations[i : i + 1])
                seen.append(tuple(rig.emulated.output_v(k) for k in range(4)))
            return 0

    rig = make_card_rig(Watching, opened=False)
    rig.card.open()
    rig.tick()
    for channel, voltage_v in enumerate((1.0, -2.0, 3.0, -4.0)):
        rig.card.put_voltage(channel, voltage_v)
    seen.clear()
    rig.card.write(rig.now, rig.demand)
    assert len(set(seen)) == 2
    np.testing.assert_allclose(seen[-1], (1.0, -2.0, 3.0, -4.0), atol=16e-5)


def test_outputs_rest_at_zero_from_open_to_close(rig):
    assert [rig.emulated.output_v(k) for k in range(4)] == pytest.approx([0.0] * 4, abs=16e-5)
    rig.card.put_voltage(2, 5.0)
    rig.card.put_line(1, True)
    rig.tick()
    assert rig.emulated.output_v(2) == pytest.approx(5.0, abs=16e-5)
    assert [rig.emulated.line_out(k) for k in range(4)] == [False, True, False, False]
    rig.card.close()
    rig.card.close()
    assert [rig.emulated.output_v(k) for k in range(4)] == pytest.approx([0.0] * 4, abs=16e-5)
    assert not any(rig.emulated.line_out(k) for k in range(4))
    assert not rig.card.count_validity.any()


@pytest.mark.parametrize(("put_v", "carries_v"), [(11.0, 10.0), (-np.inf, -10.0), (np.nan, 0.0)])
def test_a_voltage_out_of_reach_is_clamped_and_none_is_zero(make_card_rig, put_v, carries_v):
    rig = make_card_rig()
    rig.card.put_voltage(0, put_v)
    rig.tick()
    assert rig.emulated.output_v(0) == pytest.approx(carries_v, abs=0.05)  # 10 V may lie just beyond the last code


def test_counts_voltages_and_levels_are_read(rig):
    for channel, count in enumerate((5, -7, 100_000, -100_000)):
        rig.emulated.set_encoder(channel, count)
    for channel in range(6):
        rig.emulated.set_input(channel, channel - 2.5)
    for number in range(4, 8):
        rig.emulated.set_line(number, number % 2 == 0)
    rig.tick()
    assert rig.card.count.tolist() == [5, -7, 100_000, -100_000]
    assert (rig.card.count_validity == VALID).all()
    assert rig.card.voltage_validity == VALID
    np.testing.assert_allclose(rig.card.voltage_v[:6], np.arange(6) - 2.5, atol=2e-3)
    assert np.isnan(rig.card.voltage_v[6:]).all()
    assert rig.card.line[4:].tolist() == [True, False, True, False]
    sequence = rig.card.count_sequence, rig.card.voltage_sequence
    rig.tick()
    assert (rig.card.count_sequence, rig.card.voltage_sequence) == (sequence[0] + 1, sequence[1] + 1)


def test_the_count_begins_at_zero_wherever_the_encoder_stands(make_card_rig):
    rig = make_card_rig(opened=False)
    rig.emulated.set_encoder(0, 12_345)
    rig.card.open()
    rig.emulated.set_encoder(0, 12_300)
    rig.tick()
    assert rig.card.count[0] == -45


@pytest.mark.parametrize("edge", ["rising", "falling"])
def test_the_index_latches_the_count_where_it_was(make_card_rig, edge):
    rig = make_card_rig(index_edge=edge)
    rig.emulated.set_index(1, 2000)
    rig.emulated.set_encoder(1, 30)
    rig.tick()
    before = int(rig.card.index_sequence[1])  # leaving the index at power-on is an edge, too
    for count in range(30, 6500, 170):
        rig.emulated.set_encoder(1, count)
        rig.tick()
        turns = count // 2000
        assert rig.card.index_sequence[1] == before + turns
        if turns:
            assert rig.card.index_count[1] == 2000 * turns + (edge == "falling")
    rig.emulated.set_encoder(1, 5900)
    rig.tick()
    assert rig.card.index_count[1] == 6000 - (edge == "falling")
    assert rig.card.count[1] == 5900
    assert rig.card.errors["index_missed"] == 0


def test_without_index_the_counter_is_read_in_three_accesses(make_card_rig):
    spies = []

    def wrap(ports):
        spies.append(Spy(ports))
        return spies[0]

    rig = make_card_rig(wrap, index=False)
    rig.emulated.set_index(0, 100)
    spies[0].batches.clear()
    rig.emulated.set_encoder(0, 250)
    rig.tick()
    assert spies[0].batches[0][3:6] == ["R18", "R12", "R14"]
    assert rig.card.count[0] == 250
    assert rig.card.index_sequence[0] == 0


def test_a_card_without_users_has_nothing_to_scan():
    there = site()
    EmulatedSensoray526("card", {}, Station(0.001, 1, there.seams))
    card = Sensoray526("card", {}, there)
    card.open()
    card.begin(1)
    card.read(1, Readings(0))
    assert card.voltage_validity == INVALID
    assert not card.count_validity.any()
    assert card.health().errors["adc_not_done"] == 0


def test_the_watchdog_runs_from_the_first_write_and_is_petted(make_card_rig):
    rig = make_card_rig(watchdog_code=3, watchdog_interval_s=0.02, watchdog_line=5)
    for _ in range(60):
        rig.sense()
        assert not rig.readings.watchdog_tripped
    for _ in range(60):
        rig.tick()
        assert not rig.emulated.watchdog_expired()
    rig.card.close()
    rig.emulated.sense(rig.now + 20, rig.bench)
    assert rig.emulated.watchdog_expired()


def test_the_pet_sequence_is_a_setting(make_card_rig):
    spies = []

    def wrap(ports):
        spies.append(Spy(ports))
        return spies[0]

    rig = make_card_rig(wrap, watchdog_code=3, watchdog_pet=[[0x02, 0x0B], [0x00, 0x01]])
    rig.tick()
    rig.tick()
    assert spies[0].batches[-1][-2:] == ["W02=000B", "W00=0001"]


def test_one_start_of_the_watchdog_is_not_enough_after_it_expired(make_card_rig):
    """Going on writing does not close the chain again; a write that clears faults does."""
    rig = make_card_rig(watchdog_code=3, watchdog_interval_s=0.01, watchdog_line=5)
    rig.tick()
    for _ in range(11):
        rig.sense()
    assert rig.readings.watchdog_tripped
    rig.tick()
    assert rig.tick().watchdog_tripped
    rig.demand.clear_faults = True
    rig.tick()
    assert not rig.tick().watchdog_tripped


def test_probe_finds_a_healthy_card_healthy_and_moves_nothing(make_card_rig):
    rig = make_card_rig(watchdog_code=2, loop_back=[3, 7])
    rig.tick()
    before = rig.emulated.record.copy()
    found = rig.card.probe()
    assert [f.what for f in found if not f.good] == []
    for field in ("code", "digital", "watchdog_control"):
        np.testing.assert_array_equal(rig.emulated.record[field], before[field])
    assert {"signature", "EEPROM", "references", "counter 3", "input 7", "watchdog"} <= {f.what for f in found}


@pytest.mark.parametrize(
    ("fault", "value", "what"),
    [
        ("eeprom_corrupt", 1, "EEPROM"),
        ("reference_drift", -0.02, "references"),
        ("reference_drift", 0.02, "references"),
        ("input_rail", 3, "input 2"),
        ("adc_never_done", 1, "scans"),
        ("signature", 0xFFFF, "scans"),
    ],
)
def test_probe_names_what_is_wrong_and_what_to_do(rig, fault, value, what):
    rig.emulated.inject(fault, value)
    wrong = {f.what: f.remedy for f in rig.card.probe() if not f.good}
    assert wrong[what]


def test_probe_sees_silent_and_noisy_inputs(rig):
    rig.emulated.record["noise_lsb"] = 0.0
    assert any("not change" in f.remedy for f in rig.card.probe() if f.what == "input 0")
    rig.emulated.record["noise_lsb"], rig.emulated.record["adc_offset"] = 45.0, 0.0
    assert any("noisy" in f.remedy for f in rig.card.probe() if f.what == "input 0")


def test_health_tells_signature_calibration_and_age(rig):
    rig.tick()
    health = rig.card.health()
    assert "526A at 0x300" in health.identity
    assert "9.99712 V" in health.identity
    assert "3289.17" in health.identity
    assert health.age_ticks == 0
    rig.emulated.inject("signature", 0xFFFF)
    for _ in range(5):
        rig.tick()
    assert rig.card.health().age_ticks == 5
    assert rig.card.health().errors["signature"] == 5
    assert Sensoray526("new", {}, site()).health().age_ticks == NEVER


@pytest.mark.parametrize(
    ("table", "words"),
    [
        ({"base": 0x2D0}, "multiple of 0x40"),
        ({"bases": 0x2C0}, "did you mean 'base'"),
        ({"loop_back": [1]}, "an output and an input"),
        ({"loop_back": [5, 0]}, "an output and an input"),
        ({"watchdog_line": 3}, "set watchdog_code"),
        ({"watchdog_code": 1, "watchdog_pet": [[3, 1]]}, "even offset"),
        ({"watchdog_code": 1, "watchdog_interval_s": 0.005}, None),
    ],
)
def test_settings_are_checked(table, words):
    if words is None:
        assert Sensoray526("a", table, site()).options.watchdog_interval_s == 0.005
        with pytest.raises(OptionError, match="too short for the loop"):
            Sensoray526("a", table, Site(0.002, 50, Switchboard()))
        return
    with pytest.raises(OptionError, match=words):
        Sensoray526("a", table, site())


def test_nothing_is_compiled_after_the_import(make_card_rig):
    """A real-time process that compiles is refused; the import is what `rtctl warmup` does."""
    before = loaded()
    rig = make_card_rig()
    rig.tick()
    one = site(rig.board)
    card = Sensoray526("one", {"base": BASE, "index": False}, one)
    card.use_counter(0, "axis")
    card.use_input(0, "sensor")
    card.open()
    drivers = {name for name in loaded() - before if "decode" in name or "execute" in name}
    assert not drivers


def test_the_how_to_is_accepted():
    text = (Path(__file__).parents[3] / "docs" / "how-to" / "wire-a-sensoray-526.md").read_text()
    (block,) = re.findall(r"^```toml\n(.*?)^```", text, re.MULTILINE | re.DOTALL)
    there = site()
    for entry in tomllib.loads(block)["backend"]["options"]["devices"]:
        assert entry.pop("kind") == "sensoray526"
        name = entry.pop("name")
        there.devices[name] = Sensoray526(name, entry, there)
    assert list(there.devices) == ["card_a", "card_b"]
    known = {field.name for field in dataclasses.fields(Sensoray526.options_type)}
    named = set(re.findall(r"`((?:watchdog|index|loop|poll|base)\w*)`", text))
    assert named - known == set()


def test_every_setting_is_documented():
    described = list(options.describe(Sensoray526.options_type))
    assert len(described) == len(dataclasses.fields(Sensoray526.options_type))
    assert all(field.metadata["doc"] for _, _, field in described)


def test_claims_that_do_not_fit_are_refused():
    card = Sensoray526("a", {}, site())
    card.use_counter(0, "one")
    with pytest.raises(OptionError, match="that one uses"):
        card.use_counter(0, "two")
    with pytest.raises(OptionError, match=r"0 \.\. 3"):
        card.use_output(4, "two")
    card.use_line(1, "one", output=True)
    with pytest.raises(OptionError, match="outputs already"):
        card.use_line(2, "two", output=False)
    card.use_line(4, "two", output=False)


def test_two_cards_at_one_address_are_refused():
    there = site()
    there.devices["a"] = Sensoray526("a", {}, there)
    with pytest.raises(OptionError, match="two cards at one address"):
        Sensoray526("b", {}, there)


def test_a_failed_opening_releases_the_ports(make_card_rig):
    closed = []

    class Counting(Spy):
        def close(self):
            closed.append(True)

    rig = make_card_rig(Counting, opened=False)
    rig.emulated.inject("eeprom_corrupt")
    with pytest.raises(BackendError, match="gain of output 0"):
        rig.card.open()
    assert closed == [True]
    rig.emulated.inject("eeprom_corrupt", 0)
    rig.card.open()
    with pytest.raises(BackendError, match="not open"):
        Sensoray526("a", {}, site()).probe()
