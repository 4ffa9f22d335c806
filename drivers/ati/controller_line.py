"""The serial dialogue with an ATI stand-alone controller, and how to find back into it (07 section 3.5).

A stream of binary records has no marks to find its beginning by. So one record is asked for at a time, and a reply must be
its echo, a record and a prompt, not a byte less or more. How the 19 bytes of a binary reply are laid out, and that commands
are echoed with their carriage return, is to be confirmed on hardware.
"""

import enum
import re
import struct

from hal.seams import SerialLine

ASK = b"QR\r"
END = b"\r\n>"
BINARY = struct.Struct(">B6h")
FIELD = rb" *(-?[0-9]{1,6}) *"
ASCII = re.compile(b",".join([FIELD] * 7))
SETUP = {"binary": (b"\r", b"CD B\r", b"CD R\r"), "ascii": (b"\r", b"CD A\r", b"CD R\r")}
"""A carriage return ends whatever was going on; then records are set to be binary or not, and resolved."""
QUIET_S = 0.02
"""Silence that nothing is cut off by: adapters deliver in bursts of up to 16 ms."""
BUFFER = 256
"""Bytes that wait for being understood at most."""

Record = tuple[int, ...]
"""Number of an error, 0 for none, and six counts."""


class Garbled(Exception):
    """What came cannot become a reply any more."""


def parse(reply: bytes, mode: str) -> Record | None:
    """The record of a complete reply, None while it may become one. Raises Garbled."""
    if not reply.startswith(ASK[: len(reply)]):
        raise Garbled
    if mode == "binary":
        size = len(ASK) + BINARY.size + len(END)
        if len(reply) < size:
            return None
        if len(reply) > size or not reply.endswith(END):
            raise Garbled
        return BINARY.unpack_from(reply, len(ASK))
    at = reply.find(END)
    if at < 0:
        return None
    found = ASCII.fullmatch(reply[len(ASK) : at].strip(b"\r\n"))
    if found is None or at + len(END) != len(reply):
        raise Garbled
    record = tuple(int(n) for n in found.groups())
    if not all(-32768 <= n <= 32767 for n in record):
        raise Garbled
    return record


class State(enum.Enum):
    """Where the dialogue is."""

    QUIETENING = 0
    SETTING_UP = 1
    ASKING = 2


class ControllerLine:
    """Asks for one record after the other.

    Attributes:
        record: the last one. asked_tick: when it was asked for; its sample is not older.
        desyncs: how often the dialogue was lost with bytes on the line. in_step: it goes well.
        heard_tick: of the last byte, -1 for none.
    """

    def __init__(self, link: SerialLine, mode: str, period_s: float, reply_s: float) -> None:
        self._link, self._mode, self._setup = link, mode, SETUP[mode]
        self._quiet_ticks, self._reply_ticks = round(QUIET_S / period_s), round(reply_s / period_s)
        self._chunk, self._waiting = bytearray(BUFFER), bytearray()
        self._state, self._step, self._since = State.QUIETENING, 0, -1
        self.record: Record = ()
        self.asked_tick = self.heard_tick = -1
        self.desyncs, self.in_step = 0, True

    def turn(self, tick: int) -> bool:
        """Take in what came, and go on; True with a new record."""
        if self._since < 0:
            self._quieten(tick)
        came = self._collect(tick)
        late = tick - self._since > self._reply_ticks
        if len(self._waiting) > BUFFER:
            self._lose(tick)
        elif self._state is State.QUIETENING:
            self._waiting.clear()
            if came and not late:
                self._quiet_since = tick
            elif late and came:
                self._quieten(tick)
            elif tick - self._quiet_since >= self._quiet_ticks:
                self._step = 0
                self._say(self._setup[0], State.SETTING_UP, tick)
        elif self._state is State.SETTING_UP and self._waiting.endswith(b">"):
            self._step += 1
            done = self._step == len(self._setup)
            self._say(ASK if done else self._setup[self._step], State.ASKING if done else State.SETTING_UP, tick)
        elif self._state is State.ASKING and self._waiting:
            return self._listen(tick, late)
        elif late:
            self._lose(tick)
        return False

    def _collect(self, tick: int) -> bool:
        came = False
        while len(self._waiting) <= BUFFER and (size := self._link.receive(self._chunk)) > 0:
            self._waiting += memoryview(self._chunk)[:size]
            self.heard_tick, came = tick, True
        return came

    def _listen(self, tick: int, late: bool) -> bool:
        try:
            record = parse(bytes(self._waiting), self._mode)
        except Garbled:
            record = None
            late = True
        if record is None:
            if late:
                self._lose(tick)
            return False
        self.record, self.asked_tick, self.in_step = record, self._since, True
        self._say(ASK, State.ASKING, tick)
        return True

    def _lose(self, tick: int) -> None:
        if self._waiting:
            self.desyncs += 1
            self.in_step = False
        self._quieten(tick)

    def _quieten(self, tick: int) -> None:
        self._quiet_since = tick
        self._say(b"\r", State.QUIETENING, tick)

    def _say(self, command: bytes, state: State, tick: int) -> None:
        self._waiting.clear()
        self._link.send(command)
        self._state, self._since = state, tick
