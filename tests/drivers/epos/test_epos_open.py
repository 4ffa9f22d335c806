"""Opening: what goes to a drive, in which order, and that nothing opens that does not hold its safety settings."""

import struct

import pytest

from hal.errors import BackendError

SAFETY = [0x1016, 0x1017, 0x6007, 0x605A, 0x605E, 0x6065, 0x6066, 0x607D, 0x6085, 0x6080, 0x3001, 0x6060, 0x60C2]
SAFETY_EPOS2 = [0x1016, 0x1017, 0x6007, 0x605A, 0x605E, 0x6065, 0x607D, 0x6085, 0x607F, 0x6410, 0x6060]


def spy(emulator):
    """Everything that the master sends, as (identifier, bytes)."""
    sent, send = [], emulator.bus.send

    def listen(message, timeout=None):
        sent.append((message.arbitration_id, bytes(message.data)))
        send(message, timeout)

    emulator.bus.send = listen
    return sent


def downloads(sent, node):
    """(index, sub, value bytes) of every SDO download to a node."""
    return [
        (*struct.unpack_from("<HB", data, 1), data[4 : 4 + 4 - (data[0] >> 2 & 3)])
        for identifier, data in sent
        if identifier == 0x600 + node and data[0] >> 5 == 1
    ]


def test_process_data_is_remapped_in_the_order_that_drives_demand(rig):
    r = rig.make(rig.bus(rig.node(3, 0, "csp")), open_it=False)
    sent = spy(r.emulator)
    r.backend.open()
    written = [(i, s, int.from_bytes(d, "little")) for i, s, d in downloads(sent, 3) if 0x1400 <= i < 0x1C00]
    assert written[-12:] == [
        (0x1600, 0, 0), (0x1600, 1, 0x60400010), (0x1600, 2, 0x607A0020), (0x1600, 0, 2), (0x1400, 2, 1), (0x1400, 1, 0x203),
        (0x1A00, 0, 0), (0x1A00, 1, 0x60410010), (0x1A00, 2, 0x60640020), (0x1A00, 0, 2), (0x1800, 2, 1), (0x1800, 1, 0x183),
    ]  # fmt: skip
    assert written[:-12] == [
        (base + n, 1, 1 << 31 | cob + 0x100 * n + 3)
        for n in range(4)
        for base, cob in ((0x1400, 0x200), (0x1800, 0x180))
    ]
    commands = [data for identifier, data in sent if identifier == 0]
    assert commands == [b"\x80\x00", b"\x01\x00"]
    first_mapping = next(i for i, (identifier, data) in enumerate(sent) if identifier == 0x603 and data[2:3] == b"\x14")
    assert sent.index((0, b"\x80\x00")) < first_mapping < sent.index((0, b"\x01\x00"))


def test_the_safety_settings_in_a_drives_own_units(rig):
    """4000 counts a turn: 2 rad are 1273 counts; 400 rad/s are 3820 rpm; 4000 rad/s^2 are 38197 rpm/s."""
    r = rig.make(rig.bus(rig.node(3, 0, "csp", following_error_ms=5, position_limits_rad=[-10.0, 20.0], direction=-1)))
    held = {(e.node, k >> 8, k & 0xFF): v.value for e in r.emulator.nodes.values() for k, v in e._objects.items()}
    expected = {
        (0x1016, 1): 127 << 16 | 90, (0x1017, 0): 20, (0x6007, 0): 3, (0x605A, 0): 2, (0x605E, 0): 2, (0x6065, 0): 1273,
        (0x6066, 0): 5, (0x607D, 1): -12732, (0x607D, 2): 6366, (0x6085, 0): 38197, (0x6080, 0): 3820,
        (0x3001, 1): 800, (0x3001, 2): 1600, (0x6060, 0): 8, (0x60C2, 1): 2, (0x60C2, 2): -3,
    }  # fmt: skip
    assert {(i, s): held[3, i, s] for i, s in expected} == expected


def test_further_objects_are_written_too(rig):
    r = rig.make(rig.bus(rig.node(3, 0, objects=[[0x60B2, 0, 2, -7], [0x6081, 0, 4, 500]])))
    objects = r.node(3)._objects
    assert (objects[0x60B200].value, objects[0x608100].value) == (-7, 500)


