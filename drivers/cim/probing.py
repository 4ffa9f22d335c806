"""``rtctl devices probe`` for the telemetry: is anybody there, in the right layout, with the right pairs?"""

import time
from collections import Counter

from drivers.cim.options import CimOptions
from drivers.cim.pairs import Pairs
from drivers.cim.sample import Decoder, Refusal
from hal.device import Finding
from hal.seams import Datagrams

PAUSE_S = 0.01
ROOM_S = 0.5
"""Longer than a sweep by so much."""


def listen(link: Datagrams, decoder: Decoder, pairs: Pairs, options: CimOptions) -> list[Finding]:
    """Listen for a sweep, at most; what is heard here is not measured. Nothing is sent."""
    heard, foreign = _gather(link, decoder, pairs, options)
    found = sum(count for what, count in heard.items() if isinstance(what, int))
    refused = {what.value: count for what, count in heard.items() if isinstance(what, Refusal)}
    places = sum(isinstance(what, int) for what in heard)
    return [
        Finding(
            "telemetry", f"{found + sum(refused.values())} datagrams from {options.peer}, {foreign} of others", bool(heard),
            "start the sender; compare its target with `local`, its own address and port with `peer`",
        ),
        Finding(
            f"layout {options.decoder}", ", ".join(f"{n} refused ({why})" for why, n in refused.items()) or "none refused",
            not refused, "compare decoder and decoder_options, pair_step and tip_electrode with the sender",
        ),
        Finding(
            "pairs", f"{places} of {pairs.count} heard", places == pairs.count,
            "compare pair_step with the sender's stimulation mode; it may leave electrodes out",
        ),
    ]  # fmt: skip


def _gather(link: Datagrams, decoder: Decoder, pairs: Pairs, options: CimOptions) -> tuple[Counter[int | Refusal], int]:
    """How often every pair was heard, and every refusal; and datagrams of others."""
    heard: Counter[int | Refusal] = Counter()
    foreign, buffer = link.foreign, bytearray(2048)
    for _ in range(round((pairs.count * options.sample_period_s + ROOM_S) / PAUSE_S)):
        while (length := link.receive(buffer)) >= 0:
            sample = decoder.decode(memoryview(buffer)[: min(length, len(buffer))])
            pair = -1 if isinstance(sample, Refusal) else pairs.pair_of(sample)
            heard[sample if isinstance(sample, Refusal) else pair if pair >= 0 else Refusal.PAIR] += 1
        if sum(isinstance(what, int) for what in heard) == pairs.count:
            break
        time.sleep(PAUSE_S)
    return heard, link.foreign - foreign
