"""A Net F/T through its real driver: golden bytes, order, and every row of the failure table that concerns it."""

import socket
import struct
import time

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from drivers.ati import rdt
from drivers.ati.net_ft import AtiNetFt
from hal.errors import BackendError, OptionError
from hal.frames import FROZEN, INVALID, SATURATED, VALID
from hal.sockets import UdpSocket
from hal.troubles import Trouble
from sim_backends.emulators.ati_net_ft import EmulatedNetFt

TABLE = {
    "address": "192.168.1.1:49152",
    "counts_per_force": 1000000,
    "counts_per_torque": 999991,
    "force_unit": "N",
    "torque_unit": "N-m",
    "rated_n_nmm": [18.0, 18.0, 18.0, 250.0, 250.0, 250.0],
}


@pytest.fixture
def rig(lockstep):
    return make(lockstep)


def make(lockstep, **changes):
    rig = lockstep(card=False)
    rig.sensor, rig.box = rig.add(AtiNetFt, EmulatedNetFt, "force", {**TABLE, **changes})
    return rig


class Bare:
    """A driver whose other end is in the test's hands."""

    def __init__(self, lockstep):
        self.rig = lockstep(card=False)
        self.rig.site.devices["force"] = AtiNetFt("force", TABLE, self.rig.site)
        self.link = self.rig.switchboard.plug_datagrams("", TABLE["address"])

    def step(self, *records):
        for record in records:
            self.link.send(record if isinstance(record, bytes) else struct.pack(">III6i", *record))
        return self.rig.step()


def test_requests_are_the_bytes_of_the_manual(lockstep):
    bare = Bare(lockstep)
    bare.step()
    bare.rig.site.devices["force"].close()
    bare.rig.site.devices["force"].close()
    buffer = bytearray(64)
    sent = []
    while (n := bare.link.receive(buffer)) >= 0:
        sent.append(bytes(buffer[:n]).hex())
    assert sent == ["1234000200000000", "1234000000000000"]


def test_a_golden_record_is_read(lockstep):
    bare = Bare(lockstep)
    counts = "000f4240fff0bdc00000000000000001ffffffff7fffffff"
    bare.step(bytes.fromhex("000000010000000700000000" + counts))
    r = bare.step(bytes.fromhex("000000020000000e00000000" + counts))
    assert r.wrench_validity == VALID
    assert r.wrench_in_sensor[:3].tolist() == [1.0, -1.0, 0.0]
    assert r.wrench_in_sensor[3:] == pytest.approx(1000 / 999991 * np.array([1, -1, 2**31 - 1]))


@pytest.mark.parametrize(
    "changes",
    [
        {},
        {"force_unit": "lbf", "torque_unit": "lbf-in", "counts_per_force": 4448, "counts_per_torque": 8850.7},
        {"translation_mm": [3.0, -8.0, 21.0], "rotation_deg": [20.0, -35.0, 140.0]},
    ],
)
def test_wrench_on_the_bench_is_the_wrench_that_is_read(lockstep, changes):
    rig = make(lockstep, **changes)
    rig.steps(3)
    for load in np.random.default_rng(1).uniform(-1, 1, (30, 6)) * [3, 3, 3, 60, 60, 60]:
        rig.bench.wrench_in_sensor[:] = load
        r = rig.step()
        assert (r.wrench_validity, r.wrench_age_ticks, r.trouble) == (VALID, 0, 0)
        assert r.wrench_in_sensor == pytest.approx(load, abs=0.03)
    assert r.wrench_sequence == 30 + 1, "the first record is only believed with the second"


def test_first_wrench_comes_with_the_second_record(rig):
    assert rig.until(lambda r: r.wrench_validity == VALID) <= 3


@pytest.mark.parametrize(("dropped", "validity"), [(1, VALID), (5, VALID), (6, INVALID)])
def test_lost_records_make_the_wrench_old_and_then_invalid(rig, dropped, validity):
    rig.steps(50)
    rig.box.inject("drop", dropped)
    for _ in range(dropped):
        r = rig.step()
    assert (r.wrench_validity, r.wrench_age_ticks) == (validity, dropped)
    r = rig.step()
    assert (r.trouble, r.trouble_value) == (Trouble.DATAGRAM_GAP, dropped)
    assert (r.wrench_validity, r.wrench_age_ticks) == (VALID, 0)
    assert rig.steps(10) == {0}


