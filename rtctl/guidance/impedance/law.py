"""Impedance guidance in the tick: a lost impedance pulls the stylet (04 section 4; D section VII.4).

Both modes look at all pairs at depths so and so far apart, and compare with what they read the time before. The continuous
one does it in passing. A sweep takes longer than an interval, so most pairs have no new sample: those read as they did, and
count in J^T J. Thus every change acts once, and the steps of a sweep add up to the one of all pairs together. The step is
added over the next interval, which is the rate (VII.30) held from one evaluation to the next.

The stepwise one works where the insertion rests: it waits for a whole sweep, adds the step at once, and waits for another,
from which the next changes are counted. Whoever inserts goes on when the phase is READY.
"""

import math

from hal.kernel import kernel
from rtctl.admittance import blend
from rtctl.conditions import raise_condition
from rtctl.guidance.impedance import layout, samples
from rtctl.guidance.impedance.jacobian import approach_rates, stylet_step
from rtctl.hlc import is_resting
from rtctl.lifecycle import Condition, Operating, Task

GRID = 1e-9
"""An interval counts as complete so little before its end; depths are rounded."""
ARRIVED_MM = 1e-9


@kernel
def listen(memory, record):
    """Take the sample of this tick, and say what would be said if nothing were guided."""
    law, store = memory.parameters.impedance_law, memory.pairs
    if law.on and not store.awake:
        samples.forget_samples(store)
        start(store)
    store.awake = law.on
    if law.on:
        samples.take(law, store, record)
    record.impedance_usable = 0
    record.impedance_step_mm = store.step_mm if law.on else math.nan
    record.impedance_jacobian_norm = store.jacobian_ohm_per_mm if law.on else math.nan
    record.impedance_offset_mm = store.offset_mm if law.on else 0.0
    record.impedance_phase = store.phase if law.on else 0


@kernel
def start(store):
    """Another insertion begins: nothing to compare with, and nothing owed to the stylet."""
    store.depth_mm = store.owed_mm = store.rate_mm_per_mm = store.offset_mm = 0.0
    store.evaluated = -1
    store.phase = layout.MOVING
    store.step_mm = store.jacobian_ohm_per_mm = math.nan
    _forget_baseline(store)


@kernel
def guide(memory, record):
    """One tick of the law: adds to the stylet's extra withdrawal, never takes from it."""
    law, store, state = memory.parameters.impedance_law, memory.pairs, memory.state
    if not law.on:
        return
    depth = state.setpoint[state.setpoint.shape[0] - 1]
    if not state.on_path or state.task == Task.RETRACTING:
        start(store)
    elif state.operating == Operating.ENABLED:
        bits, count = samples.usable_pairs(law, store, depth, record.tick)
        if law.mode == layout.CONTINUOUS:
            _guide_in_passing(memory, record, depth, bits, count)
        else:
            _guide_at_rest(memory, record, depth, bits, count)
        record.impedance_usable = bits
    store.depth_mm = depth
    record.impedance_step_mm, record.impedance_offset_mm = store.step_mm, store.offset_mm
    record.impedance_jacobian_norm = store.jacobian_ohm_per_mm
    record.impedance_phase = store.phase


@kernel
def _guide_in_passing(memory, record, depth, bits, count):
    """Continuous mode: evaluate at every multiple of the interval, and add what is owed as the depth grows."""
    law, store, state = memory.parameters.impedance_law, memory.pairs, memory.state
    if state.task != Task.INSERTING:
        return
    gamma = blend(memory.parameters, depth)
    silent = samples.is_silent(law, record)
    if gamma > 0.0 and (silent or count < law.least_pairs):
        _stand_still(memory, record, silent, count)
    interval = math.floor(depth / law.interval_mm + GRID)
    if interval > store.evaluated:
        store.evaluated = interval
        store.owed_mm += _evaluate(memory, record, gamma, silent, bits, count)
        store.rate_mm_per_mm = store.owed_mm / law.interval_mm
    _withdraw(state, store, min(store.rate_mm_per_mm * max(depth - store.depth_mm, 0.0), store.owed_mm))


