"""The two batches of a tick that read a card: one to start what takes time, one to collect it (07 section 1.6)."""

import numpy as np

from drivers.sensoray526 import counters, scan
from drivers.sensoray526.options import Sensoray526Options
from drivers.sensoray526.registers import DIGITAL, SIGNATURE, Batch, counter_control


class ReadingBatches:
    """Built once; the arrays beside the batches are views into them.

    Args:
        options: of the card. used: its counters. inputs: those that are scanned; without any there is no scan.
        control: what the counters' control registers hold beside their events.

    Attributes:
        first, second: operations of OPERATION; `second` may be empty.
        first_words: results of the first; the signature is its first, the lines' levels its last.
        count_words (counters, :func:`counters.words_a_reading`), clear_words (counters,): see :func:`counters.decode`.
        scan_words (2 + inputs,): see :func:`scan.decode`.
    """

    def __init__(self, options: Sensoray526Options, used: list[int], inputs: list[int], control: int) -> None:
        channels = scan.scanned(inputs) if inputs else ()
        self._build_first(options, used, channels)
        self._build_second(options, used, channels, control)

    def _build_first(self, options: Sensoray526Options, used: list[int], channels: tuple[int, ...]) -> None:
        batch = Batch(options.base)
        batch.read(SIGNATURE)
        if channels:
            scan.add_start(batch, channels)
        place, each = len(batch), counters.words_a_reading(index=options.index)
        for channel in used:
            counters.add_reading(batch, channel, index=options.index)
        batch.read(DIGITAL)
        self.first = batch.build()
        self.first_words = self.first["result"]
        self.count_words = self.first_words[place : place + each * len(used)].reshape(len(used), each)

    def _build_second(self, options: Sensoray526Options, used: list[int], channels: tuple[int, ...], control: int) -> None:  # fmt: skip
        batch = Batch(options.base)
        for channel in used:
            batch.write(counter_control(channel), control)
        place = scan.add_collecting(batch, channels, options.poll_limit) if channels else 0
        self.second = batch.build()
        self.clear_words = self.second["value"][: len(used)]
        self.scan_words = self.second["result"][place + 1 :: 2] if channels else np.empty(0, np.int32)