def test_a_silent_sensor_is_told_and_asked_again_until_it_answers(rig):
    rig.steps(50)
    rig.box.inject("silence")
    assert rig.until(lambda r: r.trouble == Trouble.SENSOR_SILENT) == 6
    assert rig.readings.wrench_validity == INVALID
    rig.steps(300)
    assert rig.readings.trouble_value == 306
    rig.box.inject("silence", 0)
    assert rig.until(lambda r: r.wrench_validity == VALID) <= 103
    assert rig.steps(20) == {0}, "a longer pause is no restart of the sensor"


def test_duplicates_and_late_records_are_not_new(rig):
    rig.steps(50)
    before = rig.readings.wrench_sequence
    rig.box.inject("duplicate", 10)
    rig.steps(10)
    assert rig.readings.wrench_sequence == before + 10
    rig.box.inject("reorder", 10)
    troubles = rig.steps(40)
    assert troubles <= {0, Trouble.DATAGRAM_GAP}
    assert rig.readings.wrench_validity == VALID
    assert rig.sensor.health().errors["late"] >= 15


def test_a_late_record_does_not_replace_a_newer_one(lockstep):
    bare = Bare(lockstep)
    for i in range(1, 10):
        bare.step((i, 7 * i, 0, i, 0, 0, 0, 0, 0))
    r = bare.step((11, 77, 0, 11, 0, 0, 0, 0, 0), (10, 70, 0, 10, 0, 0, 0, 0, 0))
    assert r.wrench_in_sensor[0] == pytest.approx(11e-6)
    assert (r.trouble, r.trouble_value) == (Trouble.DATAGRAM_GAP, 1)


def test_all_waiting_records_are_taken_and_the_newest_wins(lockstep):
    bare = Bare(lockstep)
    r = bare.step(*[(i, 7 * i, 0, i, 0, 0, 0, 0, 0) for i in range(1, 101)])
    assert r.wrench_in_sensor[0] == pytest.approx(100e-6)
    assert r.wrench_sequence == 99


def test_both_counters_wrap(lockstep):
    bare = Bare(lockstep)
    for i in range(-20, 20):
        r = bare.step((i % 2**32, (7 * i) % 2**32, 0, i, 0, 0, 0, 0, 0))
        if i > -20:
            assert (r.wrench_validity, r.trouble) == (VALID, 0)
            assert r.wrench_in_sensor[0] == pytest.approx(i * 1e-6)


@pytest.mark.parametrize("start", [100, 2**31 + 7, 3_000_000_000])
@pytest.mark.parametrize("restart", [0, 1, 40])
def test_a_restart_of_ft_sequence_is_found_wherever_the_counters_were(lockstep, start, restart):
    bare = Bare(lockstep)
    for i in range(100):
        bare.step((start + i, (start + 1000) * 7 % 2**32 + 7 * i, 0, 1, 0, 0, 0, 0, 0))
    for _ in range(20):
        bare.step()
    for i in range(3):
        r = bare.step((1 + i, restart + 7 * i, 0, 1, 0, 0, 0, 0, 0))
    assert r.trouble == Trouble.SENSOR_REBOOTED
    assert r.wrench_validity == INVALID
    assert np.isnan(r.wrench_in_sensor).all()


def test_a_restart_of_a_sensor_that_had_just_begun_is_no_late_record(lockstep):
    bare = Bare(lockstep)
    for i in range(30):
        bare.step((1 + i, 7 * i, 0, 1, 0, 0, 0, 0, 0))
    for _ in range(11):
        bare.step()
    for i in range(2):
        r = bare.step((1 + i, 7 * i, 0, 1, 0, 0, 0, 0, 0))
    assert (r.wrench_validity, r.trouble) == (INVALID, Trouble.SENSOR_REBOOTED)


