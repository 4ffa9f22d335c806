"""Every row of the failure table that concerns a drive on a bus: detection, the state reached, and mending (07 section 7)."""

import pytest

from hal.frames import INVALID, VALID
from hal.troubles import TABLE, Grade, Trouble

T = Trouble
ROWS = [
    # fault, value, what is reported, after how many ticks, validity then, ticks until the drives have no power
    ("bus_off", 1, T.BUS_OFF, (1, 1), INVALID, 95),
    ("tx_full", 1, T.BUS_OVERLOAD, (2, 3), VALID, 95),
    ("busy", 0.8, T.BUS_OVERLOAD, (8, 10), VALID, 40),
    ("busy", 0.5, T.BUS_OVERLOAD, (25, 35), VALID, 30),
    ("mute", 3, T.NODE_SILENT, (10, 12), INVALID, 12),
    ("heartbeat_dead", 3, T.NODE_SILENT, (40, 64), VALID, 20),
    ("reboot", 3, T.NODE_REBOOTED, (6, 8), INVALID, 8),
    ("drive_fault", 3, T.DRIVE_FAULT, (1, 3), VALID, 8),
    ("ignore_setpoint", 3, T.DRIVE_IGNORES, (4, 8), VALID, 8),
    ("sync_delay", 8, T.NODE_SILENT, (10, 12), INVALID, 20),
]
FOR_GOOD = {T.BUS_OFF, T.NODE_REBOOTED}


def five(rig, **more):
    return rig.make(rig.bus(*[rig.node(i + 1, i) for i in range(5)], **more))


@pytest.mark.parametrize("phase", [0, 1])
@pytest.mark.parametrize(("fault", "value", "trouble", "ticks", "validity", "stop_ticks"), ROWS)
def test_it_is_found_stops_all_drives_and_is_mended(rig, fault, value, trouble, ticks, validity, stop_ticks, phase):
    r = five(rig)
    r.power_up()
    r.run(40 + phase, 0.2)
    r.emulator.inject(fault, value)
    found = r.until(trouble, command_v=0.2)
    assert ticks[0] <= found <= ticks[1]
    s = r.sensors[0]
    assert s["axes_validity"] == validity
    assert not s["powered"]
    assert TABLE[trouble].grade == Grade.FAULT
    needed = next(n for n in range(200) if not r.bench.enabled.any() or not r.step(0.2)["axes_age_ticks"] >= 0)
    assert needed <= stop_ticks
    for _ in range(50):  # the command goes on: nothing comes back by itself
        r.step(0.2)
        assert not r.bench.enabled.any()
    r.emulator.inject(fault, 0)
    r.run(70, power=0)
    s = r.sensors[0]
    if trouble in FOR_GOOD:
        assert s["trouble"] == trouble
        with pytest.raises(AssertionError, match="no power"):
            r.power_up()
        r.backend.close()
        r.backend.open()
        r.run(5, power=0)
    assert r.sensors[0]["trouble"] == T.NONE
    assert r.sensors[0]["axes_validity"] == VALID
    assert r.power_up() <= 20


@pytest.mark.parametrize("phase", [0, 1])
@pytest.mark.parametrize(
    ("fault", "value", "trouble", "ticks"),
    [
        ("bus_passive", 1, T.BUS_PASSIVE, (1, 1)),
        ("mute", 3, T.NODE_LATE, (4, 6)),
        ("sync_delay", 1, T.NODE_LATE, (4, 6)),
    ],
)
def test_a_warning_stops_nothing_and_ends_with_its_cause(rig, fault, value, trouble, ticks, phase):
    r = five(rig)
    r.power_up()
    r.run(40 + phase, 0.2)
    r.emulator.inject(fault, value)
    assert ticks[0] <= r.until(trouble, command_v=0.2) <= ticks[1]
    s = r.sensors[0]
    assert (s["trouble_grade"], s["axes_validity"], s["powered"]) == (Grade.WARNING, VALID, 1)
    r.emulator.inject(fault, 0)
    s = r.run(6, 0.2)
    assert (s["trouble"], s["powered"]) == (T.NONE, 1)


