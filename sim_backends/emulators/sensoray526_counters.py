"""How the counters of an emulated Sensoray 526 count an encoder's edges and latch them."""

from hal.kernel import kernel

WRAP = 1 << 24
ERROR, INDEX_FALL, INDEX_RISE, ROLLOVER = 1, 2, 4, 8
LOAD_AT_ROLLOVER, LOAD_AT_FALL, LOAD_AT_RISE = 0x04, 0x08, 0x10
LATCH_ON_EVENT = 0x2000
COUNTING = 1


@kernel
def counting(card, channel):
    """Whether edges are counted: quadrature, enabled without condition."""
    return (card.mode[channel] >> 7) & 3 == COUNTING


@kernel
def load(card, channel):
    """From the preload register that is selected."""
    selected = (card.mode[channel] >> 14) & 1
    card.counter[channel] = card.preload[channel, selected] if card.load_at < 0 else card.load_at


@kernel
def happen(card, channel, event):
    """An edge of the index: its flag, and what it loads or latches."""
    if channel == card.silent_index:
        return
    card.events[channel] |= event
    mode, control = card.mode[channel], card.control[channel]
    selected = control & (0x0400 if event == INDEX_FALL else 0x0800)
    if selected and mode & LATCH_ON_EVENT:
        card.latch[channel] = card.counter[channel]
    if mode & (LOAD_AT_FALL if event == INDEX_FALL else LOAD_AT_RISE):
        load(card, channel)


@kernel
def kept(card, channel, step):
    """What is left of a step when one edge in ten is lost."""
    if channel != card.dropping_counter:
        return step
    card.edges += abs(step)
    lost = card.edges // 10
    card.edges %= 10
    return step - lost if step > 0 else step + lost


@kernel
def count(card, channel, to):
    """The encoder goes to quarter line `to` without passing an index; counted at one, two or four edges a line."""
    before, card.shaft[channel] = card.shaft[channel], to
    if not counting(card, channel) or channel == card.frozen_counter:
        return
    per_line = 1 << min((card.mode[channel] >> 9) & 3, 2)
    quarters = 4 // per_line
    value = card.counter[channel] + kept(card, channel, to // quarters - before // quarters)
    if value < 0 or value >= WRAP:
        card.events[channel] |= ROLLOVER
        value %= WRAP
        if card.mode[channel] & LOAD_AT_ROLLOVER:
            load(card, channel)
            return
    card.counter[channel] = value


@kernel
def turn_to(cards, channel, to):
    """On a card (1,) the encoder of a counter goes to quarter line `to`; its index is high on one quarter line a turn."""
    card = cards[0]
    turn = card.turn[channel]
    up = to > card.shaft[channel]
    while turn > 0 and card.shaft[channel] != to:
        here = card.shaft[channel]
        if up:
            index = (here // turn + 1) * turn
            if index > to:
                break
            enter(card, channel, index)
            if index < to:
                leave(card, channel, index + 1)
        else:
            index = ((here + turn - 1) // turn - 1) * turn
            if index < to:
                break
            enter(card, channel, index)
            if index > to:
                leave(card, channel, index - 1)
    if card.shaft[channel] != to:
        if card.index_level[channel]:
            leave(card, channel, card.shaft[channel] + (1 if up else -1))
        count(card, channel, to)


@kernel
def enter(card, channel, index):
    """Onto the index."""
    if card.index_level[channel]:
        leave(card, channel, card.shaft[channel] + (1 if index > card.shaft[channel] else -1))
    count(card, channel, index)
    card.index_level[channel] = 1
    happen(card, channel, INDEX_RISE)


@kernel
def leave(card, channel, to):
    """Off the index."""
    count(card, channel, to)
    card.index_level[channel] = 0
    happen(card, channel, INDEX_FALL)


@kernel
def pulse(cards, channel):
    """On a card (1,), an index where none is."""
    card = cards[0]
    happen(card, channel, INDEX_RISE)
    happen(card, channel, INDEX_FALL)


@kernel
def jump(cards, channel, step):
    """On a card (1,), counts that no encoder made."""
    card = cards[0]
    card.counter[channel] = (card.counter[channel] + step) % WRAP
