"""What can be known of a motor from its counts and its command: angle, heat, and everything that is wrong (07 section 7).

The kernels share one record of :data:`drivers.maxon_lsc.state.AXIS`; :func:`follow` is called once a tick
and card.
"""

from drivers.maxon_lsc.state import CURRENT, VOLTAGE
from hal.frames import VALID
from hal.kernel import kernel

JUMPED, ILLEGAL, STALLED, INDEX_DRIFTS, INDEX_LOST, WRONG_WAY, NOT_READY, HOT, INDEX_MISSING = (
    1 << n for n in range(9)
)
"""Bits of what :func:`follow` found."""

DEBOUNCE = 2
"""Reads in a row that make a change of the Ready line."""
DITHER = 1
"""Counts within which an encoder at rest, or one with a cut channel, goes to and fro."""
DRIFT_COUNTS, LOST_COUNTS = 2, 8
OVERDUE = 1.25
"""Turns without an index pulse after which it is missing: one, and room for the width of a pulse and a turn back."""
GROWTH, GROWTH_COUNTS = 1.25, 2
COOL = 0.9
"""Share of the thermal limit below which a hot motor has cooled down."""
FOLLOWS = 0.5
"""Share of the commanded speed from which on an amplifier in mode speed is taken to need no more than it can for ever."""


@kernel
def follow(
    state, tick, command_v, enabled, held, ready, found,
    line, card_sequence, count_validity, count, count_error, index_sequence, index_count,
    axis_validity, axis_angle_rad, axis_sequence, axis_age_ticks, axis_powered, axis_fault,
):  # fmt: skip
    """Take in one tick of a card for all axes that are wired to it.

    Args:
        state (n,): of AXIS. tick: number of this read.
        command_v, enabled (n,): what the amplifiers have had since the last read, in the direction of the angle.
        held (n,): results; an amplifier that failed is held down until somebody else clears this.
        ready (n,): results; the amplifier is healthy. found (n,): results; sets of the bits of this module.
        line .. index_count: of :class:`hal.card.AnalogCard`. axis_...: of :class:`hal.device.Readings`, cleared.
    """
    for k in range(len(state)):
        axis = state[k]
        ticks = max(tick - axis.tick, 1) if axis.tick >= 0 else 1
        axis.tick = tick
        pass_ticks(axis, ticks, enabled[k], command_v[k])
        bits = HOT if axis.hot else 0
        ready[k] = is_ready(axis, line[axis.ready_line])
        if axis.fault:
            bits |= NOT_READY
            held[k] = held[k] or enabled[k]
            axis_fault[axis.axis] = True
        axis_powered[axis.axis] = enabled[k] and not held[k]
        if count_validity[axis.counter] == VALID:
            if card_sequence != axis.sequence:
                axis.sequence = card_sequence
                since = take_count(axis, tick, count[axis.counter])
                axis.illegal = count_error[axis.counter]
                if axis.turn_counts > 0:
                    take_index(axis, index_sequence[axis.counter], index_count[axis.counter])
                bits |= motion_trouble(axis, since, enabled[k], command_v[k])
            if axis.jumped_by != 0:
                bits |= JUMPED
            if axis.illegal:
                bits |= ILLEGAL
            if bits & (JUMPED | ILLEGAL) == 0 and axis.doubted == 0:
                axis_validity[axis.axis], axis_angle_rad[axis.axis] = VALID, axis.angle_rad
                axis_sequence[axis.axis], axis_age_ticks[axis.axis] = card_sequence, tick - axis.sampled
        else:
            axis.filled = 0
        found[k] = bits | index_trouble(axis)


@kernel
def take_count(axis, tick, count):
    """A new accumulated count; returns the ticks since the last one.

    A machine that stalls between waking up and reading sees later counts than its tick number says, and misses the next
    ticks. So a step that is too large is not judged before the next read: it is a jump unless ticks were missed now and the
    motor could have made both steps in all of the time.
    """
    if axis.sampled < 0:
        axis.zero = axis.count = axis.index_place = count
        axis.sampled = tick - 1
    ticks = max(tick - axis.sampled, 1)
    step = count - axis.count
    axis.jumped_by = 0
    if axis.doubted:
        both, time = count - axis.doubt_count, tick - axis.doubt_tick
        stalled = ticks > 1 and abs(both) <= axis.most_counts * time + DITHER
        axis.jumped_by = 0 if stalled else both
        axis.doubted = 0
    elif abs(step) > axis.most_counts * ticks + DITHER:
        axis.doubted, axis.doubt_count, axis.doubt_tick = 1, axis.count, axis.sampled
    axis.count, axis.sampled = count, tick
    axis.angle_rad = axis.rad_per_count * (count - axis.zero)
    axis.speed_rad_per_s = axis.rad_per_count * step / (ticks * axis.period_s)
    return ticks


