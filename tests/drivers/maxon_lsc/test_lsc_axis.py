"""One axis through its real driver: angles, power, and every row of the failure table that concerns it."""

import math
import re
import tomllib
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from drivers.maxon_lsc import watch
from drivers.maxon_lsc.device import LscAxis
from drivers.maxon_lsc.state import AXIS
from hal.errors import BackendError, OptionError
from hal.frames import INVALID, VALID
from hal.troubles import TABLE, Grade, Trouble
from sim_backends.emulators.lsc import EmulatedLsc

TABLE_OF_AXIS = {
    "axis": 0, "card": "card", "counter": 1, "output": 2, "enable_line": 0, "ready_line": 5,
    "lines": 500, "gear": 14.0, "max_speed_rad_per_s": 60.0,
    "mode": "current", "gain_a_per_v": 0.2, "continuous_a": 0.8, "peak_a": 1.6, "thermal_s": 10.0,
}  # fmt: skip
COUNTS_PER_RAD = 4 * 500 * 14 / math.tau


class Motor:
    """Inertia, dry and viscous friction; torque in volts of set value: 0.6 V overcome the friction."""

    def __init__(self, load_v=0.0):
        self.speed, self.load_v = 0.0, load_v

    def __call__(self, bench):
        for _ in range(10):
            push = (bench.command_v[0] if bench.enabled[0] else 0.0) + self.load_v - 0.15 * self.speed
            friction = 0.6 * np.sign(self.speed) if self.speed else np.clip(push, -0.6, 0.6)
            new = self.speed + (push - friction) * 300.0 * 1e-4
            self.speed = 0.0 if self.speed * new < 0 and abs(push) <= 0.6 else new
            bench.angle_rad[0] += self.speed * 1e-4


@pytest.fixture
def rig(lockstep):
    rig = lockstep()
    rig.axis, rig.amplifier = rig.add(LscAxis, EmulatedLsc, "axis", TABLE_OF_AXIS)
    rig.physics = Motor()
    return rig


def test_angle_is_that_of_the_shaft_since_opened_in_both_directions(lockstep):
    for encoder in (1, -1):
        for command in (1, -1):
            rig = lockstep()
            rig.bench.angle_rad[0] = 123.0
            rig.add(
                LscAxis,
                EmulatedLsc,
                "axis",
                {**TABLE_OF_AXIS, "encoder_direction": encoder, "command_direction": command},
            )
            rig.physics = Motor()
            for _ in range(300):
                r = rig.step(3.0, True)
                assert r.axis_validity[0] == VALID
                assert r.axis_angle_rad[0] == pytest.approx(rig.bench.angle_rad[0] - 123.0, abs=1.01 / COUNTS_PER_RAD)
            assert r.axis_angle_rad[0] > 1.0
            assert (r.axis_sequence[0], r.axis_age_ticks[0], r.trouble) == (300, 0, 0)


def test_axes_of_one_card_do_not_mix(lockstep):
    """Two axes with counters and lines crosswise; one fails, the other is opened later, and turns on."""
    rig = lockstep(axes=2)
    rig.bench.angle_rad[:] = [7.0, -3.0]
    table = {**TABLE_OF_AXIS, "gain_a_per_v": 0.1}
    rig.add(LscAxis, EmulatedLsc, "first", {**table, "axis": 1})
    _, other = rig.add(
        LscAxis,
        EmulatedLsc,
        "second",
        {**table, "axis": 0, "counter": 3, "output": 0, "enable_line": 1, "ready_line": 4, "encoder_direction": -1},
    )
    rig.physics = lambda bench: bench.angle_rad.__iadd__(0.01 * bench.command_v * bench.enabled)
    r = rig.step([2.0, -3.0], True)
    assert r.axis_angle_rad.tolist() == [0.0, 0.0]
    rig.steps(100, [2.0, -3.0], True)
    assert rig.readings.axis_angle_rad == pytest.approx(rig.bench.angle_rad - [7.0, -3.0], abs=1.1 / COUNTS_PER_RAD)
    assert (rig.readings.axis_angle_rad * [1, -1] > 1.0).all()
    other.inject("overheat")
    rig.steps(3, [2.0, -3.0], True)
    assert rig.bench.enabled.tolist() == [False, True]
    assert (rig.readings.axis_fault.tolist(), rig.readings.axis_powered.tolist()) == ([True, False], [False, True])
    assert (rig.readings.trouble, rig.readings.trouble_value, rig.readings.trouble_device) == (
        Trouble.AMPLIFIER_NOT_READY,
        0,
        2,
    )


