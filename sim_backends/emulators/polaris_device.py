"""A Polaris at the end of a serial line: modes, port handles, tool definitions, poses of a scene (07 section 5).

It has no clock: every request for poses sees the next frame.

Faults, by :meth:`EmulatedPolaris.inject`; 0 mends:

    missing          tool `value` (from 1 on, in the order they were requested) is hidden
    out_of_volume    tool `value` is outside the characterised volume
    stalled          frames do not advance
    mute             the next `value` replies do not come
    corrupt          the next `value` replies have a wrong CRC
    noise            bytes without meaning come before the next `value` replies
    garbled          the next `value` commands arrive with a wrong bit
    restart          once: it starts anew, as after a loss of power
"""

import re
from collections.abc import Callable

from hal.errors import BackendError

Transform = tuple[float, ...]
"""Quaternion (w, x, y, z) and position [mm] of a tool in the tracker's frame."""
FRAMES_A_REQUEST = 3
"""60 frames a second, 20 replies."""
BAUDS = {"0": 9600, "1": 14_400, "2": 19_200, "3": 38_400, "4": 57_600, "5": 115_200}
OCCUPIED, INITIALISED, ENABLED, OUT_OF_VOLUME = 0x01, 0x10, 0x20, 0x40
BLOCK, COMMAND_MAX = 64, 256


class Refused(Exception):
    """A command is answered by an error code."""


class Tool:
    """What is behind a port handle."""

    def __init__(self) -> None:
        self.image: dict[int, bytes] = {}
        self.is_initialised = self.is_enabled = False

    @property
    def status(self) -> int:
        """Its status bits."""
        return OCCUPIED * bool(self.image) | INITIALISED * self.is_initialised | ENABLED * self.is_enabled

    def is_whole(self) -> bool:
        """True if the definition was written without a hole, and is one."""
        return (
            sorted(self.image) == list(range(0, BLOCK * len(self.image), BLOCK))
            and self.image.get(0, b"")[:3] == b"NDI"
        )


