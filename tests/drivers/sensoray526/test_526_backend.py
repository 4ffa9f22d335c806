"""Two cards with eight axes and a force sensor behind the hardware backend: what the controller sees and what it moves."""

from pathlib import Path

import numpy as np
import pytest

from drivers.backend import HardwareBackend
from hal import emulator
from hal.emulator import Bench, Station
from hal.frames import FROZEN, INVALID, SATURATED, VALID, actuator_frame, sensor_frame
from hal.switchboard import Switchboard
from hal.troubles import Trouble

AXES = 8
CARDS = ("card_a", "card_b")
WATCHDOG = {"watchdog_code": 3, "watchdog_interval_s": 0.02}
TICK_RAD = 2 * np.pi / 2000


def devices():
    table = [
        {"kind": "sensoray526", "name": n, "base": b, **WATCHDOG} for n, b in zip(CARDS, (0x2C0, 0x300), strict=True)
    ]
    for axis in range(AXES):
        channel = axis % 4
        wiring = {"counter": channel, "output": channel, "enable_line": channel, "ready_line": 4 + channel}
        motor = {"lines": 500, "max_speed_rad_per_s": 60.0, "mode": "current", "gain_a_per_v": 0.2,
                 "continuous_a": 0.8, "peak_a": 1.6, "thermal_s": 10.0}  # fmt: skip
        table.append({"kind": "lsc_axis", "name": f"axis_{axis}", "axis": axis, "card": CARDS[axis // 4], **wiring, **motor})  # fmt: skip
    calibration = Path(__file__).parents[1] / "ati" / "newer.cal"
    table.append({"kind": "ati_daq", "name": "force", "card": "card_a", "inputs": [0, 1, 2, 3, 4, 5], "calibration": str(calibration)})  # fmt: skip
    return table


class WholeRig:
    """The backend with power, tick by tick; each axis turns by its own number of counts."""

    def __init__(self):
        table, board = devices(), Switchboard()
        self.station = Station(0.001, 1, board)
        for entry in table:
            rest = {k: v for k, v in entry.items() if k not in ("kind", "name")}
            self.station.emulators[entry["name"]] = emulator.load(entry["kind"])(entry["name"], rest, self.station)
        self.backend = HardwareBackend({"devices": table}, period_s=0.001)
        self.backend.use(board)
        self.bench, self.now = Bench(AXES), 0
        self.sensors, self.actuators = np.zeros(1, sensor_frame(AXES)), np.zeros(1, actuator_frame(AXES))
        self.backend.open()
        self.actuators["command_v"] = 0.1 * np.arange(1, AXES + 1)
        self.run(4)
        self.actuators["power"] = 1
        self.run(4)

    def run(self, ticks=1):
        for _ in range(ticks):
            self.now += 1
            self.bench.angle_rad += TICK_RAD * np.arange(1, AXES + 1)
            for emulated in self.station.emulators.values():
                emulated.sense(self.now, self.bench)
            self.backend.read(self.now, self.sensors)
            self.backend.write(self.now, self.actuators)
            for emulated in self.station.emulators.values():
                emulated.drive(self.now, self.bench)
        return self.sensors[0]

    def ticks_until(self, what):
        for tick in range(1, 100):
            if what(self.run()):
                return tick
        raise AssertionError("it never happened")

    def inject(self, fault, value=1, card="card_a"):
        self.station.emulators[card].inject(fault, value)


@pytest.fixture
def whole():
    return WholeRig()


def test_angles_wrench_and_commands_go_through(whole):
    before = whole.sensors["axis_angle_rad"][0].copy()
    seen = whole.run(10)
    assert (seen["axes_validity"], seen["wrench_validity"], seen["powered"], seen["trouble"]) == (VALID, VALID, 1, 0)
    np.testing.assert_allclose(seen["axis_angle_rad"] - before, 10 * TICK_RAD * np.arange(1, 9), atol=1.1 * TICK_RAD)
    np.testing.assert_allclose(whole.bench.command_v, 0.1 * np.arange(1, 9), atol=2e-4)
    assert whole.bench.enabled.all()
    whole.actuators["power"] = 0
    whole.run()
    np.testing.assert_allclose(whole.bench.command_v, 0.0, atol=2e-4)
    assert not whole.bench.enabled.any()


@pytest.mark.parametrize(
    ("fault", "value", "wrench", "trouble", "latency_ticks"),
    [
        ("stale_channel", 4, FROZEN, Trouble.GAUGE_FROZEN, range(18, 22)),
        ("input_rail", 2, SATURATED, Trouble.GAUGE_SATURATED, range(1, 2)),
        ("adc_never_done", 1, INVALID, Trouble.ADC_NOT_DONE, range(1, 2)),
        ("reference_drift", 0.02, INVALID, Trouble.ADC_REFERENCE, range(1, 2)),
    ],
)
def test_a_converters_fault_takes_the_wrench_and_leaves_the_axes(whole, fault, value, wrench, trouble, latency_ticks):
    whole.inject(fault, value)
    assert whole.ticks_until(lambda s: s["wrench_validity"] != VALID) in latency_ticks
    seen = whole.sensors[0]
    assert (seen["wrench_validity"], seen["trouble"], seen["axes_validity"]) == (wrench, trouble, VALID)
    assert np.isnan(seen["wrench_in_sensor"]).all()
    whole.inject(fault, 0)
    assert whole.ticks_until(lambda s: s["wrench_validity"] == VALID and not s["trouble"]) <= 10


def test_a_lost_card_takes_its_axes(whole):
    whole.inject("signature", 0xFFFF, "card_b")
    seen = whole.run()
    assert (seen["axes_validity"], seen["wrench_validity"], seen["trouble"]) == (INVALID, VALID, Trouble.CARD_LOST)
    assert np.isnan(seen["axis_angle_rad"]).all()
    assert seen["trouble_device"] == 1


def test_a_counters_illegal_step_is_the_axis_fault(whole):
    whole.inject("ecap", 3, "card_b")
    seen = whole.run()
    assert (seen["trouble"], seen["trouble_value"], seen["axes_validity"]) == (Trouble.ENCODER_ERROR, 6, INVALID)


def test_a_silent_process_loses_its_enables_but_not_its_set_values(whole):
    """Nobody reads or writes for 20 ms: the watchdogs of the cards open the chain, the outputs hold."""
    for _ in range(25):
        whole.now += 1
        for emulated in whole.station.emulators.values():
            emulated.sense(whole.now, whole.bench)
            emulated.drive(whole.now, whole.bench)
    assert not whole.bench.enabled.any()
    np.testing.assert_allclose(whole.bench.command_v, 0.1 * np.arange(1, 9), atol=2e-4)


def test_power_comes_back_only_after_it_was_given_up(whole):
    whole.inject("stop_petting")
    whole.run(25)
    assert not whole.bench.enabled[:4].any()
    whole.inject("stop_petting", 0)
    whole.run(5)
    assert not whole.bench.enabled[:4].any()
    whole.actuators["power"] = 0
    whole.run(2)
    whole.actuators["power"] = 1
    whole.run(2)
    assert whole.bench.enabled.all()


def test_closing_takes_power_and_set_values_away(whole):
    whole.backend.close()
    for name in CARDS:
        card = whole.station.emulators[name]
        assert [card.output_v(k) for k in range(4)] == pytest.approx([0.0] * 4, abs=2e-4)
        assert not any(card.line_out(k) for k in range(4))