def test_old_counts_say_that_they_are_old(rig):
    rig.steps(5)
    rig.site.devices["card"].silent = True
    ages = [int(rig.step().axis_age_ticks[0]) for _ in range(3)]
    assert ages == [1, 2, 3]
    rig.site.devices["card"].count_validity[1] = INVALID
    r = rig.step()
    assert r.axis_validity[0] == INVALID
    assert math.isnan(r.axis_angle_rad[0])


def test_power_is_enable_and_nothing_moves_without_it(rig):
    rig.steps(5, 4.0, False)
    assert rig.bench.command_v[0] == 0.0
    assert not rig.bench.enabled[0]
    rig.step(4.0, True)
    assert rig.bench.enabled[0]
    assert rig.bench.command_v[0] == 4.0
    assert rig.step(4.0, True).axis_powered[0]
    rig.axis.close()
    rig.site.devices["card"].close()
    rig.amplifier.drive(rig.tick, rig.bench)
    assert (rig.bench.command_v[0], bool(rig.bench.enabled[0])) == (0.0, False)


def test_power_waits_for_an_amplifier_that_says_ready(rig):
    assert not rig.step(1.0, True).axis_powered[0]
    assert not rig.bench.enabled[0], "one read of Ready is not enough"
    rig.step(1.0, True)
    assert rig.bench.enabled[0]


@pytest.mark.parametrize("fault", ["not_ready", "overheat"])
def test_ready_open_drops_enable_after_two_reads_and_stays_down(rig, fault):
    rig.steps(50, 3.0, True)
    rig.amplifier.inject(fault)
    assert not rig.step(3.0, True).axis_fault[0], "one read may be a disturbance"
    r = rig.step(3.0, True)
    assert (r.trouble, r.trouble_value) == (Trouble.AMPLIFIER_NOT_READY, 0)
    assert r.axis_fault[0]
    assert not r.axis_powered[0]
    assert (rig.bench.command_v[0], bool(rig.bench.enabled[0])) == (0.0, False)
    rig.amplifier.inject(fault, 0)
    assert rig.steps(20, 3.0, True) == {Trouble.AMPLIFIER_NOT_READY, 0}
    assert not rig.bench.enabled[0], "it does not come back by itself"
    assert not rig.step(3.0, True).axis_fault[0]
    rig.step(0.0, False)
    rig.step(3.0, True)
    assert rig.bench.enabled[0]


def test_a_disturbance_of_one_read_is_no_fault(rig):
    rig.steps(20, 1.0, True)
    for _ in range(20):
        rig.amplifier.inject("not_ready")
        assert not rig.step(1.0, True).axis_fault[0]
        rig.amplifier.inject("not_ready", 0)
        assert rig.step(1.0, True).axis_powered[0]


def test_a_cut_encoder_is_found_50_ms_after_the_last_count(rig):
    rig.steps(100, 3.0, True)
    rig.amplifier.inject("encoder_cut")
    ticks = rig.until(lambda r: r.trouble == Trouble.ENCODER_STALLED, 3.0, True)
    assert 50 <= ticks <= 51
    assert TABLE[Trouble.ENCODER_STALLED].grade == Grade.FAULT
    assert rig.step(0.0, False).trouble == Trouble.ENCODER_STALLED, "the command was still there"
    assert rig.steps(100) == {0}


def test_a_set_value_that_does_not_arrive_stalls_too(rig):
    rig.amplifier.inject("command_open")
    assert 50 <= rig.until(lambda r: r.trouble == Trouble.ENCODER_STALLED, 3.0, True) <= 54


def test_pushing_an_end_stop_below_breakaway_is_no_stall(rig):
    rig.physics = None
    assert rig.steps(1000, 1.5, True) == {0}
    assert Trouble.ENCODER_STALLED in rig.steps(60, 2.5, True)


def test_one_channel_left_that_dithers_is_a_stall(rig):
    rig.steps(100, 3.0, True)

    def dither(bench):
        bench.angle_rad[0] = (1000 + rig.tick % 2) / COUNTS_PER_RAD

    rig.bench.angle_rad[0] = 1000 / COUNTS_PER_RAD
    rig.physics = dither
    rig.step(0.0, True)
    assert Trouble.ENCODER_STALLED in rig.steps(60, 3.0, True)


@pytest.mark.parametrize("command_v", [2.5, -8.0])
def test_an_inverted_encoder_is_found_as_soon_as_the_window_is_full(rig, command_v):
    rig.steps(10)
    rig.amplifier.inject("encoder_inverted")
    ticks = rig.until(lambda r: r.trouble == Trouble.WRONG_WAY, command_v, True)
    assert ticks <= 25
    assert abs(rig.bench.angle_rad[0]) < 2.0


