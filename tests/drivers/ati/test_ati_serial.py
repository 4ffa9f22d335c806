"""A stand-alone controller through its real driver: golden bytes, honest ages, and finding back into the dialogue."""

import os
import tty

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from drivers.ati.controller_line import Garbled, parse
from drivers.ati.serial_line import AtiSerial
from hal.errors import BackendError, OptionError
from hal.frames import INVALID, VALID
from hal.sockets import SerialPort
from hal.troubles import Trouble
from sim_backends.emulators.ati_serial import EmulatedAtiSerial

TABLE = {
    "path": "/dev/ttyS0",
    "counts_per_force": 160,
    "counts_per_torque": 8,
    "force_unit": "N",
    "torque_unit": "N-mm",
    "rated_n_nmm": [18.0, 18.0, 18.0, 250.0, 250.0, 250.0],
}
LOAD = np.array([1.0, -2.0, 3.0, 40.0, -50.0, 60.0])


@pytest.fixture(params=["binary", "ascii"])
def rig(lockstep, request):
    return make(lockstep, mode=request.param)


@pytest.fixture
def binary(lockstep):
    return make(lockstep)


def make(lockstep, **changes):
    rig = lockstep(card=False)
    rig.sensor, rig.controller = rig.add(AtiSerial, EmulatedAtiSerial, "force", {**TABLE, **changes})
    rig.bench.wrench_in_sensor[:] = LOAD
    return rig


def test_golden_replies():
    binary = bytes.fromhex("51520d000001ffff7fff80003e3e0d0a0d0a3e")
    assert len(binary) == 19
    assert parse(binary, "binary") == (0, 1, -1, 32767, -32768, 0x3E3E, 0x0D0A)
    ascii_reply = b"QR\r0,     1,    -1, 32767,-32768,    12,     0\r\n>"
    assert parse(ascii_reply, "ascii") == (0, 1, -1, 32767, -32768, 12, 0)


@given(st.lists(st.integers(-32768, 32767), min_size=6, max_size=6), st.integers(0, 18), st.integers(0, 255))
def test_no_single_lost_or_wrong_extra_byte_makes_another_binary_record(counts, at, extra):
    good = b"QR\r\0" + b"".join(n.to_bytes(2, "big", signed=True) for n in counts) + b"\r\n>"
    for n in range(19):
        assert parse(good[:n], "binary") is None
    assert parse(good, "binary") == (0, *counts)
    short, long = good[:at] + good[at + 1 :], good[:at] + bytes([extra]) + good[at:]
    for reply in (short, long, short + b"\r\n>", short + good):
        try:
            assert parse(reply, "binary") is None
        except Garbled:
            continue


@given(st.binary(max_size=60))
@settings(max_examples=300)
def test_soup_is_garbled_or_unfinished(soup):
    for mode in ("binary", "ascii"):
        for reply in (soup, b"QR\r" + soup):
            try:
                record = parse(reply, mode)
            except Garbled:
                continue
            assert record is None or reply.startswith(b"QR\r")


@pytest.mark.parametrize(
    "bad",
    [
        b"0,1,2,3,4,5",
        b"0,1,2,3,4,5,6,7",
        b"0,1,2,3,4,5,x",
        b"0,1,2,3,4,5,32768",
        b"0,1,2,,4,5,6",
        b"",
        b"E: unknown command",
    ],
)
def test_ascii_that_is_no_record_is_garbled(bad):
    with pytest.raises(Garbled):
        parse(b"QR\r" + bad + b"\r\n>", "ascii")


def test_wrench_on_the_bench_is_the_wrench_that_is_read(rig):
    rig.until(lambda r: r.wrench_validity == VALID, most=60)
    for load in np.random.default_rng(1).uniform(-1, 1, (10, 6)) * [10, 10, 10, 100, 100, 100]:
        rig.bench.wrench_in_sensor[:] = load
        rig.steps(40)
        assert rig.readings.wrench_validity == VALID
        assert rig.readings.wrench_in_sensor == pytest.approx(load, abs=0.07)
    assert rig.steps(100) == {0}


