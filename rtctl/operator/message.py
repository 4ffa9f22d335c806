"""The operator's message: one fixed layout, believed only after every field was checked.

Reference for people who send it: docs/reference/formats/operator-message.md (source: 07 section 5).
"""

import enum
from typing import Annotated, Literal

import msgspec

from hal.errors import RtctlError

LARGEST_BYTES = 1024
FASTEST_MM_PER_S = 100.0
FASTEST_RAD_PER_S = 10.0

Frame = Literal["gripper", "base"]
Linear = Annotated[float, msgspec.Meta(ge=-FASTEST_MM_PER_S, le=FASTEST_MM_PER_S)]
Angular = Annotated[float, msgspec.Meta(ge=-FASTEST_RAD_PER_S, le=FASTEST_RAD_PER_S)]


class Button(enum.IntFlag):
    """Bits of `buttons`. A press counts once, when the bit rises; all but STOP only while the deadman counts."""

    STOP = 1
    """brake and hold; acts always, and the deadman must be released after it"""
    SLOWER = 2
    """one speed stage down"""
    FASTER = 4
    """one speed stage up"""
    INSERT = 8
    """one step on along the path"""
    RETRACT = 16
    """one step back along the path"""
    RESUME = 32
    """go on with the step that a released deadman paused"""


NO_BUTTON = Button(0)
ALL_BUTTONS = sum(Button)


class MessageError(RtctlError):
    """These bytes are no operator's message."""


class OperatorMessage(msgspec.Struct, forbid_unknown_fields=True, frozen=True, kw_only=True):
    """What the operator wants now. Every field is in every message."""

    version: Literal[1]
    source: Annotated[str, msgspec.Meta(min_length=1, max_length=64)]
    """name of the device; another one each time it is started"""
    sequence: Annotated[int, msgspec.Meta(ge=1, le=2**63 - 1)]
    """rises with every message of this source"""
    timestamp_ns: Annotated[int, msgspec.Meta(ge=0, le=2**63 - 1)]
    """Unix time when device and deadman were read"""
    frame: Frame
    """frame whose axes the twist is in; it is the twist of the gripper's tip in either"""
    twist: tuple[Linear, Linear, Linear, Angular, Angular, Angular]
    """vx, vy, vz [mm/s], wx, wy, wz [rad/s]"""
    buttons: Annotated[int, msgspec.Meta(ge=0, le=ALL_BUTTONS)]
    """the bits of :class:`Button` that are down now"""
    deadman: bool
    """the level of the deadman at `timestamp_ns`: held or not"""


_decoder = msgspec.json.Decoder(OperatorMessage)
encode = msgspec.json.Encoder().encode


def decode(payload: bytes) -> OperatorMessage:
    """The message in `payload`.

    Raises:
        MessageError: too long, not JSON, a field missing, unknown, of the wrong type, or out of its bounds.
    """
    if len(payload) > LARGEST_BYTES:
        raise MessageError("the message is too long", value=len(payload), bound=f"at most {LARGEST_BYTES} bytes")
    try:
        return _decoder.decode(payload)
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError) as error:
        remedy = "see docs/reference/formats/operator-message.md"
        raise MessageError(f"the message is malformed: {error}", remedy=remedy) from None