def test_an_inverted_encoder_in_a_closed_loop_is_found_although_the_command_grows_slowly(rig):
    rig.steps(10)
    rig.amplifier.inject("encoder_inverted")
    reference = integral = command = 0.0
    for _ in range(400):
        r = rig.step(command, True)
        if r.trouble:
            break
        reference += 0.002
        error = reference - r.axis_angle_rad[0]
        integral += 40.0 * error * 0.001
        command = float(np.clip(4.0 * error + integral, -8.0, 8.0))
    assert r.trouble == Trouble.WRONG_WAY
    assert abs(rig.bench.angle_rad[0]) < 6.0, "before the largest following error"


@given(
    st.lists(st.tuples(st.floats(-10, 10), st.integers(1, 80)), min_size=2, max_size=12),
    st.floats(-1.3, 1.3),
    st.integers(0, 3),
)
@settings(max_examples=60, deadline=None)
def test_reversals_and_loads_below_breakaway_never_look_like_the_wrong_way(lockstep, course, load_v, lag):
    """Any commands, inertia, friction, a current that lags by ticks, and a load that breakaway (2 V) overcomes."""
    rig = lockstep()
    rig.add(LscAxis, EmulatedLsc, "axis", {**TABLE_OF_AXIS, "max_speed_rad_per_s": 200.0, "peak_a": 2.0})
    motor, pipe = Motor(load_v), [0.0] * lag

    def lagging(bench):
        pipe.append(bench.command_v[0])
        bench.command_v[0] = pipe.pop(0)
        motor(bench)

    rig.physics = lagging
    for command_v, ticks in course:
        assert Trouble.WRONG_WAY not in rig.steps(ticks, command_v, True)


def test_a_load_that_drives_the_motor_back_evenly_is_not_the_wrong_way(rig):
    def driven_back(bench):
        bench.angle_rad[0] -= 0.01

    rig.physics = driven_back
    assert rig.steps(500, 5.0, True) == {0}


def test_missed_ticks_do_not_make_a_motor_that_comes_back_a_runaway(rig):
    """It slows down evenly, and of every 40 ticks ten are missed: halves of a window would not be of the same length."""
    speed = [0.05]

    def slowing(bench):
        bench.angle_rad[0] -= speed[0]
        speed[0] *= 0.999

    rig.physics = slowing
    rig.steps(10)
    for i in range(300):
        assert rig.step(5.0, True, skip=10 if i % 30 == 14 else 0).trouble == 0


@pytest.mark.parametrize("jump", [400, -400, 2**23])
def test_a_jump_is_invalid_and_counted_from_there(rig, jump):
    rig.steps(50, 3.0, True)
    before = rig.step(0.0, False).axis_angle_rad[0]
    rig.amplifier._count += jump
    r = rig.step()
    assert (r.trouble, r.axis_validity[0]) == (0, INVALID), "not believed, and not judged before the next read"
    r = rig.step()
    assert r.trouble == Trouble.ENCODER_JUMP
    assert r.trouble_value == pytest.approx(jump, abs=120)
    assert r.axis_validity[0] == INVALID
    assert math.isnan(r.axis_angle_rad[0])
    r = rig.step()
    assert (r.trouble, r.axis_validity[0]) == (0, VALID)
    assert r.axis_angle_rad[0] == pytest.approx(before + jump / COUNTS_PER_RAD, abs=0.1)


def test_a_read_that_came_late_is_no_jump_but_only_if_the_next_ticks_were_missed(rig):
    """The machine stalls after the tick has begun: the counts of later, and then a tick number that has jumped."""
    bound = rig.axis.group.state[0]["most_counts"]
    rig.steps(50, 3.0, True)
    rig.amplifier._count += int(4 * bound)  # what the motor may do in the five ticks until the next read
    r = rig.step(3.0, True)
    assert (r.trouble, r.axis_validity[0]) == (0, INVALID)
    r = rig.step(3.0, True, skip=4)
    assert (r.trouble, r.axis_validity[0]) == (0, VALID)
    rig.amplifier._count += int(4 * bound)
    rig.step(3.0, True)
    assert rig.step(3.0, True, skip=1).trouble == Trouble.ENCODER_JUMP, "too far for three ticks"


def test_missed_ticks_are_no_jump(rig):
    rig.steps(100, 8.0, True)
    assert rig.step(8.0, True, skip=30).trouble == 0