def test_a_reboot_with_power_is_invalid_until_power_is_taken_away(rig):
    rig.bench.wrench_in_sensor[0] = 1.0
    rig.steps(200, 0.0, True)
    rig.box.inject("reboot", 20)
    ticks = rig.until(lambda r: r.trouble == Trouble.SENSOR_REBOOTED, 0.0, True)
    assert ticks <= 20 + 100 + 3, "boot, the next request, and two records"
    assert rig.steps(2000, 0.0, True) == {Trouble.SENSOR_REBOOTED}
    assert rig.readings.wrench_validity == INVALID
    rig.step()
    assert rig.step().wrench_validity == VALID


def test_a_reboot_without_power_is_shown_for_half_a_second(rig):
    rig.steps(200)
    rig.box.inject("reboot", 2)
    rig.until(lambda r: r.trouble == Trouble.SENSOR_REBOOTED)
    assert rig.until(lambda r: r.wrench_validity == VALID) in range(499, 503)


def test_a_frozen_sample_is_found_although_records_go_on(rig):
    rig.steps(50)
    rig.box.inject("freeze_ft")
    assert rig.until(lambda r: r.wrench_validity == FROZEN) == 5
    assert (rig.readings.trouble, rig.readings.trouble_value) == (Trouble.SENSOR_FROZEN, 5)
    assert np.isnan(rig.readings.wrench_in_sensor).all()
    rig.box.inject("freeze_ft", 0)
    assert rig.step().wrench_validity == VALID


@pytest.mark.parametrize("bit", range(1, 32))
def test_status_bits(rig, bit):
    rig.steps(10)
    rig.box.inject("status", bit)
    r = rig.step()
    if bit in (16, 31):
        assert (r.wrench_validity, r.trouble) == (VALID, 0)
        return
    assert r.wrench_validity == (SATURATED if bit == 17 else INVALID)
    assert (r.trouble, r.trouble_value) == (Trouble.SENSOR_STATUS, bit)
    assert np.isnan(r.wrench_in_sensor).all()
    rig.box.inject("status", 0)
    assert rig.step().wrench_validity == VALID


def test_datagrams_of_another_length_are_refused(rig):
    rig.steps(10)
    rig.box.inject("corrupt", 3)
    r = rig.step()
    assert (r.trouble, r.trouble_value) == (Trouble.DATAGRAM_CORRUPT, 1)
    assert (r.wrench_validity, r.wrench_age_ticks) == (VALID, 1)
    rig.steps(3)
    assert rig.sensor.health().errors["refused"] == 3


def test_one_datagram_of_nonsense_changes_nothing(lockstep):
    bare = Bare(lockstep)
    bare.step((1, 7, 0, 5, 0, 0, 0, 0, 0), (2, 14, 0, 5, 0, 0, 0, 0, 0))
    for i in range(3, 100):
        r = bare.step((i, 7 * i, 0, 5, 0, 0, 0, 0, 0), (0xDEADBEEF, 0xCAFE * i, 0, 2**31 - 1, 0, 0, 0, 0, 0))
    assert (r.wrench_validity, r.trouble) == (VALID, 0)
    assert r.wrench_in_sensor[0] == pytest.approx(5e-6)


@given(st.lists(st.binary(min_size=0, max_size=80), max_size=60))
@settings(max_examples=200, deadline=None)
def test_byte_soup_never_raises_and_never_is_a_wrench(lockstep, soup):
    bare = Bare(lockstep)
    for junk in soup:
        r = bare.step(junk, (junk * 36)[:36])
        assert r.wrench_validity == INVALID
        assert np.isnan(r.wrench_in_sensor).all()


@given(st.integers(0, 2**32 - 1), st.integers(-(2**31), 2**31 - 1))
def test_difference_undoes_the_wrap(start, step):
    assert rdt.difference((start + step) % 2**32, start) == step


@given(st.integers(0, 2**32 - 1))
def test_any_bit_but_the_harmless_two_is_an_error(status):
    bit = rdt.worst_bit(status)
    assert (bit < 0) == (status & 0x7FFEFFFF == 0)
    assert bit < 0 or status >> bit & 1