@pytest.mark.parametrize("index", SAFETY)
@pytest.mark.parametrize("fault", ["wrong_readback", "sdo_abort"])
def test_a_drive_that_does_not_hold_a_setting_is_not_opened(rig, index, fault):
    r = rig.make(rig.bus(rig.node(3, 0, "csp")), open_it=False)
    r.emulator.inject(fault, index)
    with pytest.raises(BackendError, match=rf"device bus0: .*{index:04X}:\d of node 3") as refused:
        r.backend.open()
    assert refused.value.remedy
    if fault == "sdo_abort":
        assert "abort 06090030" in str(refused.value)
    else:  # both values
        held, wanted = int(refused.value.value), int(refused.value.bound)
        assert held == wanted ^ 1
    r.emulator.inject(fault, 0)
    r.backend.open()
    assert r.power_up() < 20


@pytest.mark.parametrize("index", [0x1005, 0x1014])
def test_an_identifier_that_somebody_has_changed(rig, index):
    r = rig.make(rig.bus(rig.node(3, 0)), open_it=False)
    sent = spy(r.emulator)
    r.node(3)._objects[index << 8].value += 1
    with pytest.raises(BackendError, match=f"{index:04X}"):
        r.backend.open()
    assert not [i for i, _, _ in downloads(sent, 3) if i == index]


@pytest.mark.parametrize("index", SAFETY_EPOS2)
def test_the_same_of_an_epos2(rig, index):
    r = rig.make(rig.bus(rig.node(3, 0, "current")), open_it=False)
    r.emulator.inject("wrong_readback", index)
    with pytest.raises(BackendError, match=f"{index:04X}"):
        r.backend.open()


def test_a_drive_without_the_mode_is_not_opened(rig):
    r = rig.make(rig.bus(rig.node(3, 0, "csp")), open_it=False)
    r.node(3)._objects[0x650200].value = 0b100001
    with pytest.raises(BackendError, match=r"does not have this mode.*csp at node 3"):
        r.backend.open()


def test_a_node_that_is_not_there(rig):
    r = rig.make(rig.bus(rig.node(3, 0), rig.node(4, 1)), open_it=False)
    r.emulator.inject("mute", 4)
    with pytest.raises(BackendError, match=r"does not answer.*node 4"):
        r.backend.open()


def test_a_bus_that_is_off(rig):
    r = rig.make(rig.bus(rig.node(3, 0)), open_it=False)
    r.emulator.inject("bus_off")
    with pytest.raises(BackendError, match="nothing can be sent"):
        r.backend.open()


def test_an_energised_drive_is_switched_off_by_opening(rig):
    r = rig.make(rig.bus(rig.node(3, 0)))
    r.power_up()
    other = rig.make(rig.bus(rig.node(3, 0)), open_it=False)
    other.backend._site.seams.plug_bus("can0", r.emulator.bus)
    other.backend.open()
    r.step(write=None)
    r.step(write=None)
    assert not r.node(3).drive.power_stage


def test_probe_finds_what_a_drive_has_lost(rig):
    r = rig.make(rig.bus(rig.node(3, 0)))
    assert all(finding.good for finding in r.device.probe())
    r.node(3)._objects[0x606500].value = 77
    bad = [finding for finding in r.device.probe() if not finding.good]
    assert [finding.what for finding in bad] == ["node 3 (axis 0): settings"]
    assert "6065:0 is 77 instead of 1273" in bad[0].found
    r.emulator.inject("mute", 3)
    (silent,) = r.device.probe()
    assert not silent.good
    assert "does not answer" in silent.found


def test_health_names_the_drives_and_counts(rig):
    r = rig.make(rig.bus(rig.node(3, 0), rig.node(4, 1)))
    r.run(20, power=0)
    health = r.device.health()
    assert "node 3: FB-62100000 serial 1003; node 4" in health.identity
    assert health.firmware == "0170, 0170"
    assert health.age_ticks <= 3
    assert set(health.errors.values()) == {0}


def test_closing_stops_a_turning_motor_before_it_takes_the_voltage(rig):
    r = rig.make(rig.bus(rig.node(3, 0, "velocity")))
    r.power_up()
    r.run(100, 5.0)
    sent = spy(r.emulator)
    r.backend.close()
    words = [data[0] for identifier, data in sent if identifier == 0x203]
    assert words[0] == 0x02
    assert words[-1] == 0x00
    assert sent[-1] == (0, b"\x80\x03")
    for _ in range(100):
        r.step(write=None)
    assert not r.node(3).drive.power_stage
    assert r.node(3).drive.loops.rate_rad_per_s == pytest.approx(0.0, abs=5.0)
    r.backend.close()