def test_a_step_no_encoder_makes_is_a_fault(rig):
    rig.steps(5)
    rig.site.devices["card"].count_error[1] = True
    r = rig.step()
    assert (r.trouble, r.trouble_value, r.axis_validity[0]) == (Trouble.ENCODER_ERROR, 0, INVALID)
    rig.site.devices["card"].count_error[1] = False
    assert rig.step().axis_validity[0] == VALID


@pytest.mark.parametrize(
    ("lost", "trouble"),
    [(2, 0), (3, Trouble.INDEX_DRIFT), (-8, Trouble.INDEX_DRIFT), (9, Trouble.INDEX_LOST), (-999, Trouble.INDEX_LOST)],
)
def test_lost_counts_are_found_at_the_next_index(rig, lost, trouble):
    def turn(bench):
        bench.angle_rad[0] += 40 / COUNTS_PER_RAD  # an index every 50 ticks

    rig.physics = turn
    assert rig.steps(300) == {0}
    card = rig.station.emulators["card"]
    whole, card.set_encoder = card.set_encoder, None

    def shifted(channel, count):
        old = card.encoder[channel]
        whole(channel, count)
        if card.index_sequence[channel] and old // 2000 != count // 2000:
            card.index_count[channel] -= lost  # the counter is `lost` behind the shaft

    card.set_encoder = shifted
    if not trouble:
        assert rig.steps(120) == {0}
        return
    assert rig.until(lambda r: r.trouble == trouble) <= 51
    assert rig.readings.trouble_value == pytest.approx(-lost)
    card.set_encoder = whole
    rig.until(lambda r: r.trouble == 0, most=51)


@pytest.mark.parametrize("counts_a_tick", [40, -40])
def test_an_index_that_comes_no_more_is_told_after_a_turn_and_a_quarter(rig, counts_a_tick):
    def turn(bench):
        bench.angle_rad[0] += counts_a_tick / COUNTS_PER_RAD

    rig.physics = turn
    assert rig.steps(300) == {0}
    card = rig.station.emulators["card"]
    whole, pulses = card.set_encoder, card.index_sequence[1]

    def unwired(channel, count):
        whole(channel, count)
        card.index_sequence[channel] = pulses

    card.set_encoder = unwired
    assert 1.2 * 2000 / 40 - 50 <= rig.until(lambda r: r.trouble == Trouble.INDEX_MISSING) <= 1.25 * 2000 / 40 + 1
    assert rig.readings.trouble_value == TABLE_OF_AXIS["axis"]
    assert rig.readings.axis_validity[0] == VALID
    card.set_encoder = whole
    rig.until(lambda r: r.trouble == 0, most=51)


def test_an_encoder_that_goes_to_and_fro_needs_no_index(rig):
    def swing(bench):
        bench.angle_rad[0] = 0.4 * math.pi / 14 * math.sin(0.1 * rig.tick)

    rig.physics = swing
    assert rig.steps(2000) == {0}


@given(st.integers(1, 5000), st.integers(-20, 20), st.lists(st.integers(-(10**9), 10**9), min_size=1, max_size=5))
def test_index_is_compared_modulo_a_turn(lines, off, turns):
    axis = np.zeros(1, AXIS)[0]
    axis["turn_counts"], axis["index_seen"] = 4 * lines, -1
    watch.take_index(axis, 0, 0)
    watch.take_index(axis, 1, 17)
    for i, n in enumerate(turns):
        watch.take_index(axis, 2 + i, 17 + 4 * lines * n + off)
        assert (axis["index_off_by"] - off) % (4 * lines) == 0
        assert abs(axis["index_off_by"]) <= 2 * lines


def test_motor_gets_hot_as_the_model_says_and_is_folded_back(rig):
    """At 1.6 A of 0.8 A continuous, 1 - exp(-t / tau) = 1/4 after 2.88 s."""
    rig.physics = lambda bench: bench.angle_rad.__iadd__(0.001)
    ticks = rig.until(lambda r: r.trouble == Trouble.MOTOR_HOT, 8.0, True, most=5000)
    assert ticks / 1000 == pytest.approx(-10 * math.log(1 - 0.25), abs=0.01)
    rig.steps(2, 8.0, True)
    assert rig.bench.command_v[0] == pytest.approx(4.0), "no more than the continuous current"
    cooling = rig.until(lambda r: r.trouble == 0, most=5000)
    assert cooling / 1000 == pytest.approx(10 * math.log(1 / 0.9), abs=0.02)


