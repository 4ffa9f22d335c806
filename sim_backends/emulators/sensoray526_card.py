"""The state of an emulated Sensoray 526 as one record, so that it can lie in memory that two processes share."""

import struct

import numpy as np

COUNTERS, OUTPUTS, INPUTS, LINES = 4, 4, 8, 8
SCANNED = INPUTS + 2
EEPROM_WORDS = 64

CARD = np.dtype(
    [
        # registers
        ("base", "i4"),
        ("signature", "i4"),
        ("watchdog_control", "i4"),
        ("dac_control", "i4"),
        ("adc_control", "i4"),
        ("digital", "i4"),
        ("interrupt_enable", "i4"),
        ("interrupt_status", "i4"),
        ("eeprom_word", "i4"),
        ("other", "i4", (2,)),  # timer, miscellaneous
        # counters
        ("shaft", "i8", (COUNTERS,)),  # of the encoder, in quarter lines, since power-on
        ("turn", "i8", (COUNTERS,)),  # quarter lines a turn, 0 without index
        ("counter", "i4", (COUNTERS,)),
        ("latch", "i4", (COUNTERS,)),
        ("preload", "i4", (COUNTERS, 2)),
        ("mode", "i4", (COUNTERS,)),
        ("control", "i4", (COUNTERS,)),
        ("events", "i4", (COUNTERS,)),
        ("index_level", "i4", (COUNTERS,)),
        # converter; times in accesses to the card
        ("input_v", "f8", (INPUTS,)),
        ("adc_gain", "f8"),  # codes a volt, of 3276.8
        ("adc_offset", "f8"),  # codes
        ("reference_v", "f8"),
        ("noise_lsb", "f8"),
        ("random", "i8"),
        ("result", "i4", (SCANNED,)),
        ("scan_left", "i4"),
        ("scan_enabled", "i4"),
        ("scan_settled", "i4"),
        ("settle_accesses", "i4"),
        ("conversion_accesses", "i4"),
        # EEPROM
        ("eeprom", "u2", (EEPROM_WORDS,)),
        ("eeprom_left", "i4"),
        ("eeprom_address", "i4"),
        ("eeprom_accesses", "i4"),
        # outputs: the true code = gain * V + offset
        ("dac_gain", "f8", (OUTPUTS,)),
        ("dac_offset", "f8", (OUTPUTS,)),
        ("staged", "i4", (OUTPUTS,)),
        ("code", "i4", (OUTPUTS,)),
        ("line_in", "u1", (LINES,)),
        # watchdog, in ticks
        ("watchdog_ticks", "i4"),
        ("watchdog_left", "i4"),
        ("watchdog_expired", "u1"),
        # what is broken
        ("adc_never_done", "u1"),
        ("stale_channel", "i4"),  # these are -1 while all is well
        ("railed_input", "i4"),
        ("frozen_output", "i4"),
        ("load_at", "i4"),
        ("frozen_counter", "i4"),
        ("dropping_counter", "i4"),
        ("edges", "i4"),
        ("silent_index", "i4"),
        ("deaf_watchdog", "u1"),
    ],
    align=True,
)

NOMINAL_GAIN, NOMINAL_OFFSET = 65536 / 20, 32768.0
FACTORY_DAC_GAIN = (3289.17, 3251.44, 3304.91, 3268.03)
FACTORY_DAC_OFFSET = (32781.3, 32743.6, 32799.2, 32760.4)
FACTORY_REFERENCE_V = 9.99712
FACTORY_ADC_GAIN, FACTORY_ADC_OFFSET = 0.9968 * NOMINAL_GAIN, -17.0


def make_card(base: int, seed: int = 0) -> np.ndarray:
    """A card (1,) of CARD at `base` as it is after power-on: not calibrated to nominal values, but by its EEPROM.

    Conversion takes 10 accesses a channel and settling 15, an access being about 1 µs.
    """
    cards = np.zeros(1, CARD)
    card = cards[0]
    card["base"], card["signature"] = base, 0x526A
    card["adc_gain"], card["adc_offset"], card["reference_v"] = FACTORY_ADC_GAIN, FACTORY_ADC_OFFSET, FACTORY_REFERENCE_V  # fmt: skip
    card["noise_lsb"], card["random"] = 1.5, (seed * 2654435761 + 12345) & 0x7FFFFFFF
    card["settle_accesses"], card["conversion_accesses"], card["eeprom_accesses"] = 15, 10, 20
    card["line_in"] = 1  # open lines are pulled up
    for fault in ("stale_channel", "railed_input", "frozen_output", "load_at", "frozen_counter", "dropping_counter", "silent_index"):  # fmt: skip
        card[fault] = -1
    set_factory(cards, FACTORY_DAC_GAIN, FACTORY_DAC_OFFSET)
    card["code"] = card["staged"] = 0x8000
    card["watchdog_ticks"] = 100
    return cards


def set_factory(cards: np.ndarray, gain: tuple[float, ...], offset: tuple[float, ...]) -> None:
    """Give the outputs of a card (1,) this true calibration, and write it and the reference into its EEPROM."""
    card = cards[0]
    card["dac_gain"], card["dac_offset"] = gain, offset
    values = [v for pair in zip(gain, offset, strict=True) for v in pair] + [float(card["reference_v"])]
    words = np.frombuffer(struct.pack(f"<{len(values)}d", *values), "<u2")
    card["eeprom"][: len(words)] = words