def test_a_late_node_keeps_its_angle_with_its_age_and_a_silent_one_loses_it(rig):
    r = rig.make(rig.bus(rig.node(1, 0)))
    r.power_up()
    last = r.run(60, 0.5)["axis_angle_rad"].copy()
    r.emulator.inject("mute", 1)
    r.until(T.NODE_LATE, command_v=0.5)
    assert r.sensors[0]["axis_angle_rad"] == pytest.approx(last, abs=0.1)
    assert r.sensors[0]["axes_age_ticks"] == 5
    r.until(T.NODE_SILENT, command_v=0.5)
    assert r.sensors[0]["axes_age_ticks"] == 11
    assert r.sensors[0]["axis_angle_rad"] != r.sensors[0]["axis_angle_rad"]


def test_a_drive_of_a_dead_master_stops_by_itself(rig):
    """The watchdog's 50 ms and two heartbeats of 20 ms, then a quick stop (1016, 6007)."""
    r = five(rig)
    r.power_up()
    r.run(40, 1.0)
    ticks = 0
    while r.bench.enabled.any():
        r.step(write=None)
        ticks += 1
        assert ticks < 200
    assert 70 <= ticks <= 110
    assert all(node.drive.state.name == "DISABLED" for node in r.emulator.nodes.values())


def test_a_drive_fault_tells_its_code_and_is_reset_only_to_disabled(rig):
    r = five(rig)
    r.power_up()
    r.emulator.inject("drive_fault", 3)
    r.until(T.DRIVE_FAULT)
    assert (r.sensors[0]["trouble_value"], r.sensors[0]["amplifier_fault"]) == (0x2310, 1)
    r.run(50)  # power is still asked for
    assert r.node(3).drive.state.name == "FAULT"
    r.emulator.inject("drive_fault", 0)
    r.run(50)
    assert r.node(3).drive.state.name == "FAULT"
    r.run(50, power=0)
    assert r.node(3).drive.state.name == "DISABLED"
    assert r.sensors[0]["amplifier_fault"] == 0


def test_a_fault_whose_cause_stays_is_not_reset(rig):
    r = five(rig)
    r.power_up()
    r.emulator.inject("drive_fault", 3)
    r.until(T.DRIVE_FAULT)
    s = r.run(50, power=0)
    assert (s["trouble"], r.node(3).drive.state.name) == (T.DRIVE_FAULT, "FAULT")


def test_a_following_error_makes_the_drive_fault(rig):
    r = rig.make(rig.bus(rig.node(1, 0, "csp", following_error_rad=0.01)))
    r.power_up()
    r.node(1).drive.loops.rotor.coulomb_nm = 1.0  # jammed
    r.until(T.DRIVE_FAULT, command_v=10.0)
    assert r.sensors[0]["trouble_value"] == 0x8611


def test_an_encoder_that_jumps(rig):
    r = five(rig)
    r.power_up()
    r.run(20)
    r.bench.angle_rad[2] += 10.0
    assert r.until(T.ENCODER_JUMP) <= 4
    assert r.sensors[0]["axes_validity"] == INVALID
    assert abs(r.sensors[0]["trouble_value"]) == pytest.approx(10.0 * rig.cpr, abs=40)
    s = r.run(10, power=0)
    assert (s["trouble"], s["axes_validity"]) == (T.NONE, VALID)


def test_a_drive_that_falls_out_of_enabled_is_not_enabled_again(rig):
    r = five(rig)
    r.power_up()
    r.node(2).drive._enter(type(r.node(2).drive.state).DISABLED)  # as by its STO input
    r.until(T.DRIVE_IGNORES)
    assert r.sensors[0]["trouble_value"] == 1
    r.run(50)
    assert not r.bench.enabled.any()


def test_two_buses_fail_apart(rig):
    r = rig.make(
        rig.bus(*[rig.node(i + 1, i) for i in range(3)], divisor=1),
        rig.bus(*[rig.node(i + 1, 3 + i) for i in range(2)], channel="can1", divisor=1),
    )
    r.power_up()
    assert r.run(30, 0.5)["axes_validity"] == VALID
    r.emulators[1].inject("mute", 2)
    r.until(T.NODE_SILENT)
    assert (r.sensors[0]["trouble_device"], r.sensors[0]["trouble_value"]) == (1, 4)
    assert r.bench.enabled[:3].all()  # the lifecycle takes their power, not the other bus


def test_every_fault_of_the_emulator_is_tried_here(rig):
    tried = {row[0] for row in ROWS} | {"bus_passive", "sdo_abort", "wrong_readback"}
    assert tried == set(five(rig).emulator.faults)
