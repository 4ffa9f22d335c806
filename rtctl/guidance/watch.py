"""The detectors in the tick: what an insertion under way feels like, compared with what it should.

A force is taken whenever the depth passes the next sample of the grid, about once in 140 ticks at 1 mm/s. In that tick the
integrals grow, the rest of the insertion is predicted, and tip folding is decided; in all others next to nothing happens.
"""

import math

from hal.kernel import kernel
from rtctl.conditions import raise_condition
from rtctl.guidance.buckling import DEVIATIONS
from rtctl.guidance.features import FEATURE_EVERY, SAMPLES
from rtctl.guidance.folding import KNOWN
from rtctl.guidance.layout import (
    BLIND,
    BUCKLED,
    CHANNEL_COUNT,
    FEATURES,
    FOLDED,
    FORCE_HIGH,
    MOMENT_HIGH,
    RETRACT,
    WARN,
    WATCHING,
)
from rtctl.guidance.prediction import evaluate, forecast, know, start
from rtctl.lifecycle import Condition, Task
from rtctl.wrench import into_sensor

OUTSIDE_MM = 1e-9
"""An insertion begins beyond it, and a retraction that ends before it is complete."""
FIRST_KNOWN, KNOWN_EVERY = int(KNOWN[0]), int(KNOWN[1] - KNOWN[0])


@kernel
def watch(memory, record):
    """One tick of the detectors; raises the conditions they call for, and writes what they know into the record."""
    insertion = memory.insertion
    if memory.detector.on:
        before = insertion.flags
        _observe(memory, record)
        _react(memory, record, insertion.flags & ~before)
    known = insertion.samples > 0
    for i in range(2):
        record.buckling_integral[i] = insertion.integral[i] if known else math.nan
        record.buckling_bound[i] = insertion.integral_bound[i] if known else math.nan
    record.predicted_force_n = insertion.predicted_force_n if known else math.nan
    record.fold_decision = insertion.decision if known else math.nan
    record.fold_bound = insertion.decision_bound if known else math.nan
    record.detector_samples = insertion.samples
    record.detector_flags = insertion.flags


@kernel
def _observe(memory, record):
    """Take the next sample when its depth has been reached; forget everything when the array is out."""
    insertion, state, detector = memory.insertion, memory.state, memory.detector
    depth = state.setpoint[state.setpoint.shape[0] - 1]
    if not state.on_path or depth <= OUTSIDE_MM:
        forget(insertion)
    insertion.flags &= ~WATCHING
    at = insertion.samples
    if state.task != Task.INSERTING or at == SAMPLES or insertion.flags & BLIND:
        return
    insertion.flags |= WATCHING
    if depth < detector.depth_mm[at]:
        return
    if at + 1 < SAMPLES and depth >= detector.depth_mm[at + 1]:  # nobody knows what was felt on the way
        insertion.flags = (insertion.flags | BLIND) & ~WATCHING
        know_nothing(insertion)
        raise_condition(state, record, Condition.DETECTOR_BLIND, depth, detector.depth_mm[at])
        return
    moment = state.scratch[0]
    into_sensor(state.rotation, record.wrench_in_base[3:], moment)
    if math.isfinite(record.force_axial_n) and math.isfinite(moment[0]) and math.isfinite(moment[1]):
        take(detector, insertion, record.force_axial_n, moment[0], moment[1])
        decide(detector, insertion, memory.parameters.fold_margin, memory.parameters.buckling_two_sided)


@kernel
def forget(insertion):
    """Nothing is known of the insertion to come."""
    insertion.samples = 0
    insertion.flags = 0
    know_nothing(insertion)
    for i in range(2):
        insertion.integral[i] = 0.0
    start(insertion.fit)


@kernel
def know_nothing(insertion):
    """What is not known any more is NaN; what has been found stays found."""
    insertion.decision = math.nan
    insertion.decision_bound = math.nan
    insertion.predicted_force_n = math.nan
    for i in range(2):
        insertion.integral[i] = math.nan
        insertion.integral_bound[i] = math.nan


@kernel
def take(detector, insertion, f_z, f_xx, f_yy):
    """The next sample: force [N] and moments [N mm]; the integrals grow by a trapezium (VI.10, VI.11)."""
    at = insertion.samples
    insertion.force[0, at], insertion.force[1, at], insertion.force[2, at] = f_z, f_xx, f_yy
    if at > 0:
        f = insertion.force
        insertion.integral[0] -= 0.5 * (f[0, at] + f[0, at - 1]) * detector.step
        moments = math.hypot(f[1, at], f[2, at]) + math.hypot(f[1, at - 1], f[2, at - 1])
        insertion.integral[1] += 0.5 * moments * detector.step
    for c in range(CHANNEL_COUNT):
        know(detector.tables, insertion.fit, at, c, insertion.force[c, at])
        forecast(detector.tables, insertion.fit, at + 1, c)
    insertion.samples = at + 1
    insertion.predicted_force_n = evaluate(detector.tables, insertion.fit, SAMPLES - 1, 0)


@kernel
def decide(detector, insertion, margin, two_sided):
    """Latch what is found of buckling (VI.12) and, every other sample, of tip folding (VI.27)."""
    at = insertion.samples - 1
    for i in range(2):
        mean, room = detector.integral_mean[i, at], DEVIATIONS * detector.integral_deviation[i, at]
        insertion.integral_bound[i] = mean + room
        away = insertion.integral[i] - mean
        if away > room or (two_sided and -away > room):
            insertion.flags |= FORCE_HIGH if i == 0 else MOMENT_HIGH
    if insertion.flags & FORCE_HIGH and insertion.flags & MOMENT_HIGH:
        insertion.flags |= BUCKLED
    known = insertion.samples
    if known < FIRST_KNOWN or (known - FIRST_KNOWN) % KNOWN_EVERY != 0:
        return
    h = detector.offset
    for c in range(detector.channels):
        for i in range(FEATURES):
            sample = i * FEATURE_EVERY
            if sample < known:
                h += detector.weight[c, i] * insertion.force[c, sample]
            else:
                h += detector.weight[c, i] * evaluate(detector.tables, insertion.fit, sample, c)
    insertion.decision = h
    insertion.decision_bound = margin * detector.bound[(known - FIRST_KNOWN) // KNOWN_EVERY]
    if insertion.decision + insertion.decision_bound <= 0.0:
        insertion.flags |= FOLDED


@kernel
def _react(memory, record, new):
    """Conditions for the failures found, `new` ones among them, by the reactions in force; never on the way out."""
    state, insertion, parameters = memory.state, memory.insertion, memory.parameters
    if state.task == Task.RETRACTING:
        return
    if insertion.flags & BUCKLED:
        value, bound = insertion.integral[0], insertion.integral_bound[0]
        if parameters.buckling_reaction == WARN:
            raise_condition(state, record, Condition.BUCKLING_WARNING, value, bound)
        elif parameters.buckling_reaction == RETRACT or new & BUCKLED:
            raise_condition(state, record, Condition.BUCKLING, value, bound)
    if insertion.flags & FOLDED:
        value, bound = insertion.decision, -insertion.decision_bound
        if parameters.fold_reaction == WARN:
            raise_condition(state, record, Condition.TIP_FOLD_WARNING, value, bound)
        elif parameters.fold_reaction == RETRACT or new & FOLDED:
            raise_condition(state, record, Condition.TIP_FOLD, value, bound)
