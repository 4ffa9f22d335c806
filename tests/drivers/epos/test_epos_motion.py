"""Every mode moves its axis as it is commanded, and the backend keeps its promises with drives behind it."""

from itertools import pairwise

import numpy as np
import pytest

from hal.conformance import CHECKS
from hal.frames import VALID
from hal.troubles import Trouble


@pytest.mark.parametrize("direction", [1, -1])
@pytest.mark.parametrize("mode", ["csp", "ppm", "position", "velocity"])
def test_a_command_is_a_speed_where_the_drive_closes_the_loop(rig, mode, direction):
    r = rig.make(rig.bus(rig.node(1, 0, mode, direction=direction)))
    r.power_up()
    start = float(r.run(100, 1.0)["axis_angle_rad"][0])
    s = r.run(500, 1.0)
    assert s["axis_angle_rad"][0] - start == pytest.approx(5.0, rel=0.03)  # 10 rad/s a volt
    assert np.sign(r.node(1).drive.loops.rotor.rate_rad_per_s) == direction
    assert (s["trouble"], s["axes_validity"]) == (Trouble.NONE, VALID)


@pytest.mark.parametrize("direction", [1, -1])
@pytest.mark.parametrize("mode", ["cst", "current"])
def test_a_command_is_a_current_where_the_controller_closes_it(rig, mode, direction):
    r = rig.make(rig.bus(rig.node(1, 0, mode, direction=direction)))
    r.power_up()
    r.run(20, 3.0)
    assert r.bench.command_v[0] == pytest.approx(3.0, abs=0.02)  # of the bench's amplifier, as of our own
    s = r.run(100, 3.0)
    assert s["axis_angle_rad"][0] > 0.5
    assert s["axis_angle_rad"][0] == pytest.approx(r.bench.angle_rad[0], rel=0.1)


def test_a_position_loop_closed_over_the_bus_settles(rig):
    """PD on the angle, five axes, 500 Hz: the use that CST is for."""
    r = rig.make(rig.bus(*[rig.node(i + 1, i, direction=(-1) ** i) for i in range(5)]))
    r.power_up()
    goal, last = np.linspace(-1.0, 1.0, 5), r.sensors[0]["axis_angle_rad"].copy()
    for _ in range(600):
        s = r.sensors[0]
        rate = (s["axis_angle_rad"] - last) / 1e-3
        last = s["axis_angle_rad"].copy()
        r.step(np.clip(8.0 * (goal - last) - 0.35 * rate, -10.0, 10.0))
    assert r.sensors[0]["axis_angle_rad"] == pytest.approx(goal, abs=0.05)


def test_samples_are_counted_and_age_between_exchanges(rig):
    r = rig.make(rig.bus(rig.node(1, 0), divisor=4))
    r.run(20, power=0)
    seen = [(int(s["axes_sequence"]), int(s["axes_age_ticks"])) for s in (r.step(power=0) for _ in range(8))]
    ages = [age for _, age in seen]
    assert sorted(set(ages)) == [1, 2, 3, 4]
    for (sequence, age), (after, older) in pairwise(seen):
        assert (after, older) == ((sequence + 1, 1) if age == 4 else (sequence, age + 1))


def test_power_is_told_to_go_at_once_between_exchanges(rig):
    r = rig.make(rig.bus(rig.node(1, 0), divisor=50, heartbeat_ms=100))
    r.power_up(limit=500)
    while r.device._link.sync_tick != r.tick - 1:
        r.step()
    r.step(power=0)
    for _ in range(5):
        r.step(power=0)
    assert not r.bench.enabled.any()


def test_a_motor_at_speed_is_braked_along_the_ramp(rig):
    """4000 rad/s^2 takes 100 rad/s away in 25 ms; coasting would take much longer."""
    r = rig.make(rig.bus(rig.node(1, 0, "velocity")))
    r.power_up()
    r.run(300, 10.0)
    loops = r.node(1).drive.loops
    assert loops.rotor.rate_rad_per_s == pytest.approx(100.0, rel=0.05)
    r.run(10, power=0)
    assert r.node(1).drive.state.name == "QUICK_STOP"
    assert loops.rotor.rate_rad_per_s > 30.0
    r.run(60, power=0)
    assert r.node(1).drive.state.name == "DISABLED"
    assert abs(loops.rotor.rate_rad_per_s) < 2.0


def test_a_quick_stop_that_takes_too_long_loses_its_voltage(rig):
    r = rig.make(rig.bus(rig.node(1, 0, "velocity", quick_stop_rad_per_s2=10.0), quick_stop_ms=50))
    r.power_up()
    r.run(300, 10.0)
    r.run(45, power=0)
    assert r.node(1).drive.power_stage
    r.run(15, power=0)
    assert not r.node(1).drive.power_stage


@pytest.mark.parametrize("mode", ["cst", "csp", "velocity"])
@pytest.mark.parametrize("check", CHECKS, ids=lambda c: c.__name__)
def test_the_backend_keeps_its_promises(rig, check, mode):
    made = []

    def make():
        made.append(rig.make(rig.bus(rig.node(1, 0, mode), rig.node(2, 1, mode)), open_it=False))
        return Alive(made[-1])

    check(make)


class Alive:
    """The backend of a rig whose bench goes on whenever the tick does."""

    def __init__(self, r):
        self._rig = r

    def __getattr__(self, name):
        return getattr(self._rig.backend, name)

    def read(self, tick, sensors):
        r = self._rig
        for emulator in r.emulators:
            emulator.drive(tick, r.bench)
            emulator.sense(tick, r.bench)
        r.backend.read(tick, sensors)