@kernel
def _guide_at_rest(memory, record, depth, bits, count):
    """Stepwise mode: measure, correct, measure again."""
    law, store, state = memory.parameters.impedance_law, memory.pairs, memory.state
    if state.task == Task.INSERTING:
        if store.phase != layout.MOVING and store.phase != layout.READY:
            _forget_baseline(store)  # nobody waited
        store.phase = layout.MOVING
        return
    if state.task != Task.HOLDING or not is_resting(memory):
        return
    gamma = blend(memory.parameters, depth)
    silent = samples.is_silent(law, record)
    if store.phase == layout.MOVING:
        store.phase, store.rest_tick = layout.MEASURING, record.tick
    elif store.phase == layout.CORRECTING:
        wanted = min(record.stylet_desired_mm + state.stylet_extra_mm, memory.parameters.stylet_stroke_mm)
        if state.stylet_reference_mm >= wanted - ARRIVED_MM:
            store.phase, store.rest_tick = layout.CONFIRMING, record.tick
    elif store.phase != layout.READY:
        if silent and gamma > 0.0:
            _stand_still(memory, record, silent, count)
        if not silent and samples.is_swept(law, store, store.rest_tick):
            _conclude(memory, record, gamma, bits, count)


@kernel
def _conclude(memory, record, gamma, bits, count):
    """A sweep at rest is complete: correct by it, or take it for the baseline."""
    law, store = memory.parameters.impedance_law, memory.pairs
    if store.phase == layout.CONFIRMING:
        _keep_baseline(law, store, bits)
        store.phase = layout.READY
        return
    if gamma > 0.0 and count < law.least_pairs:
        _stand_still(memory, record, False, count)
    step = _evaluate(memory, record, gamma, False, bits, count)
    _withdraw(memory.state, store, step)
    store.phase = layout.CORRECTING if step > 0.0 else layout.READY


@kernel
def _evaluate(memory, record, gamma, silent, bits, count):
    """The step this depth asks for [mm]; 0 wherever too little is known. What was read is the next baseline."""
    law, store, state = memory.parameters.impedance_law, memory.pairs, memory.state
    if silent:
        _forget_baseline(store)
        store.step_mm = store.jacobian_ohm_per_mm = 0.0
        return 0.0
    approach_rates(law.modal_matrix, state.stylet_reference_mm, law.place_mm, store.gain)
    step, size = stylet_step(law, store.gain, store.z_ohm, store.baseline_ohm, bits, gamma)
    _keep_baseline(law, store, bits)
    if not math.isfinite(step):
        _stand_still(memory, record, False, 0)
    store.step_mm = step if math.isfinite(step) and count >= law.least_pairs else 0.0
    store.jacobian_ohm_per_mm = size
    return store.step_mm


@kernel
def _withdraw(state, store, step_mm):
    """Pull the stylet further than planned; the drive's own limits apply where it is followed."""
    state.stylet_extra_mm += step_mm
    store.offset_mm += step_mm
    store.owed_mm = max(store.owed_mm - step_mm, 0.0)


@kernel
def _stand_still(memory, record, silent, count):
    """Say why the law does nothing, and pause if that is wanted."""
    law, state = memory.parameters.impedance_law, memory.state
    value = float(record.impedance_age_ticks) if silent else float(count)
    bound = float(law.link_age_ticks) if silent else float(law.least_pairs)
    why = Condition.IMPEDANCE_SILENT if silent else Condition.IMPEDANCE_UNUSABLE
    raise_condition(state, record, why, value, bound)
    if law.pause_when_blind:
        raise_condition(state, record, Condition.IMPEDANCE_LOST, value, bound)


@kernel
def _keep_baseline(law, store, bits):
    for k in range(law.pairs):
        store.baseline_ohm[k] = store.z_ohm[k] if (bits >> k) & 1 else math.nan


@kernel
def _forget_baseline(store):
    for k in range(store.baseline_ohm.shape[0]):
        store.baseline_ohm[k] = math.nan