@kernel
def take_index(axis, sequence, latched):
    """How many index pulses there were, and the count at the last one: it is compared modulo a turn with the first."""
    if sequence != axis.index_seen and axis.index_seen >= 0:
        axis.index_place = axis.count
        if not axis.index_known:
            axis.index_known, axis.index_first = 1, latched
        half = axis.turn_counts // 2
        axis.index_off_by = (latched - axis.index_first + half) % axis.turn_counts - half
    axis.index_seen = sequence


@kernel
def index_trouble(axis):
    """The bits of an index that is not where it was, and of one that does not come any more."""
    off, silent = abs(axis.index_off_by), abs(axis.count - axis.index_place)
    missing = INDEX_MISSING if axis.turn_counts > 0 and silent > OVERDUE * axis.turn_counts else 0
    if off > LOST_COUNTS:
        return INDEX_LOST | missing
    return INDEX_DRIFTS | missing if off > DRIFT_COUNTS else missing


@kernel
def motion_trouble(axis, ticks, powered, command_v):
    """Bits of a motor that does not do what its command says; `ticks` since the last count."""
    push = 0
    if powered and abs(command_v) > axis.breakaway_v:
        push = 1 if command_v > 0.0 else -1
    found = 0
    if stands_still(axis, push, ticks):
        found |= STALLED
    if ticks > 1 or axis.jumped_by != 0 or axis.doubted != 0:
        axis.filled = 0
    elif runs_away(axis, axis.direction * axis.count, push):
        found |= WRONG_WAY
    return found


@kernel
def stands_still(axis, push, ticks):
    """True for a motor that was driven above breakaway for the settings' time and made no more than a dither."""
    if push == 0 or abs(axis.count - axis.still_place) > DITHER:
        axis.still_place, axis.still_ticks = axis.count, 0
    else:
        axis.still_ticks += ticks
    return axis.still_ticks >= axis.stall_ticks


@kernel
def runs_away(axis, count, push):
    """True for a motor that gets faster against its command: wires of the motor or the encoder are swapped.

    While a command above breakaway keeps its sign, a motor that turns against it must slow down: breakaway is what
    overcomes friction and every load of normal use. So one that comes back from a motion the other way, or is driven back
    by a load, makes as much way in the second half of the window as in the first, or less. One that is wired wrongly
    makes more. Called once a tick with a count in the command's direction; needs a full window of the same push.
    """
    if push != axis.push:
        axis.push, axis.filled = push, 0
    if push == 0:
        return False
    size = 2 * axis.half_window + 1
    axis.ring[axis.filled % size] = count
    axis.filled += 1
    if axis.filled < size:
        return False
    first, middle = axis.ring[axis.filled % size], axis.ring[(axis.filled - 1 - axis.half_window) % size]
    before, after = push * (first - middle), push * (middle - count)
    return before >= GROWTH_COUNTS and after >= GROWTH * before + GROWTH_COUNTS


@kernel
def is_ready(axis, level):
    """True for a Ready that was pulled low, which only a healthy amplifier does: a cut wire is a fault too."""
    if level:
        axis.high_reads, axis.low_reads = axis.high_reads + 1, 0
    else:
        axis.high_reads, axis.low_reads = 0, axis.low_reads + 1
    if axis.high_reads >= DEBOUNCE:
        axis.fault = 1
    elif axis.low_reads >= DEBOUNCE:
        axis.fault = 0
        axis.was_ready = 1
    return axis.fault == 0 and axis.was_ready != 0


@kernel
def current_a(axis, command_v):
    """What a command makes flow [A] (07 section 2.1).

    It is known in mode current, and follows from resistance and back-EMF in mode voltage. In mode speed it is not known:
    an amplifier whose motor does not follow drives all it can, and one whose motor follows is taken to stay cool.
    """
    if axis.mode == CURRENT:
        return axis.gain * command_v
    if axis.mode == VOLTAGE:
        return (axis.gain * command_v - axis.back_emf_v_s_per_rad * axis.speed_rad_per_s) / axis.resistance_ohm
    wanted = axis.gain * command_v
    follows = axis.speed_rad_per_s * wanted >= FOLLOWS * wanted * wanted
    return COOL * axis.continuous_a if follows else axis.peak_a


@kernel
def pass_ticks(axis, ticks, powered, command_v):
    """Heat the winding (I2t): a first-order lag of the squared current, 1 where the continuous current would lead."""
    load = current_a(axis, command_v) / axis.continuous_a if powered else 0.0
    axis.heat += min(axis.heat_per_tick * ticks, 1.0) * (load * load - axis.heat)
    axis.hot = axis.heat >= (COOL if axis.hot else 1.0)
