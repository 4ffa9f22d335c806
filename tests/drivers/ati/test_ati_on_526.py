"""A transducer on an emulated Sensoray 526, through both real drivers."""

from pathlib import Path

import pytest

from drivers.ati.daq import AtiDaq
from drivers.sensoray526.device import Sensoray526
from hal.frames import FROZEN, INVALID, SATURATED, VALID
from hal.troubles import Trouble
from sim_backends.emulators.ati_daq import EmulatedAtiDaq
from sim_backends.emulators.sensoray526 import EmulatedSensoray526

TABLE = {
    "card": "card",
    "inputs": [0, 1, 2, 3, 4, 5],
    "calibration": str(Path(__file__).parent / "newer.cal"),
    "t_out_input": 6,
}


@pytest.fixture
def rig(lockstep):
    rig = lockstep(card=False)
    rig.card, rig.emulated = rig.add(Sensoray526, EmulatedSensoray526, "card", {})
    rig.sensor, rig.transducer = rig.add(AtiDaq, EmulatedAtiDaq, "force", TABLE)
    return rig


def test_wrench_on_the_bench_is_the_wrench_that_is_read(rig):
    rig.bench.wrench_in_sensor[:] = [1.0, -2.0, 3.0, 10.0, -20.0, 30.0]
    assert rig.steps(1000) == {0}
    assert rig.readings.wrench_validity == VALID
    assert rig.readings.wrench_in_sensor[:3] == pytest.approx([1.0, -2.0, 3.0], abs=0.05)
    assert rig.readings.wrench_in_sensor[3:] == pytest.approx([10.0, -20.0, 30.0], abs=0.5)


def test_a_channel_that_is_not_converted_any_more_is_frozen(rig):
    """Its voltage goes on dithering with the references of every scan; its words do not."""
    rig.steps(100)
    rig.emulated.inject("stale_channel", 1 + 3)
    ticks = rig.until(lambda r: r.wrench_validity == FROZEN, most=100)
    assert ticks <= 21
    assert (rig.readings.trouble, rig.readings.trouble_value) == (Trouble.GAUGE_FROZEN, 4)


def test_an_input_at_its_rail_is_saturation(rig):
    rig.steps(20)
    rig.emulated.inject("input_rail", 1 + 5)
    assert rig.step().wrench_validity == SATURATED
    assert (rig.readings.trouble, rig.readings.trouble_value) == (Trouble.GAUGE_SATURATED, 6)


def test_without_a_conversion_there_is_no_wrench(rig):
    rig.steps(20)
    rig.emulated.inject("adc_never_done")
    assert rig.step().wrench_validity == INVALID
    assert rig.readings.trouble == Trouble.ADC_NOT_DONE
