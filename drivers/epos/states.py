"""The state machine of CiA 402: what a statusword says, and which controlword leads on (07 section 2.3)."""

import enum


class State(enum.IntEnum):
    """Of a drive."""

    NOT_READY = 0
    DISABLED = 1
    """switch-on disabled"""
    READY = 2
    SWITCHED_ON = 3
    ENABLED = 4
    QUICK_STOP = 5
    REACTING = 6
    """to a fault"""
    FAULT = 7
    UNKNOWN = 8
    """nothing heard yet, or no such statusword"""


SHUTDOWN, SWITCH_ON, ENABLE, QUICK_STOP, DISABLE, FAULT_RESET = 0x06, 0x07, 0x0F, 0x02, 0x00, 0x80
NEW_SETPOINT, AT_ONCE = 0x10, 0x20
FOLLOWS = ACKNOWLEDGES = 1 << 12
_PATTERNS = (
    (0x4F, 0x00, State.NOT_READY), (0x4F, 0x40, State.DISABLED), (0x6F, 0x21, State.READY),
    (0x6F, 0x23, State.SWITCHED_ON), (0x6F, 0x27, State.ENABLED), (0x6F, 0x07, State.QUICK_STOP),
    (0x4F, 0x0F, State.REACTING), (0x4F, 0x08, State.FAULT),
)  # fmt: skip
_ON_THE_WAY_UP = {State.DISABLED: SHUTDOWN, State.READY: SWITCH_ON, State.SWITCHED_ON: ENABLE, State.ENABLED: ENABLE, State.QUICK_STOP: QUICK_STOP}  # fmt: skip


def _decode(word: int) -> State:
    return next((state for mask, value, state in _PATTERNS if word & mask == value), State.UNKNOWN)


STATE_OF = tuple(_decode(word) for word in range(0x80))
"""State by the low seven bits of the statusword."""
UPWARD = tuple(_ON_THE_WAY_UP.get(state, DISABLE) for state in State)
"""Controlword that leads one step towards ENABLED, by state; out of a fault there is none."""