def test_heat_in_voltage_mode_knows_the_back_emf(lockstep):
    rig = lockstep()
    table = {k: v for k, v in TABLE_OF_AXIS.items() if k != "gain_a_per_v"}
    rig.add(
        LscAxis,
        EmulatedLsc,
        "axis",
        {**table, "mode": "voltage", "gain_v_per_v": 2.0, "resistance_ohm": 5.0, "back_emf_v_s_per_rad": 0.4},
    )
    rig.physics = None
    rig.steps(5, 10.0, True)
    assert rig.bench.command_v[0] == pytest.approx(4.0), "1.6 A through 5 ohm, at rest"
    rig.physics = lambda bench: bench.angle_rad.__iadd__(0.03)
    rig.steps(5, 10.0, True)
    assert rig.bench.command_v[0] == pytest.approx((1.6 * 5.0 + 0.4 * 30.0) / 2.0, rel=0.02)
    rig.steps(5, 0.0, True)
    assert rig.bench.command_v[0] == 0.0, "braking by a short is always allowed"


def test_heat_in_speed_mode_counts_the_time_a_motor_does_not_follow(lockstep):
    rig = lockstep()
    table = {k: v for k, v in TABLE_OF_AXIS.items() if k != "gain_a_per_v"}
    rig.add(LscAxis, EmulatedLsc, "axis", {**table, "mode": "speed", "gain_rad_per_s_per_v": 5.0})
    rig.physics = lambda bench: bench.angle_rad.__iadd__(0.005)
    assert rig.steps(4000, 1.0, True) == {0}
    rig.physics = None
    assert Trouble.MOTOR_HOT in rig.steps(3000, 1.0, True)


def test_stylet_drive_is_the_same_kind_with_a_hard_clamp(lockstep):
    rig = lockstep()
    rig.add(
        LscAxis,
        EmulatedLsc,
        "stylet",
        {
            **TABLE_OF_AXIS,
            "lines": 16,
            "index": False,
            "command_limit_v": 3.0,
            "gain_a_per_v": 0.05,
            "continuous_a": 0.05,
            "peak_a": 0.1,
        },
    )
    rig.steps(5, 10.0, True)
    assert rig.bench.command_v[0] == pytest.approx(2.0), "peak current"


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"lines": None}, "lines"),
        ({"counts_per_rad": 100.0}, "either"),
        ({"lines": None, "counts_per_rad": 100.0}, "index"),
        ({"encoder_direction": 0}, "sign"),
        ({"gain_v_per_v": 1.0}, "gain"),
        ({"mode": "speed"}, "gain"),
        ({"resistance_ohm": 1.0}, "voltage"),
        ({"peak_a": 0.1}, "peak_a"),
        ({"command_limit_v": 1.0}, "breakaway"),
        ({"ready_line": 0}, "share"),
        ({"wrong_way_s": 0.5}, "wrong_way_s"),
        ({"counter": 4}, "counter 4"),
        ({"card": "other"}, "not there"),
        ({"colour": "red"}, "unknown"),
    ],
)
def test_settings_that_do_not_fit_are_refused(lockstep, change, says):
    rig = lockstep()
    table = {k: v for k, v in {**TABLE_OF_AXIS, **change}.items() if v is not None}
    with pytest.raises(OptionError, match=says):
        LscAxis("axis", table, rig.site)


def test_the_emulator_knows_its_faults_and_wants_its_card(rig, lockstep):
    with pytest.raises(BackendError, match="no such fault"):
        rig.amplifier.inject("lightning")
    with pytest.raises(BackendError, match="card"):
        EmulatedLsc("axis", TABLE_OF_AXIS, lockstep(card=False).station)


def test_health_and_probe_say_what_is_wired_and_what_was_wrong(rig):
    rig.steps(5)
    assert all(f.good for f in rig.axis.probe())
    rig.amplifier.inject("not_ready")
    rig.steps(5)
    rig.amplifier.inject("not_ready", 0)
    rig.steps(5)
    rig.amplifier.inject("not_ready")
    rig.steps(5)
    assert [f.good for f in rig.axis.probe()] == [False, True]
    health = rig.axis.health()
    assert health.errors == {"amplifier_not_ready": 2}
    assert "counter 1" in health.identity
    assert health.age_ticks == 0


def test_the_settings_of_the_how_to_are_accepted(lockstep):
    page = Path(__file__).parents[3] / "docs" / "how-to" / "wire-lsc-amplifiers.md"
    entries = [
        tomllib.loads(b)["backend"]["options"]["devices"][0]
        for b in re.findall("```toml\n(.*?)```", page.read_text(), re.S)
    ]
    assert len(entries) == 2
    rig = lockstep()
    for entry in entries:
        assert entry.pop("kind") == "lsc_axis"
        rig.site.devices[entry["card"]] = rig.site.devices["card"]
        LscAxis(entry.pop("name"), entry, rig.site)
