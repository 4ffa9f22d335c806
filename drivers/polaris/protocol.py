"""The words of a Polaris: commands and replies in ASCII, each ended by a CRC-16 in four hex digits and CR (07 section 5)."""

import math
import re
from dataclasses import dataclass

CR = b"\r"
OUT_OF_VOLUME = 1 << 6
"""Bit of a tool's status: seen, but where the tracker is not characterised."""
NORM_TOLERANCE = 0.01
"""Of a quaternion of four decimals, with room for an older firmware."""
ERRORS = {
    0x01: "it does not know the command",
    0x02: "the command is too long",
    0x03: "the command is too short",
    0x04: "the command's CRC is wrong",
    0x05: "it gave up on the command",
    0x06: "it cannot talk at this rate",
    0x07: "the command has the wrong number of parameters",
    0x08: "there is no such port handle",
    0x0C: "it cannot do that in its present mode",
    0x0D: "the port handle has no tool",
    0x0E: "the port handle is not initialised",
    0x0F: "the port handle is not enabled",
    0x10: "it is not initialised",
    0x11: "it cannot stop tracking",
    0x12: "it cannot start tracking",
    0x13: "the tool definition is not complete or not for it",
}
"""What the error codes mean that a calibration meets."""
GARBLED = (0x01, 0x02, 0x03, 0x04)
"""Errors that a disturbed line makes of a good command."""

_TOOL = re.compile(
    r"(?P<handle>[0-9A-F]{2})(?:(?P<numbers>(?:[+-]\d{5}){4}(?:[+-]\d{6}){3}[+-]\d{5})|MISSING|(?P<off>DISABLED|UNOCCUPIED))"
    r"(?:(?P<status>[0-9A-F]{8})(?P<frame>[0-9A-F]{8}))?\n"
)
_NUMBERS = re.compile(r"([+-]\d{5})" * 4 + r"([+-]\d{6})" * 3 + r"([+-]\d{5})")


@dataclass(frozen=True)
class Pose:
    """A tool in the tracker's frame: unit quaternion (w, x, y, z), position [mm], and the tracker's rms of its markers [mm]."""

    quaternion: tuple[float, float, float, float]
    position_mm: tuple[float, float, float]
    error_mm: float


@dataclass(frozen=True)
class Seen:
    """What a reply says of one tool: `pose` None if it is not seen. `frame` counts the tracker's own, 60 a second."""

    handle: int
    frame: int
    status: int
    pose: Pose | None


def crc16(data: bytes) -> int:
    """CRC-16 with the reflected polynomial A001; of "OKAY" it is A896."""
    crc = 0
    for byte in data:
        crc ^= byte
        for _ in range(8):
            crc = crc >> 1 ^ (0xA001 if crc & 1 else 0)
    return crc


def frame(text: str) -> bytes:
    """A command ("INIT:") or reply ("OKAY") as it goes over the line."""
    data = text.encode("ascii")
    return data + b"%04X" % crc16(data) + CR


def unframe(line: bytes) -> str | None:
    """The text of a line without its CR; None if the CRC is not right. Never raises."""
    data, crc = line[:-4], line[-4:]
    if len(line) < 4 or crc != b"%04X" % crc16(data) or not data.isascii():
        return None
    return data.decode("ascii")


def error_of(text: str) -> int | None:
    """The code of an error reply, None for any other."""
    found = re.fullmatch(r"ERROR([0-9A-F]{2})", text)
    return int(found[1], 16) if found else None


def parse_tx(text: str) -> list[Seen] | None:
    """The tools in a reply to ``TX:0801``; None if it is none. Tools that are switched off are left out. Never raises."""
    head = re.match(r"[0-9A-F]{2}", text)
    if head is None:
        return None
    tools, at = [], 2
    for _ in range(int(head[0], 16)):
        found = _TOOL.match(text, at)
        if found is None:
            return None
        at = found.end()
        if found["off"]:
            continue
        if found["status"] is None:
            return None
        pose = _pose(found["numbers"]) if found["numbers"] else None
        tools.append(Seen(int(found["handle"], 16), int(found["frame"], 16), int(found["status"], 16), pose))
    return tools if re.fullmatch(r"[0-9A-F]{4}", text[at:]) else None


def _pose(numbers: str) -> Pose | None:
    """Four, two and four decimals without their points; None if the rotation is none."""
    found = _NUMBERS.fullmatch(numbers)
    if found is None:
        return None
    values = [int(v) for v in found.groups()]
    w, x, y, z = (v / 10_000 for v in values[:4])
    norm = math.sqrt(w * w + x * x + y * y + z * z)
    if abs(norm - 1.0) > NORM_TOLERANCE:
        return None
    a, b, c = (v / 100 for v in values[4:7])
    return Pose((w / norm, x / norm, y / norm, z / norm), (a, b, c), values[7] / 10_000)
