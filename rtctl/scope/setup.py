"""What a scope is asked to do: signals, trigger, and how much to keep around it."""

import re
from typing import Annotated, Any, Literal

import msgspec
from msgspec import Meta

from hal.errors import RtctlError

Number = Annotated[float, Meta(ge=-1e12, le=1e12)]
Name = Annotated[str, Meta(min_length=1, max_length=80)]
Slope = Literal["rising", "falling", "either"]


class ScopeError(RtctlError):
    """A scope cannot do what it is asked to."""

    exit_code = 2


class Free(msgspec.Struct, frozen=True, forbid_unknown_fields=True, tag_field="kind", tag="free"):
    """Captures at once."""

    def __str__(self) -> str:
        return "nothing"


class Manual(msgspec.Struct, frozen=True, forbid_unknown_fields=True, tag_field="kind", tag="manual"):
    """Waits to be forced."""

    def __str__(self) -> str:
        return "a manual trigger"


class Level(msgspec.Struct, frozen=True, forbid_unknown_fields=True, tag_field="kind", tag="level"):
    """Fires as long as the signal is below, or above, `level`; NaN is neither."""

    signal: Name
    side: Literal["<", ">"]
    level: Number

    def __str__(self) -> str:
        return f"{self.signal} {self.side} {self.level:g}"


class Edge(msgspec.Struct, frozen=True, forbid_unknown_fields=True, tag_field="kind", tag="edge"):
    """Fires when the signal comes to `level`: rising from below it, falling from above it. NaN is on neither side."""

    signal: Name
    level: Number
    slope: Slope

    def __str__(self) -> str:
        return f"{self.signal} crossing {self.level:g}, {self.slope}"


class Event(msgspec.Struct, frozen=True, forbid_unknown_fields=True, tag_field="kind", tag="event"):
    """Fires when something begins, as the diary tells it: KIND:NAME with the kind condition, command, state or task."""

    event: Name

    def __str__(self) -> str:
        return f"the event {self.event}"


FAULT = Event("state:fault")
"""The first tick in the operating state FAULT."""

Trigger = Free | Manual | Level | Edge | Event


class Setup(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """One scope."""

    signals: Annotated[tuple[Name, ...], Meta(min_length=1, max_length=64)]
    """``force_axial_n``, ``wrench_in_base[2]``, ``pose_measured`` (all of it), ``truth.array_depth_mm`` (simulations)"""
    trigger: Trigger = Free()
    samples: Annotated[int, Meta(ge=1, le=1_000_000)] = 1000
    """length of a capture"""
    pre: Annotated[int, Meta(ge=0, le=1_000_000)] = 0
    """how many of them lie before the trigger"""
    decimation: Annotated[int, Meta(ge=1, le=10_000)] = 1
    """of so many ticks one is kept: those whose number is a multiple; the trigger looks at all of them"""
    captures: Annotated[int, Meta(ge=1, le=1000)] = 1
    """how many; after each one the scope is armed anew, and no two captures share a sample"""
    auto: bool = False
    """capture also without a trigger, after it has been waited for as long as a capture is"""

    def __post_init__(self) -> None:
        if self.pre >= self.samples:
            raise ValueError(f"`pre` must be less than `samples`: {self.pre} of {self.samples}")


def make_setup(**fields: Any) -> Setup:
    """A setup of plain values and triggers, checked.

    Raises:
        ScopeError: a value is of the wrong type or out of its bounds.
    """
    try:
        return msgspec.convert(msgspec.to_builtins(fields), Setup)
    except (msgspec.ValidationError, TypeError) as error:
        raise ScopeError(
            f"not a setup of a scope: {error}", remedy="see docs/how-to/capture-with-the-scope.md"
        ) from None


EXPRESSION = re.compile(r"\s*([^\s<>=]+)\s*([<>])\s*(\S+)\s*")


def parse_trigger(text: str, edge: str = "") -> Level | Edge:
    """The trigger of ``'force_axial_n < -0.05'``: the level itself, or the edge at it if `edge` names a slope.

    Raises:
        ScopeError: not of this form, no finite number, or an edge that leads away from the level.
    """
    match = EXPRESSION.fullmatch(text)
    try:
        if match is None:
            raise ValueError
        side, where = match[2], {"signal": match[1], "level": float(match[3])}
        if not edge:
            return msgspec.convert({"kind": "level", "side": side, **where}, Level)
        allowed = ("rising" if side == ">" else "falling", "either")
        if edge in allowed:
            return msgspec.convert({"kind": "edge", "slope": edge, **where}, Edge)
    except ValueError:  # msgspec's is one, too
        remedy = "write SIGNAL < NUMBER or SIGNAL > NUMBER, as in 'force_axial_n < -0.05'"
        raise ScopeError("not a trigger", value=text, remedy=remedy) from None
    remedy = "a falling edge ends below its level (<), a rising one above it (>)"
    raise ScopeError(f"no such edge at {text.strip()!r}", value=edge, bound=" | ".join(allowed), remedy=remedy)