def test_a_flood_does_not_hold_up_the_tick(lockstep):
    bare = Bare(lockstep)
    bare.step(*[b"x"] * 1000)
    assert bare.rig.readings.trouble_value == 256


def test_overload_by_the_ratings_in_the_settings(rig):
    rig.bench.wrench_in_sensor[3] = 0.85 * 250
    rig.steps(3)
    assert rig.readings.trouble == Trouble.LOAD_HIGH
    rig.bench.wrench_in_sensor[3] = -1.1 * 250
    r = rig.step()
    assert (r.trouble, r.wrench_validity) == (Trouble.LOAD_OVER_RATED, VALID)
    assert r.trouble_value == pytest.approx(110, abs=0.1)


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"counts_per_force": None}, "counts_per_force is missing"),
        ({"torque_unit": None}, "torque_unit is missing"),
        ({"force_unit": "kgf"}, "out of bounds"),
        ({"rated_n_nmm": [1.0, 2.0]}, "list of 6"),
        ({"adress": "x"}, "did you mean 'address'"),
    ],
)
def test_settings_that_do_not_fit_are_refused(lockstep, change, says):
    table = {k: v for k, v in {**TABLE, **change}.items() if v is not None}
    with pytest.raises(OptionError, match=says):
        AtiNetFt("force", table, lockstep(card=False).site)


def test_emulated_box_is_as_strict_as_a_real_one(rig):
    for fault, value in (("lightning", 1), ("status", 32), ("status", 0.5)):
        with pytest.raises(BackendError):
            rig.box.inject(fault, value)
    rig.steps(5)
    for wrong in (b"\x12\x34\0\0\0\0\0", b"\x34\x12\0\0\0\0\0\0", b""):
        rig.sensor._link.send(wrong)
    assert rig.step().wrench_age_ticks == 0, "it was not stopped"
    rig.sensor._link.send(bytes.fromhex("1234000200000003"))
    rig.steps(4)
    assert rig.step().wrench_age_ticks == 2, "three records, then no more"


def test_software_bias_of_the_box(rig):
    rig.bench.wrench_in_sensor[2] = -3.0
    rig.steps(5)
    rig.sensor._link.send(bytes.fromhex("1234004200000000"))
    rig.steps(3)
    assert rig.readings.wrench_in_sensor[2] == pytest.approx(0.0, abs=1e-5)


def test_probe_and_health(rig):
    assert not rig.sensor.probe()[0].good
    rig.steps(5)
    assert all(f.good for f in rig.sensor.probe())
    rig.box.inject("status", 2)
    rig.step()
    assert "temperature" in rig.sensor.probe()[1].found
    assert "192.168.1.1:49152" in rig.sensor.health().identity


def test_over_real_sockets(lockstep):
    """The same driver and the same emulator with the loopback between them."""

    class BoxEnd:
        def __init__(self):
            self.socket, self.peer = socket.socket(socket.AF_INET, socket.SOCK_DGRAM), None
            self.socket.bind(("127.0.0.1", 0))
            self.socket.settimeout(0.0)

        def receive(self, buffer):
            try:
                size, self.peer = self.socket.recvfrom_into(buffer)
            except OSError:
                return -1
            return size

        def send(self, data):
            self.socket.sendto(data, self.peer)

    end = BoxEnd()
    port = end.socket.getsockname()[1]
    rig = lockstep(card=False)
    rig.switchboard.plug_datagrams = lambda local, peer: end  # noqa: ARG005
    rig.switchboard.datagrams = UdpSocket
    try:
        sensor, _ = rig.add(AtiNetFt, EmulatedNetFt, "force", {**TABLE, "address": f"127.0.0.1:{port}"})
        rig.bench.wrench_in_sensor[:] = [1, 2, 3, 40, 50, 60]
        for _ in range(20):
            rig.step()
            time.sleep(0.001)
        assert rig.readings.wrench_validity == VALID
        assert rig.readings.wrench_in_sensor == pytest.approx([1, 2, 3, 40, 50, 60], abs=1e-3)
        sensor.close()
    finally:
        end.socket.close()
