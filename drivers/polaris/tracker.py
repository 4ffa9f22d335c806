"""A client of a Polaris over its serial line: start it, load tools, ask for poses. It waits, so it has no place in the loop."""

import re
import time
from collections import Counter
from pathlib import Path

from drivers.polaris import protocol
from drivers.polaris.line import TrackerLine
from drivers.polaris.protocol import GARBLED, OUT_OF_VOLUME, Pose
from hal.errors import BackendError

SLOW, FAST = 9600, 115_200
COMM_FAST = "COMM:50000"
"""115200 baud, 8N1, no handshake."""
RESET_S, REPLY_S, SWITCH_S = 2.0, 2.0, 0.1
"""Longest wait for the word after a break; for a reply; and how long the tracker takes to change its rate [U]."""
ATTEMPTS = 3
PAUSE_S = 0.001
LINE_MAX = 4096
"""Bytes without a CR that are no reply any more."""
BLOCK, ROM_MAX = 64, 1024
"""A tool definition is written in blocks of 64 bytes, and is at most so long."""
POSES = "TX:0801"
"""All tools, those outside the characterised volume, too: they are told apart by their status."""


class Tracker:
    """A tracker on `line`; use it as a context, which ends tracking and closes the line.

    Attributes:
        counts: desyncs (replies that were none), repeats (frames asked for twice), missing_NAME and outside_NAME by tool.
    """

    def __init__(self, line: TrackerLine, *, reset_s: float = RESET_S, reply_s: float = REPLY_S) -> None:
        self._line, self._reset_s, self._reply_s = line, reset_s, reply_s
        self._buffer, self._waiting = bytearray(LINE_MAX), bytearray()
        self._tools: dict[int, str] = {}
        self._frames: dict[int, int] = {}
        self.counts: Counter[str] = Counter()

    def __enter__(self) -> "Tracker":
        return self

    def __exit__(self, *_: object) -> None:
        try:
            if self._frames:
                self.stop()
        except BackendError:
            pass  # a tracker that is gone has stopped
        finally:
            self._line.close()

    def connect(self) -> None:
        """Reset and initialise it, and go to 115200 baud. Raises BackendError if nobody answers, or answers something else."""
        for baud in (SLOW, FAST):  # a tracker that does not hear the break keeps the rate of the session before
            self._line.set_baud(baud)
            if baud == SLOW:
                self._line.send_break()
                self._reply(self._reset_s)
            try:
                self._expect("INIT:")
            except BackendError:
                if baud == FAST:
                    raise
            else:
                break
        if baud == SLOW:
            self._expect(COMM_FAST)
            time.sleep(SWITCH_S)
            self._line.set_baud(FAST)
        self._free_all()

    def load(self, rom: Path) -> int:
        """Load a wireless tool from its definition file, enable it; its port handle. Raises BackendError."""
        try:
            data = rom.read_bytes()
        except OSError as error:
            raise BackendError(
                "the tool definition cannot be read", value=str(rom), remedy=str(error.strerror)
            ) from None
        if not 0 < len(data) <= ROM_MAX:
            raise BackendError("this is no tool definition", value=f"{rom}, {len(data)} bytes", bound=f"1 .. {ROM_MAX} bytes", remedy="give the .rom file that came with the tool")  # fmt: skip
        handle = self._exchange("PHRQ:*********1****")
        if not re.fullmatch("[0-9A-F]{2}", handle):
            raise BackendError("the tracker gave no port handle", value=handle)
        for at in range(0, len(data), BLOCK):
            self._expect(f"PVWR:{handle}{at:04X}{data[at : at + BLOCK].ljust(BLOCK, bytes(1)).hex().upper()}")
        self._expect(f"PINIT:{handle}")
        self._expect(f"PENA:{handle}D")
        self._tools[int(handle, 16)] = rom.stem
        return int(handle, 16)

    def enabled(self) -> list[int]:
        """Handles of the tools that the tracker itself says are enabled. Raises BackendError."""
        return self._handles("04")

    def start(self) -> None:
        """Begin to track; its frames count from here. Raises BackendError."""
        self._expect("TSTART:80", worked_before=0x0C)
        self._frames = dict.fromkeys(self._tools, -1)

    def stop(self) -> None:
        """End tracking. Raises BackendError."""
        self._expect("TSTOP:", worked_before=0x0C)
        self._frames = {}

    def poses(self) -> dict[int, tuple[int, Pose | None]]:
        """Frame number and pose of every tool of which there is a new frame, by handle.

        The pose is None, and counted, where the tool is hidden or outside the characterised volume. A frame that was given
        before is left out: no pose is given twice.

        Raises:
            BackendError: the tracker does not answer, or started anew.
        """
        text = self._exchange(POSES)
        seen = protocol.parse_tx(text)
        if seen is None:
            raise BackendError("the tracker's poses cannot be read", value=text[:40], remedy="check its firmware: it must know TX:0801")  # fmt: skip
        new = {}
        for tool in seen:
            name = self._tools.get(tool.handle)
            if name is None:
                continue
            if tool.frame == self._frames[tool.handle]:
                self.counts["repeats"] += 1
                continue
            self._frames[tool.handle] = tool.frame
            pose = tool.pose
            if pose is None:
                self.counts[f"missing_{name}"] += 1
            elif tool.status & OUT_OF_VOLUME:
                self.counts[f"outside_{name}"] += 1
                pose = None
            new[tool.handle] = (tool.frame, pose)
        return new

    def _free_all(self) -> None:
        """Tools of a session before, which would be reported, too."""
        for handle in self._handles("00"):
            self._expect(f"PHF:{handle:02X}")

    def _handles(self, which: str) -> list[int]:
        text = self._exchange(f"PHSR:{which}")
        if not re.fullmatch("[0-9A-F]{2}(?:[0-9A-F]{5})*", text) or len(text) != 2 + 5 * int(text[:2], 16):
            raise BackendError("the tracker's list of tools cannot be read", value=text[:40])
        return [int(text[at : at + 2], 16) for at in range(2, len(text), 5)]

    def _expect(self, command: str, worked_before: int | None = None) -> None:
        text = self._exchange(command, worked_before)
        if text != "OKAY" and not text.startswith("WARNING"):
            raise BackendError(f"the tracker does not accept {command.partition(':')[0]}", value=text[:40])

    def _exchange(self, command: str, worked_before: int | None = None) -> str:
        """Send and wait, up to three times; an error `worked_before` of a repeated command means its first reply was lost."""
        name = command.partition(":")[0]
        for attempt in range(ATTEMPTS):
            while self._line.receive(self._buffer) > 0:
                pass  # what came too late for the command before
            self._waiting.clear()
            self._line.send(protocol.frame(command))
            text = self._reply(self._reply_s)
            if text is None:
                self.counts["desyncs"] += 1
                continue
            if text == "RESET":
                raise BackendError("the tracker started anew: its tools are gone", value=name, remedy="check its power, then begin again")  # fmt: skip
            code = protocol.error_of(text)
            if code is None:
                return text
            if attempt and code == worked_before:
                return "OKAY"
            if code not in GARBLED or attempt == ATTEMPTS - 1:
                raise BackendError(f"the tracker refuses {name}", value=text, remedy=protocol.ERRORS.get(code, "look the code up in its manual"))  # fmt: skip
            self.counts["desyncs"] += 1
        raise BackendError(f"the tracker does not answer {name}", value=f"{ATTEMPTS} attempts", remedy="check its power, the cable and the port")  # fmt: skip

    def _reply(self, within_s: float) -> str | None:
        """The next line with a good CRC; None for silence, a bad CRC, or no end."""
        end = time.monotonic() + within_s
        while (at := self._waiting.find(protocol.CR)) < 0:
            count = self._line.receive(self._buffer)
            if count > 0:
                self._waiting += self._buffer[:count]
            elif time.monotonic() > end:
                return None
            else:
                time.sleep(PAUSE_S)
            if len(self._waiting) > LINE_MAX:
                return None
        line = bytes(self._waiting[:at])
        del self._waiting[: at + 1]
        return protocol.unframe(line)