class EmulatedPolaris:
    """Answers bytes with bytes; `scene(tool, step)` gives the pose of a tool, counted from 0, at a step of the scene."""

    faults = ("missing", "out_of_volume", "stalled", "mute", "corrupt", "noise", "garbled", "restart")

    def __init__(self, scene: Callable[[int, int], Transform]) -> None:
        self._scene = scene
        self.step = 0
        self._fault = dict.fromkeys(self.faults, 0)
        self._start()

    def _start(self) -> None:
        self.baud = 9600
        self._is_initialised = self._is_tracking = False
        self._tools: dict[int, Tool] = {}
        self._frame = 0
        self._waiting = b""

    def restart(self) -> bytes:
        """Power or a break: what it says when it is there again."""
        self._start()
        return _framed("RESET")

    def feed(self, data: bytes) -> bytes:
        """Bytes from the host at the right rate; what is answered."""
        self._waiting += data
        answer = b""
        while b"\r" in self._waiting:
            line, _, self._waiting = self._waiting.partition(b"\r")
            answer += self._answer(line)
        return answer

    def inject(self, fault: str, value: float = 1.0) -> None:
        """See the head of this file."""
        if fault not in self.faults:
            raise BackendError("the emulated tracker knows no such fault", value=fault, bound=" | ".join(self.faults))
        self._fault[fault] = int(value)

    def _answer(self, line: bytes) -> bytes:
        if self._takes("restart"):
            return self.restart()
        if self._takes("garbled") and line:
            line = bytes([line[0] ^ 2]) + line[1:]
        try:
            text = self._obey(*_parsed(line))
        except Refused as error:
            text = f"ERROR{error.args[0]:02X}"
        if self._takes("mute"):
            return b""
        data = _framed(text)
        if self._takes("corrupt"):
            data = bytes([data[0] ^ 4]) + data[1:]
        return b"\x00\xffKX1\r" + data if self._takes("noise") else data

    def _takes(self, fault: str) -> bool:
        left = self._fault[fault]
        self._fault[fault] = max(left - 1, 0)
        return left > 0

    def _obey(self, name: str, rest: str) -> str:
        obey = {
            "INIT": self._init, "COMM": self._comm, "PHRQ": self._request, "PVWR": self._write, "PINIT": self._initialise,
            "PENA": self._enable, "PHSR": self._list, "PHF": self._free, "TSTART": self._track, "TSTOP": self._end, "TX": self._poses,
        }.get(name)  # fmt: skip
        if obey is None:
            raise Refused(0x01)
        if name not in ("INIT", "COMM") and not self._is_initialised:
            raise Refused(0x10)
        if self._is_tracking != (name in ("TX", "TSTOP")) and name != "PHSR":
            raise Refused(0x0C)
        return obey(rest)

    def _init(self, _: str) -> str:
        self._is_initialised = True
        return "OKAY"

    def _comm(self, rest: str) -> str:
        if len(rest) != 5 or rest[0] not in BAUDS or rest[1:] != "0000":
            raise Refused(0x06)
        self.baud = BAUDS[rest[0]]
        return "OKAY"

    def _request(self, rest: str) -> str:
        if not re.fullmatch(r"\*{8}[*01]1(\*\*|[0-9A-F]{2})\*\*", rest):
            raise Refused(0x07)
        handle = next(h for h in range(1, 256) if h not in self._tools)
        self._tools[handle] = Tool()
        return f"{handle:02X}"

    def _tool(self, rest: str) -> Tool:
        tool = self._tools.get(int(rest[:2], 16)) if re.match("[0-9A-F]{2}", rest) else None
        if tool is None:
            raise Refused(0x08)
        return tool

    def _write(self, rest: str) -> str:
        tool = self._tool(rest)
        if not re.fullmatch(r"[0-9A-F]{6}[0-9A-Fa-f]{128}", rest) or int(rest[2:6], 16) % BLOCK:
            raise Refused(0x07)
        tool.image[int(rest[2:6], 16)] = bytes.fromhex(rest[6:])
        return "OKAY"

    def _initialise(self, rest: str) -> str:
        tool = self._tool(rest)
        if not tool.image:
            raise Refused(0x0D)
        if not tool.is_whole():
            raise Refused(0x13)
        tool.is_initialised = True
        return "OKAY"

    def _enable(self, rest: str) -> str:
        tool = self._tool(rest)
        if rest[2:] not in ("S", "D", "B"):
            raise Refused(0x09)
        if not tool.is_initialised:
            raise Refused(0x0E)
        tool.is_enabled = True
        return "OKAY"

    def _free(self, rest: str) -> str:
        self._tool(rest)
        del self._tools[int(rest, 16)]
        return "OKAY"

    def _list(self, rest: str) -> str:
        wanted = {
            "": lambda _: True, "00": lambda _: True, "01": lambda _: False, "02": lambda t: t.image and not t.is_initialised,
            "03": lambda t: t.is_initialised and not t.is_enabled, "04": lambda t: t.is_enabled,
        }.get(rest)  # fmt: skip
        if wanted is None:
            raise Refused(0x07)
        chosen = [(h, t) for h, t in self._tools.items() if wanted(t)]
        return f"{len(chosen):02X}" + "".join(f"{h:02X}{t.status:03X}" for h, t in chosen)

    def _track(self, rest: str) -> str:
        if rest not in ("", "40", "80"):
            raise Refused(0x07)
        self._is_tracking = True
        self._frame = 0 if rest == "80" else self._frame
        return "OKAY"

    def _end(self, _: str) -> str:
        self._is_tracking = False
        return "OKAY"

    def _poses(self, rest: str) -> str:
        if rest not in ("", "0001", "0801"):
            raise Refused(0x07)
        if not self._fault["stalled"]:
            self._frame = (self._frame + FRAMES_A_REQUEST) & 0xFFFFFFFF
        shown = [(i, h, t) for i, (h, t) in enumerate(self._tools.items()) if t.is_enabled]
        return f"{len(shown):02X}" + "".join(self._seen(*each, rest == "0801") for each in shown) + "0000"

    def _seen(self, index: int, handle: int, tool: Tool, with_outside: bool) -> str:
        is_outside = self._fault["out_of_volume"] == index + 1
        tail = f"{tool.status | OUT_OF_VOLUME * is_outside:08X}{self._frame:08X}\n"
        if self._fault["missing"] == index + 1 or (is_outside and not with_outside):
            return f"{handle:02X}MISSING{tail}"
        *quaternion, x, y, z = self._scene(index, self.step)
        turn = "".join(f"{round(v * 10_000):+06d}" for v in quaternion)
        place = "".join(f"{round(v * 100):+07d}" for v in (x, y, z))
        return f"{handle:02X}{turn}{place}+00123{tail}"


def _crc(data: bytes) -> int:
    crc = 0
    for byte in data:
        for bit in range(8):
            feedback = (crc ^ byte >> bit) & 1
            crc = crc >> 1 ^ 0xA001 * feedback
    return crc


def _framed(text: str) -> bytes:
    data = text.encode()
    return data + f"{_crc(data):04X}".encode() + b"\r"


def _parsed(line: bytes) -> tuple[str, str]:
    """Name and parameters: "NAME:parameters" with a CRC, or "NAME parameters" without."""
    if len(line) > COMMAND_MAX:
        raise Refused(0x02)
    text = line.decode("latin-1")
    found = re.fullmatch(r"([A-Z]+)(?: (.*)|:(.*)([0-9A-F]{4}))", text, re.DOTALL)
    if found is None:
        raise Refused(0x01)
    if found[4] is None:
        return found[1], found[2]
    if int(found[4], 16) != _crc(line[:-4]):
        raise Refused(0x04)
    return found[1], found[3]