@pytest.mark.parametrize(("mode", "fresh", "old"), [("binary", 6, 13), ("ascii", 12, 30)])
def test_ages_are_never_less_than_the_time_on_the_wire_and_never_hide_the_sample(lockstep, mode, fresh, old):
    """The bench changes by a count a tick, so the wrench tells which tick was sampled."""
    rig = make(lockstep, mode=mode)
    rig.bench.wrench_in_sensor[:] = 0
    rig.physics = lambda bench: bench.wrench_in_sensor.__iadd__([1 / 160, 0, 0, 0, 0, 0])
    rig.until(lambda r: r.wrench_validity == VALID)
    ages = []
    for _ in range(300):
        r = rig.step()
        sampled = round(r.wrench_in_sensor[0] * 160)
        assert rig.tick - r.wrench_age_ticks <= sampled <= rig.tick - r.wrench_age_ticks + 2
        ages.append(int(r.wrench_age_ticks))
    assert min(ages) >= fresh
    assert max(ages) <= old


@pytest.mark.parametrize("fault", ["drop_byte", "insert_byte"])
@pytest.mark.parametrize("phase", range(8))
def test_a_lost_or_extra_byte_is_found_and_the_dialogue_found_again(binary, fault, phase):
    rig = binary
    rig.steps(100 + phase)
    rig.controller.inject(fault, 1)
    found = rig.until(lambda r: r.trouble == Trouble.LINE_DESYNC, most=60)
    assert found <= 42
    assert rig.readings.trouble_value == 1
    ticks = 0
    while rig.readings.trouble:
        r = rig.step()
        ticks += 1
        if r.wrench_validity == VALID:
            assert r.wrench_in_sensor == pytest.approx(LOAD, abs=0.07), "old or new, never wrong"
    assert ticks <= 60
    assert rig.steps(500) == {0}


def test_a_burst_of_wrong_bytes_never_makes_a_wrong_wrench(rig):
    random = np.random.default_rng(5)
    rig.steps(100)
    for _ in range(3000):
        if random.random() < 0.01:
            rig.controller.inject("insert_byte", random.integers(1, 9))
        r = rig.step()
        if r.wrench_validity == VALID:
            assert r.wrench_in_sensor == pytest.approx(LOAD, abs=0.07)
    assert rig.steps(300) >= {0}
    assert rig.readings.trouble == 0


def test_silence_is_told_and_over_when_it_is_over(rig):
    rig.steps(100)
    rig.controller.inject("silence")
    assert rig.until(lambda r: r.wrench_validity == INVALID, most=200) <= 101
    assert rig.until(lambda r: r.trouble == Trouble.SENSOR_SILENT, most=50) <= 30
    rig.steps(200)
    assert rig.readings.trouble_value >= 200
    rig.controller.inject("silence", 0)
    assert rig.until(lambda r: r.wrench_validity == VALID, most=200) <= 150


def test_a_line_without_controller_is_silent_from_the_beginning(lockstep):
    rig = lockstep(card=False)
    rig.site.devices["force"] = AtiSerial("force", TABLE, rig.site)
    assert rig.until(lambda r: r.trouble == Trouble.SENSOR_SILENT) == 102


def test_an_error_in_the_record_makes_it_invalid(rig):
    rig.steps(100)
    rig.controller.inject("error_record", 5)
    rig.until(lambda r: r.trouble == Trouble.SENSOR_STATUS, most=30)
    assert (rig.readings.trouble_value, rig.readings.wrench_validity) == (5, INVALID)
    assert np.isnan(rig.readings.wrench_in_sensor).all()
    rig.controller.inject("error_record", 0)
    assert rig.until(lambda r: r.wrench_validity == VALID, most=30) <= 30


def test_a_controller_that_was_left_streaming_or_half_way_through_a_command_is_caught(binary):
    rig = binary
    rig.controller._link.send(b"half a record")
    rig.controller._heard.extend(b"QS\rCD")
    assert rig.until(lambda r: r.wrench_validity == VALID) <= 100
    assert rig.steps(100) == {0}


def test_an_adapter_that_delivers_in_bursts_is_lived_with(binary):
    """Bytes of 16 ms come at once: records are older, and the dialogue is not lost, and found again when it is."""
    rig = binary
    rig.step()
    line, kept = rig.sensor._link, bytearray()
    receive = line.receive

    def bursts(buffer):
        size = receive(buffer)
        if size > 0:
            kept.extend(buffer[:size])
        if rig.tick % 16 or not kept:
            return -1
        size = len(kept)
        buffer[:size] = kept
        kept.clear()
        return size

    line.receive = bursts
    rig.steps(200)
    assert rig.steps(300) == {0}
    assert rig.readings.wrench_validity == VALID
    assert 6 <= rig.readings.wrench_age_ticks <= 48
    rig.controller.inject("drop_byte", 1)
    rig.until(lambda r: r.trouble == Trouble.LINE_DESYNC, most=100)
    assert rig.until(lambda r: r.trouble == 0, most=300) <= 150
    assert rig.steps(300) == {0}


