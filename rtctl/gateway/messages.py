"""Requests and replies on the wire: JSON, checked against types before anybody looks at them."""

import math
from typing import Annotated, Any, Protocol

import msgspec

from rtctl.gateway.keys import Key, Kind
from rtctl.gateway.refusal import Refusal
from rtctl.scope.setup import Setup

MAX_VALIDITY_S = 10.0
FUTURE_S = 0.1
"""A time stamp may be ahead by this much: clocks of two machines are not equal."""

Number = Annotated[float, msgspec.Meta(ge=-1e12, le=1e12)]


class Request(msgspec.Struct, forbid_unknown_fields=True, frozen=True, kw_only=True):
    """What every request carries."""

    source: Annotated[str, msgspec.Meta(min_length=1, max_length=64)]
    """name of the client, shown to the others"""
    sequence: Annotated[int, msgspec.Meta(ge=1, le=2**63 - 1)]
    """counts up with every request of this client"""
    timestamp_ns: Annotated[int, msgspec.Meta(ge=0, le=2**63 - 1)]
    """Unix time when it was sent"""
    valid_for_s: Annotated[float, msgspec.Meta(gt=0.0, le=MAX_VALIDITY_S)] = 0.5
    """it must not take effect later than this after `timestamp_ns`"""
    lease: Annotated[str, msgspec.Meta(max_length=64)] = ""
    """token of the lease, where one is needed"""

    def remaining_s(self, now_ns: int) -> float:
        """What is left of the validity at Unix time `now_ns`.

        Raises:
            Refusal: nothing is left, or the request comes from the future.
        """
        age = (now_ns - self.timestamp_ns) / 1e9
        if age < -FUTURE_S:
            remedy = "synchronise the clocks of the two machines"
            raise Refusal("clock", "the request is from the future", remedy, value=-age, bound=FUTURE_S)
        if age >= self.valid_for_s:
            remedy = "check the client's clock and the load of the machine, then send it again"
            raise Refusal("expired", "the request arrived after its validity ended", remedy, age, self.valid_for_s)
        return min(self.valid_for_s - age, self.valid_for_s)


class CommandRequest(Request, frozen=True, kw_only=True):
    """One verb with its numbers."""

    arguments: Annotated[list[Number], msgspec.Meta(max_length=8)] = []


class StateRequest(Request, frozen=True, kw_only=True):
    """CRTK's `state_command`."""

    command: str


class GetRequest(Request, frozen=True, kw_only=True):
    """Which parameters; none means all."""

    names: list[str] = []


class SetRequest(Request, frozen=True, kw_only=True):
    """Dotted names of live options and their new values."""

    values: Annotated[dict[str, Any], msgspec.Meta(min_length=1)]


class PlanRequest(Request, frozen=True, kw_only=True):
    """Compute a plan, or load the one in `plan`."""

    plan: dict[str, Any] | None = None
    """the document of a plan file, see docs/reference/files.md"""


class ScopeOpenRequest(Request, frozen=True, kw_only=True):
    """Begin a scope."""

    setup: Setup


class ScopeRequest(Request, frozen=True, kw_only=True):
    """Something about an open scope."""

    scope: Annotated[str, msgspec.Meta(min_length=1, max_length=64)]
    """its name, from the reply to `scope/open`"""
    seen: Annotated[int, msgspec.Meta(ge=0, le=2**31)] = 0
    """captures the client has in full; the gateway forgets them"""
    offset: Annotated[int, msgspec.Meta(ge=0, le=2**31)] = 0
    """bytes of the next capture that the client has"""


class Reply(msgspec.Struct, frozen=True, kw_only=True, omit_defaults=True):
    """The answer to a request."""

    accepted: bool
    tick: int | None = None
    """tick at which it takes effect"""
    reason: str = ""
    """one word for programs"""
    text: str = ""
    remedy: str = ""
    value: float | None = None
    bound: float | str | None = None
    result: dict[str, Any] = {}
    """what was asked for"""


class Answer(Protocol):
    """Takes the reply, and bytes that travel beside it; called once, from any thread."""

    def __call__(self, reply: Reply, data: bytes = b"") -> None: ...


TYPES: dict[Kind, type[Request]] = {
    Kind.VERB: CommandRequest,
    Kind.STATE_COMMAND: StateRequest,
    Kind.GET: GetRequest,
    Kind.SET: SetRequest,
    Kind.PLAN: PlanRequest,
    Kind.LIST: Request,
    Kind.LEASE: Request,
    Kind.STATUS: Request,
    Kind.SCOPE_OPEN: ScopeOpenRequest,
    Kind.SCOPE: ScopeRequest,
}
DECODERS = {kind: msgspec.json.Decoder(cls) for kind, cls in TYPES.items()}
encode = msgspec.json.Encoder().encode


def decode(key: Key, payload: bytes) -> Request:
    """The request in `payload`.

    Raises:
        Refusal: not JSON, a wrong or unknown field, a number that is none.
    """
    try:
        return DECODERS[key.kind].decode(payload)
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError) as error:
        raise Refusal("malformed", f"the request is malformed: {error}", "see docs/reference/keys.md") from None


def refuse(refusal: Refusal) -> Reply:
    """The reply that carries a refusal."""
    value = refusal.value if refusal.value is not None and math.isfinite(refusal.value) else None
    bound = None if isinstance(refusal.bound, float) and not math.isfinite(refusal.bound) else refusal.bound
    return Reply(
        accepted=False, reason=refusal.reason, text=refusal.text, remedy=refusal.remedy, value=value, bound=bound
    )
