"""``python -m drivers.cim.relay``: hears one layout, passes on ICZ1; for implant computers that speak something else.

It runs on the implant's computer or anywhere between, in a process of its own. What it refuses it does not pass on; what was lost
before it shows as a gap behind it, and a sender that started anew as a new run.
"""

import argparse
import secrets
import sys
import time
from collections.abc import Sequence
from dataclasses import replace

from drivers.cim import sample as layouts
from drivers.cim.gate import Gate
from drivers.cim.icz1 import encode
from drivers.cim.pairs import Pairs
from drivers.cim.recording import Recorder
from drivers.cim.sample import Refusal, Sample
from drivers.cim.stream import Verdict
from hal.errors import RtctlError
from hal.sockets import UdpSocket

PAUSE_S = 0.002
WRAP = 1 << 32
LOST_MAX = 1 << 30
"""Of a clock that leaps; more would wrap the sequence and look like the past."""
EXAMPLES = """examples:
  from a sender of the minimal layout to the controller's computer:
    python -m drivers.cim.relay --local 192.168.5.2:49200 --peer 192.168.5.7:49200 \\
        --layout minimal --layout-option byte_order=little --to 192.168.1.10:49300
  the same, and a recording of what came, for `python -m drivers.cim.replay`:
    python -m drivers.cim.relay ... --record recordings

The controller's device of kind "cim" takes --to as its `local`, and --from, an address of the relay, as its `peer`.
"""


class Translator:
    """Makes ICZ1 of judged samples: run, numbers and places in the sweep that the layout lacks are given here."""

    def __init__(self, pairs: Pairs) -> None:
        self._pairs = pairs
        self._run = secrets.randbits(32)
        self._sequence = self._sweep = 0
        self._last_position = -1

    def datagram(self, sample: Sample, verdict: Verdict, lost: int) -> bytes:
        """The ICZ1 datagram of a sample that came after `lost` others had been lost."""
        if verdict is Verdict.NEW_RUN:
            self._run = (self._run + 1) % WRAP
            self._sequence = self._sweep = 0
        position = sample.active - 1 if sample.position is None else sample.position
        if sample.position is None:
            self._sweep = (self._sweep + (position <= self._last_position)) % WRAP
        self._last_position = position
        lost = min(lost, LOST_MAX)
        number, self._sequence = (self._sequence + lost) % WRAP, (self._sequence + lost + 1) % WRAP
        return encode(
            replace(
                sample,
                run=self._run,
                sequence=number,
                back=sample.active + self._pairs.step if sample.back is None else sample.back,
                position=position,
                sweep_length=sample.sweep_length or self._pairs.count,
                sweep=self._sweep if sample.position is None else sample.sweep,
            )
        )


class Relay:
    """One socket in, one out; `turn` does what there is to do.

    Attributes:
        passed: datagrams passed on. counts: everything else by name.
    """

    def __init__(self, source: UdpSocket, sink: UdpSocket, gate: Gate, pairs: Pairs, recorder: Recorder | None) -> None:
        self._source, self._sink, self._gate, self._recorder = source, sink, gate, recorder
        self._translator = Translator(pairs)
        self._buffer = bytearray(2048)
        self.passed = 0

    @property
    def counts(self) -> dict[str, int]:
        """All counters by name."""
        return {"passed": self.passed, "foreign": self._source.foreign, **self._gate.counts()}

    def turn(self, now_us: int) -> None:
        """Pass on all that waits; `now_us` since the relay began goes into the recording."""
        while (length := self._source.receive(self._buffer)) >= 0:
            data = memoryview(self._buffer)[: min(length, len(self._buffer))]
            if self._recorder is not None:
                self._recorder.note(now_us, data)
            judged = self._gate.judge(data)
            if isinstance(judged, Refusal) or judged[1] is Verdict.OLD:
                continue
            self._sink.send(self._translator.datagram(*judged, self._gate.stream.lost))
            self.passed += 1


def parser() -> argparse.ArgumentParser:
    """Arguments of the command."""
    p = argparse.ArgumentParser("python -m drivers.cim.relay", description="Pass impedance telemetry on as ICZ1.", epilog=EXAMPLES, formatter_class=argparse.RawDescriptionHelpFormatter)  # fmt: skip
    p.add_argument("--local", required=True, metavar="ADDRESS", help="where the sender sends to, host:port")
    p.add_argument("--peer", required=True, metavar="ADDRESS", help="the only sender that is listened to, host:port")
    p.add_argument("--to", required=True, metavar="ADDRESS", help="where ICZ1 goes, host:port")
    p.add_argument("--from", dest="origin", default="", metavar="ADDRESS", help="where it comes from, host:port; else any port")  # fmt: skip
    p.add_argument(
        "--layout", default="minimal", help="of what comes in: an entry point of rtctl.cim_decoders (minimal)"
    )
    p.add_argument("--layout-option", action="append", default=[], metavar="NAME=VALUE", help="an option of the layout")
    p.add_argument("--pair-step", type=int, choices=(1, 2), default=1, help="1: BP+0 pairs, 2: BP+1 pairs (1)")
    p.add_argument("--sample-period", type=float, default=0.07, metavar="S", help="from sample to sample (0.07)")
    p.add_argument("--record", default="", metavar="DIRECTORY", help="record all that comes in")
    p.add_argument("--for", dest="seconds", type=float, default=None, metavar="S", help="end after so many seconds")
    return p


def main(arguments: Sequence[str] | None = None) -> int:
    """Relay until Ctrl-C; 0, or 2 if it cannot begin."""
    p = parser()
    given = p.parse_args(arguments)
    if not 0.001 <= given.sample_period <= 1.0:
        p.error(f"--sample-period {given.sample_period:g}: allowed are 0.001 to 1 s")
    for text in given.layout_option:
        if "=" not in text:
            p.error(f"--layout-option {text}: write NAME=VALUE")
    pairs = Pairs(given.pair_step, layouts.ELECTRODES)  # which end is the tip makes no difference here
    try:
        decoder = layouts.load(given.layout)(
            dict(text.split("=", 1) for text in given.layout_option), "--layout-option"
        )
        source, sink = UdpSocket(given.local, given.peer), UdpSocket(given.origin, given.to)
        recorder = Recorder(given.record, "relay") if given.record else None
    except RtctlError as error:
        print(f"relay: {error}", file=sys.stderr)
        return 2
    relay = Relay(source, sink, Gate(decoder, pairs, given.sample_period), pairs, recorder)
    print(f"relay: {given.layout} from {given.peer} at {given.local}, ICZ1 to {given.to}", flush=True)
    try:
        _run(relay, given.seconds)
    except KeyboardInterrupt:
        print()
    finally:
        source.close()
        sink.close()
        if recorder is not None:
            recorder.close()
    print("relay: " + ", ".join(f"{name} {count}" for name, count in relay.counts.items()))
    return 0


def _run(relay: Relay, seconds: float | None) -> None:
    begin = time.monotonic()
    while seconds is None or time.monotonic() - begin < seconds:
        relay.turn(round((time.monotonic() - begin) * 1e6))
        time.sleep(PAUSE_S)


if __name__ == "__main__":
    sys.exit(main())
