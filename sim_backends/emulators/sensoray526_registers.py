"""The register file of an emulated Sensoray 526: what every 16-bit access does (07 sections 1.2 and 1.3)."""

import math

from numba.np.numpy_support import from_dtype
from numba.types import Array, int32, int64

from hal.kernel import kernel
from sim_backends.emulators.sensoray526_card import CARD, COUNTERS, INPUTS, OUTPUTS, SCANNED
from sim_backends.emulators.sensoray526_counters import LATCH_ON_EVENT, load

READ, WRITE = 0, 1
DAC_DONE, ADC_DONE, EEPROM_DONE = 0x02, 0x04, 0x80
FINE, OUTSIDE, ODD, NO_REGISTER, NOT_MODELLED = 0, -1, -2, -3, -4
"""What :func:`execute` says: nothing wrong, or how the driver misused the card."""


@kernel
def read(card, offset):
    """The word at an offset, or how that was misuse."""
    pass_time(card)
    if offset == 0x34:
        return card.signature
    if card.signature == 0xFFFF:
        return 0xFFFF  # nothing drives the bus
    if 0x12 <= offset < 0x32:
        return read_counter(card, (offset - 0x12) // 8, (offset - 0x12) % 8)
    if offset == 0x00 or offset == 0x10:
        return card.other[offset // 0x10]
    if offset == 0x02:
        return card.watchdog_control
    if offset == 0x08:
        selected = (card.adc_control >> 1) & 0xF
        return card.result[selected] & 0xFFFF if selected < SCANNED else NOT_MODELLED
    if offset == 0x0A:
        return card.digital & 0xFF00 | levels(card)
    if offset == 0x0C:
        return card.interrupt_enable
    if offset == 0x0E:
        return card.interrupt_status | counter_interrupts(card)
    if offset == 0x32:
        return card.eeprom_word
    return NO_REGISTER


@kernel
def write(card, offset, word):
    """Put a word at an offset; FINE, or how that was misuse."""
    pass_time(card)
    if card.signature == 0xFFFF:
        return FINE
    if 0x12 <= offset < 0x32:
        return write_counter(card, (offset - 0x12) // 8, (offset - 0x12) % 8, word)
    if offset == 0x00 or offset == 0x10:
        card.other[offset // 0x10] = word
    elif offset == 0x02:
        write_watchdog(card, word)
    elif offset == 0x04:
        write_dac_control(card, word)
    elif offset == 0x06:
        card.adc_control = word
        if word & 1:
            start_scan(card, word)
    elif offset == 0x08:
        card.staged[(card.dac_control >> 1) & 3] = word
    elif offset == 0x0A:
        card.digital = word
    elif offset == 0x0C:
        card.interrupt_enable = word
    elif offset == 0x0E:
        card.interrupt_status &= ~word
    elif offset == 0x34:
        if word & 7 != 5 or word >> 3 > 0x3F:
            return NOT_MODELLED  # it reads, within 64 words; a driver that writes the EEPROM destroys the calibration
        card.eeprom_address, card.eeprom_left = word >> 3, card.eeprom_accesses
    else:
        return NO_REGISTER
    return FINE


@kernel
def read_counter(card, channel, register):
    """Low word (latches, in the mode latch-on-read), high word, mode, control."""
    if register == 0:
        if not card.mode[channel] & LATCH_ON_EVENT:
            card.latch[channel] = card.counter[channel]
        return card.latch[channel] & 0xFFFF
    if register == 2:
        return card.latch[channel] >> 16
    if register == 4:
        return card.mode[channel]
    return card.control[channel] | card.events[channel] | card.index_level[channel] << 5


@kernel
def write_counter(card, channel, register, word):
    """Preload low and high, mode, control."""
    selected = (card.mode[channel] >> 14) & 1
    if register == 0:
        card.preload[channel, selected] = card.preload[channel, selected] & 0xFF0000 | word
    elif register == 2:
        card.preload[channel, selected] = (word & 0xFF) << 16 | card.preload[channel, selected] & 0xFFFF
    elif register == 4:
        if word & 0x1000 or (word >> 7) & 3 > 1:
            return NOT_MODELLED  # software direction and hardware enable: no encoder is counted so
        card.mode[channel] = word
    else:
        card.events[channel] &= ~word
        card.control[channel] = word & 0x3FC0
        if word & 0x4000:
            load(card, channel)
        if word & 0x8000:
            card.counter[channel] = 0
    return FINE


@kernel
def counter_interrupts(card):
    """Bits 6..3 of the status: counter n has an event that its control lets through."""
    bits = 0
    for channel in range(COUNTERS):
        if (card.control[channel] >> 6) & card.events[channel] & 0xF:
            bits |= 1 << (6 - channel)
    return bits


@kernel
def start_scan(card, word):
    """Convert the enabled channels; the done bit comes after all of them."""
    card.scan_enabled = (word >> 5) & 0x3FF
    card.scan_settled = word >> 15
    channels = 0
    for channel in range(SCANNED):
        channels += (card.scan_enabled >> channel) & 1
    each = card.conversion_accesses + (card.settle_accesses if card.scan_settled else 0)
    card.scan_left = max(1, channels * each)


@kernel
def pass_time(card):
    """One access: conversions and the EEPROM come nearer to their end."""
    if card.scan_left > 0:
        card.scan_left -= 1
        if card.scan_left == 0:
            finish_scan(card)
    if card.eeprom_left > 0:
        card.eeprom_left -= 1
        if card.eeprom_left == 0:
            card.eeprom_word = card.eeprom[card.eeprom_address]
            card.interrupt_status |= EEPROM_DONE


@kernel
def finish_scan(card):
    """Results of the enabled channels; without settling half of what the channel before had is still there."""
    card.scan_left = 0
    before_v = math.nan
    for channel in range(SCANNED):
        if (card.scan_enabled >> channel) & 1 == 0:
            continue
        true_v = terminal_v(card, channel)
        seen_v = true_v if card.scan_settled or math.isnan(before_v) else 0.5 * (true_v + before_v)
        before_v = true_v
        if channel != card.stale_channel:
            code = round(card.adc_gain * seen_v + card.adc_offset + noise(card))
            card.result[channel] = min(max(code, -32768), 32767)
    if not card.adc_never_done:
        card.interrupt_status |= ADC_DONE


@kernel
def terminal_v(card, channel):
    """Voltage at the multiplexer."""
    if channel == INPUTS:
        return card.reference_v
    if channel == INPUTS + 1:
        return 0.0
    return 12.0 if channel == card.railed_input else card.input_v[channel]


@kernel
def noise(card):
    """Uniform, of noise_lsb either way; a linear congruence is random enough for a last bit."""
    card.random = (card.random * 1103515245 + 12345) & 0x7FFFFFFF
    return card.noise_lsb * (card.random / 1073741824.0 - 1.0)


@kernel
def write_dac_control(card, word):
    """Select, reset to half scale, or move all outputs to what is staged."""
    card.dac_control = word
    if word & 8:
        card.staged[:] = 0x8000
    if word & 9:
        for channel in range(OUTPUTS):
            if channel != card.frozen_output:
                card.code[channel] = card.staged[channel]
        card.interrupt_status |= DAC_DONE


@kernel
def levels(card):
    """Levels of the lines, driven by the card where a group is an output."""
    word = 0
    for number in range(len(card.line_in)):
        driven = card.digital & (0x0400 if number < 4 else 0x0800)
        high = (card.digital >> number) & 1 if driven else card.line_in[number]
        word |= int(high) << number
    return word


@kernel
def write_watchdog(card, word):
    """Every write that enables it pets it; an expired one stays so until it is switched off."""
    if card.deaf_watchdog:
        return
    card.watchdog_control = word
    if word & 8:
        if not card.watchdog_expired:
            card.watchdog_left = card.watchdog_ticks
    else:
        card.watchdog_expired = 0


@kernel
def tick(cards, ticks):
    """Ticks pass for a card (1,): a millisecond is longer than any conversion, and the watchdog counts them."""
    card = cards[0]
    if card.scan_left > 0:
        finish_scan(card)
    if card.watchdog_control & 8 and not card.watchdog_expired:
        card.watchdog_left -= ticks
        if card.watchdog_left <= 0:
            card.watchdog_expired = 1


@kernel(signature=int64(Array(from_dtype(CARD), 1, "C"), int32[:, ::1], int32[::1]))
def execute(cards, operations, where):
    """Carry out operations (n, 6) of 32-bit words, in the order of hal.seams.OPERATION, on a card (1,) of CARD.

    Returns:
        POLLs that timed out, or how the card was misused by the operation whose number goes to where (1,).
    """
    card = cards[0]
    timed_out = 0
    for i in range(len(operations)):
        kind, offset = operations[i, 0], operations[i, 1] - card.base
        where[0] = i
        if offset < 0 or offset >= 0x40:
            return OUTSIDE
        if offset & 1:
            return ODD
        if kind == WRITE:
            wrong = write(card, offset, operations[i, 2] & 0xFFFF)
            if wrong:
                return wrong
            continue
        tries = 1 if kind == READ else operations[i, 4]
        word = -1
        for _ in range(tries):
            word = read(card, offset)
            if word < 0:
                return word
            if kind == READ or word & operations[i, 3] == operations[i, 2]:
                break
            word = -1
        if word < 0:
            timed_out += 1
        operations[i, 5] = word
    return timed_out