def test_babble_is_bounded_and_told(binary):
    rig = binary
    rig.steps(100)
    rig.physics = lambda bench: rig.controller._link.send(b"\xa5" * 300)  # noqa: ARG005
    assert rig.until(lambda r: r.trouble == Trouble.LINE_DESYNC) <= 2
    assert rig.until(lambda r: r.wrench_validity == INVALID) <= 101
    assert len(rig.sensor._line._waiting) < 1000
    rig.physics = None
    assert rig.until(lambda r: r.wrench_validity == VALID) <= 150


@given(st.lists(st.binary(max_size=300), max_size=40))
@settings(max_examples=100, deadline=None)
def test_byte_soup_never_raises_and_never_is_a_wrench(lockstep, soup):
    rig = lockstep(card=False)
    rig.site.devices["force"] = AtiSerial("force", TABLE, rig.site)
    end = rig.switchboard.plug_serial(TABLE["path"])
    for junk in soup:
        end.send(junk)
        for _ in range(8):
            assert rig.step().wrench_validity == INVALID


def test_a_reset_controller_is_set_up_again(binary):
    rig = binary
    rig.steps(100)
    rig.controller._binary = False
    assert rig.until(lambda r: r.trouble == Trouble.LINE_DESYNC, most=60) <= 45
    assert rig.until(lambda r: r.trouble == 0, most=100) <= 60
    assert rig.steps(100) == {0}


def test_overload_by_the_ratings_in_the_settings(binary):
    rig = binary
    rig.bench.wrench_in_sensor[5] = -0.9 * 250
    rig.steps(60)
    assert rig.readings.trouble == Trouble.LOAD_HIGH
    rig.bench.wrench_in_sensor[5] = 1.2 * 250
    rig.steps(20)
    assert rig.readings.trouble == Trouble.LOAD_OVER_RATED


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"path": None}, "path is missing"),
        ({"counts_per_torque": None}, "counts_per_torque is missing"),
        ({"mode": "morse"}, "out of bounds"),
        ({"rated_n_nmm": [1.0]}, "list of 6"),
    ],
)
def test_settings_that_do_not_fit_are_refused(lockstep, change, says):
    table = {k: v for k, v in {**TABLE, **change}.items() if v is not None}
    with pytest.raises(OptionError, match=says):
        AtiSerial("force", table, lockstep(card=False).site)


def test_emulator_refuses_what_it_does_not_know(binary):
    for fault, value in (("lightning", 1), ("error_record", 256)):
        with pytest.raises(BackendError):
            binary.controller.inject(fault, value)


def test_probe_health_and_close(binary):
    rig = binary
    rig.step()
    assert not rig.sensor.probe()[0].good
    rig.steps(100)
    assert all(f.good for f in rig.sensor.probe())
    assert "/dev/ttyS0" in rig.sensor.health().identity
    assert rig.sensor.health().age_ticks >= 6
    rig.sensor.close()
    rig.sensor.close()
    assert rig.step().wrench_validity == INVALID


def test_over_a_real_terminal(lockstep):
    """The same driver through pyserial, and the same emulator at the other end of a pseudo terminal."""
    master, slave = os.openpty()
    tty.setraw(master)
    tty.setraw(slave)
    os.set_blocking(master, False)

    class Master:
        def receive(self, buffer):
            try:
                return os.readv(master, [buffer])
            except BlockingIOError:
                return -1

        def send(self, data):
            os.write(master, data)

    rig = lockstep(card=False)
    rig.switchboard.plug_serial = lambda path: Master()  # noqa: ARG005
    rig.switchboard.serial = SerialPort
    try:
        sensor, _ = rig.add(AtiSerial, EmulatedAtiSerial, "force", {**TABLE, "path": os.ttyname(slave)})
        rig.bench.wrench_in_sensor[:] = LOAD
        assert rig.until(lambda r: r.wrench_validity == VALID) <= 100
        assert rig.readings.wrench_in_sensor == pytest.approx(LOAD, abs=0.07)
        assert rig.steps(200) == {0}
        sensor.close()
    finally:
        os.close(slave)
        os.close(master)
