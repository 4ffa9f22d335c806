"""The law in the tick, fed sample by sample: which pairs count, when it stands still, and how it moves the stylet."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hal.frames import FROZEN, VALID
from hal.kernel import kernel
from rtctl.controller import Controller
from rtctl.guidance.impedance import jacobian, law
from rtctl.guidance.impedance.layout import CONFIRMING, CORRECTING, MEASURING, MOVING, READY
from rtctl.lifecycle import TABLE, Condition, Motion, Operating, Reaction, Task
from rtctl.settings import load

PAIRS, PERIOD_TICKS = 21, 70
SWEEP_TICKS = PAIRS * PERIOD_TICKS
BIAS = [100.0 + 10.0 * k for k in range(PAIRS)]
SILENT, UNUSABLE, LOST = Condition.IMPEDANCE_SILENT, Condition.IMPEDANCE_UNUSABLE, Condition.IMPEDANCE_LOST
FAR_OHM, NEAR_OHM = 1500.0, 2500.0


@kernel
def one_tick(memory, record):
    law.listen(memory[0], record[0])
    law.guide(memory[0], record[0])


@kernel
def step_of(memory, z, baseline, usable, gamma):
    parameters = memory[0].parameters.impedance_law
    jacobian.approach_rates(
        parameters.modal_matrix, memory[0].state.stylet_reference_mm, parameters.place_mm, memory[0].pairs.gain
    )
    return jacobian.stylet_step(parameters, memory[0].pairs.gain, z, baseline, usable, gamma)


class Insertion:
    """The law, a telemetry that says what it is told, and a stylet that follows at once."""

    def __init__(self, *overrides):
        chosen = load("planar-sim", [f"impedance.bias_ohm={BIAS}", "impedance.guidance=true", *overrides])
        self.settings = chosen
        controller = Controller(chosen)
        self.memory, self.record = controller.memory, controller.record
        self.state, self.pairs, r = controller.memory["state"][0], controller.memory["pairs"][0], controller.record[0]
        self.now = r
        self.z_ohm = np.full(PAIRS, NEAR_OHM)
        self.raw = {}
        self.sends = True
        self.ticks = 0
        self.planned_mm = 5.0
        r["impedance_pair"], r["impedance_age_ticks"] = -1, 2**31 - 1
        self.state["operating"], self.state["on_path"] = Operating.ENABLED, 1
        self.begin(Task.INSERTING)
        self.extra, self.seen = [], []

    def begin(self, task):
        moves = {Task.INSERTING: Motion.INSERT, Task.RETRACTING: Motion.RETRACT}
        self.state["task"], self.state["motion"] = task, moves.get(task, Motion.HOLD)

    @property
    def depth_mm(self):
        return float(self.state["setpoint"][3])

    def tick(self, advance_mm=0.0):
        self.ticks += 1
        r, state = self.now, self.state
        state["tick"] = r["tick"] = self.ticks
        state["setpoint"][3] += advance_mm
        r["impedance_age_ticks"] = min(int(r["impedance_age_ticks"]) + 1, 2**31 - 1)
        if self.sends and self.ticks % PERIOD_TICKS == 0:
            k = self.ticks // PERIOD_TICKS % PAIRS
            r["impedance_ohm"] = self.raw.get(k, self.z_ohm[k] + BIAS[k])
            r["impedance_pair"], r["impedance_age_ticks"], r["impedance_validity"] = k, 0, VALID
            r["impedance_sequence"] += 1
        r["stylet_desired_mm"] = self.planned_mm
        r["condition_active"], r["condition_reported"] = 0, -1
        one_tick(self.memory, self.record)
        state["stylet_reference_mm"] = max(self.planned_mm + state["stylet_extra_mm"], state["stylet_reference_mm"])
        self.extra.append(float(state["stylet_extra_mm"]))
        self.seen.append(int(r["condition_active"]))

    def insert(self, to_mm, speed_mm_per_s=1.0):
        while self.depth_mm < to_mm - 1e-9:
            self.tick(min(speed_mm_per_s * 1e-3, to_mm - self.depth_mm))
        return self

    def wait(self, ticks):
        for _ in range(ticks):
            self.tick()
        return self

    @property
    def usable(self):
        return {k for k in range(PAIRS) if int(self.now["impedance_usable"]) >> k & 1}

    def holds(self, condition):
        return bool(self.seen[-1] >> condition & 1)


def deep(*overrides, depth_mm=15.0):
    """An insertion that has been at a depth for more than a sweep, with everything inside read."""
    insertion = Insertion(*overrides)
    insertion.state["setpoint"][3] = depth_mm - 0.75
    insertion.wait(SWEEP_TICKS + PERIOD_TICKS)
    insertion.insert(depth_mm)
    insertion.seen.clear()
    return insertion


@pytest.fixture(scope="module")
def warm():
    """Everything is compiled."""
    return Insertion().wait(2)


pytestmark = pytest.mark.usefixtures("warm")


def test_while_it_is_off_it_touches_nothing_and_says_so():
    off = Insertion("impedance.guidance=false")
    before = off.memory.tobytes()
    off.tick()
    off.state["tick"] = off.state["stylet_reference_mm"] = 0
    assert off.memory.tobytes() == before
    assert math.isnan(off.now["impedance_step_mm"])
    assert math.isnan(off.now["impedance_jacobian_norm"])
    assert (off.now["impedance_offset_mm"], off.now["impedance_usable"], off.now["impedance_phase"]) == (0.0, 0, 0)


def test_pairs_inside_the_cochlea_guide_and_no_others():
    assert deep(depth_mm=15.0).usable == set(range(PAIRS))
    inside = 0.6 + 0.62 * np.arange(22) < 6.0
    assert deep(depth_mm=6.0).usable == {k for k in range(PAIRS) if inside[k + 1]}


def test_steady_impedances_ask_for_nothing():
    insertion = deep(depth_mm=8.0).insert(15.0)
    assert insertion.extra[-1] == 0.0
    assert insertion.now["impedance_step_mm"] == 0.0
    assert insertion.now["impedance_jacobian_norm"] > 0.0
    assert not any(insertion.seen)


def test_a_change_acts_once_however_many_evaluations_it_takes_to_see_it():
    """Pair by pair over three evaluations, and all at once: the same withdrawal."""
    insertion = deep(depth_mm=8.0)
    was, lost = insertion.z_ohm.copy(), 10.0
    insertion.z_ohm = was - lost
    insertion.insert(12.0)
    usable = sum(1 << k for k in range(PAIRS) if 0.6 + 0.62 * (k + 1) < 8.0)  # these were known before it came
    at_once, _ = step_of(insertion.memory, was - lost, was, usable, 1.0)
    diluted, _ = step_of(insertion.memory, was - lost, was, (1 << 19) - 1, 1.0)
    assert 0.0 < diluted <= insertion.extra[-1] <= 1.1 * at_once
    assert insertion.extra[-1] == pytest.approx(insertion.now["impedance_offset_mm"])


def test_a_gain_of_impedance_pushes_nothing_back():
    insertion = deep(depth_mm=8.0)
    insertion.z_ohm += 300.0
    assert insertion.insert(12.0).extra[-1] == 0.0


def test_the_step_is_spread_over_the_next_interval():
    insertion = deep(depth_mm=9.0)
    insertion.z_ohm -= 30.0
    insertion.wait(SWEEP_TICKS + PERIOD_TICKS).insert(9.5)
    step, before = float(insertion.now["impedance_step_mm"]), insertion.extra[-1]
    assert step > 0.0
    insertion.insert(9.75)
    assert insertion.extra[-1] - before == pytest.approx(step / 2.0, rel=0.02)
    insertion.insert(10.0 - 1e-6)
    assert insertion.extra[-1] - before == pytest.approx(step, rel=0.02)
    held = insertion.wait(500).extra[-500:]
    assert max(held) == min(held), "it rests with the depth"


def test_before_the_ramp_it_only_watches():
    insertion = deep(depth_mm=3.0)
    insertion.z_ohm -= 300.0
    insertion.insert(4.0 - 1e-6)
    assert insertion.extra[-1] == 0.0
    assert not any(insertion.seen)


@pytest.mark.parametrize("raw", [28_800.0, 20_000.0, math.inf, math.nan, 20.0, 499.0, 0.0, -5.0], ids=str)
def test_an_open_a_shorted_and_a_senseless_pair_are_left_out_and_come_back(raw):
    insertion = deep()
    insertion.raw = {4: raw}
    insertion.wait(SWEEP_TICKS + PERIOD_TICKS)
    assert insertion.usable == set(range(PAIRS)) - {4}
    insertion.raw = {}
    insertion.wait(SWEEP_TICKS + PERIOD_TICKS)
    assert insertion.usable == set(range(PAIRS))


def test_a_pair_that_comes_back_is_not_compared_with_what_it_was_before():
    insertion = deep(depth_mm=10.0)
    insertion.raw = {2: 28_800.0}
    insertion.insert(12.0)
    insertion.raw = {2: 1200.0 + BIAS[2]}
    assert insertion.insert(14.0).extra[-1] == 0.0


def test_a_pair_left_out_by_the_settings_never_guides():
    insertion = deep("impedance.left_out=[0, 7]")
    assert insertion.usable == set(range(PAIRS)) - {0, 7}


def test_a_noisy_pair_is_left_out_and_an_approach_of_the_wall_is_no_noise():
    insertion = deep()
    random = np.random.default_rng(4)
    for sweep in range(8):
        insertion.z_ohm = NEAR_OHM + random.normal(0.0, 150.0, PAIRS)
        insertion.z_ohm[3] = NEAR_OHM + random.normal(0.0, 2500.0)
        insertion.z_ohm[9] = 1500.0 + 1000.0 * sweep
        insertion.raw = {3: 3000.0 + (1000.0 if sweep % 2 else -1000.0)}
        insertion.wait(SWEEP_TICKS)
    assert insertion.usable == set(range(PAIRS)) - {3}
    rms = np.sqrt(insertion.pairs["noise_ohm2"])
    assert rms[3] > 800.0
    assert rms[9] == 0.0
    assert np.median(np.delete(rms, [3, 9])) < 300.0


def test_a_stale_pair_is_left_out():
    insertion = deep()
    insertion.sends = False
    insertion.wait(2000)
    fresh = {k for k in range(PAIRS) if insertion.ticks - insertion.pairs["sample_tick"][k] <= 2800}
    assert 0 < len(fresh) < PAIRS
    assert insertion.usable == fresh


def test_silence_ends_guidance_says_so_and_begins_anew():
    insertion = deep(depth_mm=9.0)
    insertion.sends = False
    insertion.insert(9.0 + 0.42)
    assert not insertion.holds(SILENT)
    insertion.insert(10.2)
    assert insertion.holds(SILENT)
    assert not insertion.holds(LOST)
    assert (insertion.now["condition_value"], insertion.now["condition_bound"]) != (0.0, 0.0)
    insertion.sends = True
    insertion.z_ohm -= 300.0
    insertion.insert(11.4)
    assert not insertion.holds(SILENT)
    assert insertion.extra[-1] < 0.9, "what was lost in the dark is known only for pairs read before and after it"


def test_a_frozen_telemetry_is_silence():
    insertion = deep(depth_mm=9.0)
    insertion.sends = False
    insertion.now["impedance_validity"] = FROZEN
    insertion.insert(9.1)
    assert insertion.holds(SILENT)


def test_too_few_pairs_are_told_with_their_number():
    insertion = deep(depth_mm=9.0)
    insertion.raw = dict.fromkeys(range(2, PAIRS), 28_800.0)
    insertion.z_ohm -= 300.0
    insertion.insert(11.0)
    assert insertion.holds(UNUSABLE)
    assert insertion.now["condition_active"] == 1 << UNUSABLE
    assert insertion.now["impedance_step_mm"] == 0.0


@pytest.mark.parametrize("cause", ["silent", "open"])
def test_it_can_be_asked_to_pause_when_blind(cause):
    insertion = deep("impedance.when_blind=pause", depth_mm=9.0)
    if cause == "silent":
        insertion.sends = False
    insertion.raw = dict.fromkeys(range(PAIRS), 28_800.0)
    insertion.insert(11.0)
    assert insertion.holds(LOST)
    assert insertion.now["condition_reported"] in (LOST, SILENT, UNUSABLE)
    assert TABLE[LOST].reaction is Reaction.PAUSE
    assert TABLE[SILENT].reaction is TABLE[UNUSABLE].reaction is Reaction.NOTE


def test_a_retraction_starts_over():
    insertion = deep(depth_mm=10.0)
    insertion.begin(Task.RETRACTING)
    insertion.z_ohm -= 400.0
    insertion.wait(SWEEP_TICKS)
    insertion.begin(Task.INSERTING)
    assert insertion.insert(12.0).extra[-1] == 0.0


def test_a_paused_or_disabled_controller_is_not_guided():
    insertion = deep(depth_mm=10.0)
    insertion.z_ohm -= 400.0
    insertion.state["operating"] = Operating.PAUSED
    insertion.insert(12.0)
    assert insertion.extra[-1] == 0.0


def test_with_pairs_two_apart_there_are_twenty():
    insertion = deep("impedance.pair_step=2", f"impedance.bias_ohm={BIAS[:20]}")
    assert insertion.usable == set(range(20))
    assert insertion.pairs["z_ohm"][19] == pytest.approx(NEAR_OHM)


class TestStepwise:
    """Rest, measure, correct, measure again, go on."""

    MODE = "impedance.mode=stepwise"

    def at_rest(self, depth_mm=9.0):
        insertion = deep(self.MODE, depth_mm=depth_mm)
        insertion.begin(Task.HOLDING)
        return insertion

    def test_the_first_rest_gives_the_baseline(self):
        insertion = self.at_rest().wait(5)
        assert insertion.now["impedance_phase"] == MEASURING
        insertion.wait(SWEEP_TICKS - PERIOD_TICKS)
        assert insertion.now["impedance_phase"] == MEASURING, "not before every pair has been read at rest"
        insertion.wait(PERIOD_TICKS)
        assert insertion.now["impedance_phase"] == READY
        assert insertion.pairs["baseline_ohm"][:13] == pytest.approx(NEAR_OHM)
        assert insertion.extra[-1] == 0.0

    def corrected(self, drop_ohm=30.0):
        insertion = self.at_rest().wait(SWEEP_TICKS + PERIOD_TICKS)
        insertion.begin(Task.INSERTING)
        insertion.z_ohm -= drop_ohm
        insertion.insert(10.0)
        assert insertion.extra[-1] == 0.0, "nothing is corrected in passing"
        assert insertion.now["impedance_phase"] == MOVING
        insertion.begin(Task.HOLDING)
        return insertion

    def test_a_loss_is_corrected_once_by_the_step_of_all_pairs(self):
        insertion = self.corrected()
        was = np.full(PAIRS, NEAR_OHM)
        stylet = insertion.state["stylet_reference_mm"].copy()
        known = sum(1 << k for k in range(PAIRS) if 0.6 + 0.62 * (k + 1) < 9.0)
        expected, _ = step_of(insertion.memory, was - 30.0, was, known, 1.0)
        phases = []
        for _ in range(3 * SWEEP_TICKS):
            insertion.tick()
            phases.append(int(insertion.now["impedance_phase"]))
        order = [p for i, p in enumerate(phases) if i == 0 or phases[i - 1] != p]
        assert order == [MEASURING, CORRECTING, CONFIRMING, READY]
        assert insertion.extra[-1] == pytest.approx(expected, rel=1e-12)
        assert insertion.state["stylet_reference_mm"] == pytest.approx(stylet + expected)
        assert SWEEP_TICKS - PERIOD_TICKS <= phases.count(CONFIRMING) <= SWEEP_TICKS + PERIOD_TICKS

    def test_the_next_baseline_is_what_is_read_after_the_correction(self):
        insertion = self.corrected()
        while insertion.now["impedance_phase"] != CONFIRMING:
            insertion.tick()
        insertion.z_ohm += 100.0  # as if it had helped
        insertion.wait(SWEEP_TICKS + PERIOD_TICKS)
        assert insertion.now["impedance_phase"] == READY
        assert insertion.pairs["baseline_ohm"][:13] == pytest.approx(NEAR_OHM + 70.0)

    def test_who_does_not_wait_gets_no_correction_from_half_a_sweep(self):
        insertion = self.corrected().wait(SWEEP_TICKS // 2)
        insertion.begin(Task.INSERTING)
        insertion.insert(11.0)
        insertion.begin(Task.HOLDING)
        insertion.wait(2 * SWEEP_TICKS + PERIOD_TICKS)
        assert insertion.now["impedance_phase"] == READY
        assert insertion.extra[-1] == 0.0

    def test_a_silent_telemetry_is_told_and_waited_for(self):
        insertion = self.corrected()
        insertion.sends = False
        insertion.wait(3 * SWEEP_TICKS)
        assert insertion.holds(SILENT)
        assert insertion.now["impedance_phase"] == MEASURING
        insertion.sends = True
        insertion.wait(3 * SWEEP_TICKS)
        assert insertion.now["impedance_phase"] == READY

    def test_dead_pairs_are_told_and_nothing_is_corrected(self):
        insertion = self.corrected()
        insertion.raw = dict.fromkeys(range(PAIRS), 28_800.0)
        insertion.wait(SWEEP_TICKS + PERIOD_TICKS)
        assert any(active >> UNUSABLE & 1 for active in insertion.seen)
        assert insertion.extra[-1] == 0.0


reading = st.one_of(
    st.floats(-1e6, 1e6), st.floats(1100.0, 6000.0), st.sampled_from([math.nan, math.inf, 28_800.0, 0.0])
)


@settings(max_examples=15)
@given(sweeps=st.lists(st.lists(reading, min_size=PAIRS, max_size=PAIRS), min_size=3, max_size=3))
def test_whatever_is_read_the_stylet_only_comes_out_and_never_faster_than_the_limit(sweeps):
    insertion = deep(depth_mm=8.0)
    for readings in sweeps:
        insertion.raw = dict(enumerate(readings))
        insertion.insert(insertion.depth_mm + SWEEP_TICKS * 1e-3)
    extra = np.array(insertion.extra)
    assert np.isfinite(extra).all()
    steps = np.diff(extra)
    assert (steps >= 0.0).all()
    assert steps.max() <= 1.02 * 1e-3 * 1.0 / 0.5
