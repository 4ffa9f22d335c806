"""Axes on an emulated Sensoray 526, through both real drivers."""

import math

import pytest

from drivers.maxon_lsc.device import LscAxis
from drivers.sensoray526.device import Sensoray526
from hal.frames import INVALID, VALID
from hal.troubles import Trouble
from sim_backends.emulators.lsc import EmulatedLsc
from sim_backends.emulators.sensoray526 import EmulatedSensoray526

COUNTS_PER_RAD = 4 * 500 * 14 / math.tau


@pytest.fixture
def rig(lockstep):
    rig = lockstep(axes=4, card=False)
    rig.card, rig.emulated = rig.add(Sensoray526, EmulatedSensoray526, "card", {})
    rig.axes = [
        rig.add(LscAxis, EmulatedLsc, f"axis{n}", {
            "axis": n, "card": "card", "counter": n, "output": n, "enable_line": n, "ready_line": 4 + n,
            "lines": 500, "gear": 14.0, "max_speed_rad_per_s": 60.0, "encoder_direction": 1 - 2 * (n % 2),
            "mode": "current", "gain_a_per_v": 0.2, "continuous_a": 0.8, "peak_a": 1.6, "thermal_s": 10.0,
        })
        for n in range(4)
    ]  # fmt: skip
    rig.physics = lambda bench: bench.angle_rad.__iadd__(0.01 * bench.command_v * bench.enabled)
    return rig


def test_four_axes_turn_and_are_read(rig):
    rig.steps(400, [1.0, -2.0, 3.0, -1.5], True)
    assert (rig.readings.axis_validity == VALID).all()
    assert rig.readings.axis_angle_rad == pytest.approx(rig.bench.angle_rad, abs=1.1 / COUNTS_PER_RAD)
    assert abs(rig.bench.angle_rad).min() > 3.0
    assert rig.readings.axis_powered.all()
    assert rig.readings.trouble == 0
    assert rig.bench.command_v == pytest.approx([1.0, -2.0, 3.0, -1.5], abs=0.005)


@pytest.mark.parametrize(
    ("fault", "trouble", "most"),
    [
        ("encoder_freeze", Trouble.ENCODER_STALLED, 52),
        ("encoder_glitch", Trouble.ENCODER_JUMP, 2),
        ("ecap", Trouble.ENCODER_ERROR, 2),
        ("index_add", Trouble.INDEX_LOST, 2),
        ("encoder_drop", Trouble.INDEX_LOST, 200),
    ],
)
def test_faults_of_the_card_are_seen_by_the_axis(rig, fault, trouble, most):
    rig.steps(300, 2.5, True)
    rig.emulated.inject(fault, 3)
    assert rig.until(lambda r: r.trouble == trouble, 2.5, True) <= most
    assert rig.readings.trouble_device == 3, "the third axis, after its card"


@pytest.mark.parametrize("fault", ["not_ready", "overheat"])
def test_a_fault_of_one_amplifier_drops_its_enable(rig, fault):
    rig.steps(100, 1.0, True)
    rig.axes[1][1].inject(fault)
    assert rig.until(lambda r: r.axis_fault[1], 1.0, True) == 2
    assert rig.bench.enabled.tolist() == [True, False, True, True]
    assert rig.bench.command_v[1] == pytest.approx(0.0, abs=0.005)


def test_without_a_card_there_are_no_angles_and_no_power(rig):
    rig.steps(100, 1.0, True)
    rig.emulated.inject("signature", 0xFFFF)
    rig.step(1.0, True)
    assert rig.readings.trouble == Trouble.CARD_LOST
    assert (rig.readings.axis_validity == INVALID).all()


def test_wrap_of_the_counter_is_no_jump(rig):
    rig.emulated.inject("preset_near_wrap", 2000)
    assert rig.steps(500, 2.5, True) == {0}
    assert rig.readings.axis_angle_rad == pytest.approx(rig.bench.angle_rad, abs=1.1 / COUNTS_PER_RAD)
