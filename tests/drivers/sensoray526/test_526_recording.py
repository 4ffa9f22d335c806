"""Traces of port accesses: what is recorded is what is replayed, and nothing else is."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.sensoray526.device import Sensoray526
from drivers.sensoray526.recording import PortRecorder, PortReplayer
from hal.device import Demand, Readings, Site
from hal.emulator import Bench, Station
from hal.errors import BackendError
from hal.seams import OPERATION, TIMED_OUT, Kind
from hal.switchboard import Switchboard
from sim_backends.emulators.sensoray526 import CardPorts, EmulatedSensoray526

GOLDEN = Path(__file__).with_name("golden.trace")
"""Of the emulated card, by :func:`record`: five ticks in which an encoder with 400 counts a turn passes its index."""
BASE = 0x2C0


def make_card(ports, **table):
    """A card with a counter, two inputs, an output, a line out and a line in."""
    board = Switchboard()
    board.plug_ports(BASE, ports)
    card = Sensoray526("card", {"base": BASE, **table}, Site(0.001, 50, board))
    card.use_counter(1, "axis")
    card.use_output(2, "axis")
    card.use_line(0, "axis", output=True)
    card.use_line(5, "axis", output=False)
    for channel in (0, 4):
        card.use_input(channel, "sensor")
    return card


def drive(card, before=lambda _: None):
    """Open the card, let five ticks pass, close it; counts, index counts and voltages of each tick."""
    readings, demand, found = Readings(0), Demand(0), []
    card.open()
    for tick in range(1, 6):
        before(tick)
        card.begin(tick)
        card.read(tick, readings)
        found.append((int(card.count[1]), int(card.index_count[1]), *card.voltage_v[[0, 4]], bool(card.line[5])))
        card.put_voltage(2, 0.5 * tick)
        card.put_line(0, tick > 2)
        card.write(tick, demand)
    card.close()
    return found


def record(file):
    """Write the golden trace anew."""
    emulated = EmulatedSensoray526("card", {"base": BASE}, Station(0.001, 3, Switchboard()))
    emulated.set_index(1, 400)
    emulated.set_encoder(1, 250)

    def before(tick):
        emulated.sense(tick, Bench(0))
        emulated.set_encoder(1, 250 + 60 * tick)
        emulated.set_input(0, 1.25 * tick)
        emulated.set_input(4, -0.5)
        emulated.set_line(5, tick != 3)

    return drive(make_card(PortRecorder(CardPorts(emulated.record), file)), before)


def test_the_golden_trace_is_driven_to_the_values_it_was_made_with():
    replayer = PortReplayer(GOLDEN)
    found = drive(make_card(replayer))
    assert replayer.left == 0
    assert [row[0] for row in found] == [60, 120, 180, 240, 300]
    assert [row[1] for row in found] == [0, 0, 150, 150, 150]
    np.testing.assert_allclose([row[2] for row in found], [1.25, 2.5, 3.75, 5.0, 6.25], atol=2e-3)
    np.testing.assert_allclose([row[3] for row in found], [-0.5] * 5, atol=2e-3)
    assert [row[4] for row in found] == [True, True, False, True, True]


def test_the_golden_trace_says_what_the_manual_says():
    """Its own words, read without the replayer: signature first, words of 07 section 1.3, 0 V and low at the end."""
    lines = [line for line in GOLDEN.read_text().splitlines() if line and not line.startswith("#")]
    assert lines[0] == "R 2f4 526a"
    assert lines[1:3] == ["W 2ce 0080", "W 2f4 0005"]  # EEPROM word 0
    assert lines.count("W 2c6 e221") == 6  # delay, channels 0, 4, 8, 9, start; once at opening
    assert lines.count("W 2ce 0004") == 12
    assert lines[-10:-9] == ["W 2ca 0400"]
    assert lines[-1] == "W 2c4 0001"


def test_a_recording_replays_to_the_same_numbers(tmp_path):
    file = tmp_path / "new.trace"
    recorded = record(file)
    assert drive(make_card(PortReplayer(file))) == recorded


@pytest.mark.parametrize(
    ("table", "number", "asked"),
    [
        ({"index": False}, 202, "W 2e0 000f"),
        ({"poll_limit": 300}, 216, "P 2ce 0004 0004 300"),
        ({"loop_back": [2, 7]}, 206, "W 2c6 f221"),
        ({"watchdog_code": 1}, None, "W 2c2 0001"),
    ],
)
def test_a_driver_that_asks_something_else_is_refused_with_the_number(table, number, asked):
    with pytest.raises(BackendError) as caught:
        drive(make_card(PortReplayer(GOLDEN), **table))
    assert asked in str(caught.value)
    if number is not None:
        assert f"operation {number} " in str(caught.value)


def test_a_driver_that_goes_on_is_refused_at_the_end():
    replayer = PortReplayer(GOLDEN)
    drive(make_card(replayer))
    with pytest.raises(BackendError, match="at its end"):
        replayer.execute(np.zeros(1, OPERATION))


@pytest.mark.parametrize("line", ["X 2c0 1", "R 2c0", "W zz 0001", "P 2ce 4 4 400", "R 2c0 1 2"])
def test_what_is_no_trace_is_refused(tmp_path, line):
    file = tmp_path / "bad.trace"
    file.write_text(f"R 2f4 526a\n{line}\n")
    with pytest.raises(BackendError, match="no trace"):
        PortReplayer(file)


class Answering:
    """Ports with prepared answers."""

    def __init__(self, answers):
        self.answers = answers

    def execute(self, operations):
        operations["result"] = self.answers
        return int(((operations["kind"] == Kind.POLL) & (operations["result"] == TIMED_OUT)).sum())

    def close(self):
        pass


words = st.integers(0, 0xFFFF)
operation = st.one_of(
    st.tuples(st.just(0), words, st.just(0), st.just(0), st.just(0), words),
    st.tuples(st.just(1), words, words, st.just(0), st.just(0), st.just(0)),
    st.tuples(st.just(2), words, words, words, st.integers(1, 1000), st.integers(-1, 0xFFFF)),
)


@given(st.lists(st.lists(operation, min_size=1, max_size=8), min_size=1, max_size=5))
def test_any_accesses_survive_the_way_through_the_file(tmp_path_factory, batches):
    file = tmp_path_factory.mktemp("trace") / "any.trace"
    answering = Answering(0)
    recorder = PortRecorder(answering, file)
    arrays = [np.array(batch, OPERATION) for batch in batches]
    counted = []
    for array in arrays:
        answering.answers = array["result"].copy()
        counted.append(recorder.execute(array.copy()))
    recorder.close()
    replayer = PortReplayer(file)
    for array, timed_out in zip(arrays, counted, strict=True):
        asked = array.copy()
        asked["result"][asked["kind"] != Kind.WRITE] = -99
        assert replayer.execute(asked) == timed_out
        np.testing.assert_array_equal(asked, array)
    assert replayer.left == 0
