"""The decoder: whatever bytes come, either a request of the right types or a refusal."""

import json
import math
import time

import msgspec
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rtctl.gateway import messages
from rtctl.gateway.keys import REQUESTS
from rtctl.gateway.messages import TYPES
from rtctl.gateway.refusal import Refusal

GOOD = {"source": "a", "sequence": 1, "timestamp_ns": 10**18, "valid_for_s": 0.5}
MOVE = REQUESTS["move_cp"]

values = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=5),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(max_size=5), inner, max_size=4),
    max_leaves=10,
)
names = st.sampled_from(
    ["source", "sequence", "timestamp_ns", "valid_for_s", "lease", "arguments", "names", "values", "setup", "scope", "seen", "offset"]
)  # fmt: skip
payloads = st.one_of(
    st.binary(max_size=200),
    values.map(lambda v: json.dumps(v).encode()),
    st.dictionaries(names, values).map(lambda d: json.dumps({**GOOD, **d}).encode()),
)


@settings(max_examples=300)
@given(st.sampled_from(sorted(REQUESTS)), payloads)
def test_any_bytes_decode_to_the_right_types_or_are_refused(name, payload):
    key = REQUESTS[name]
    try:
        request = messages.decode(key, payload)
    except Refusal as error:
        refusal = error
        request = None
    if request is None:
        assert refusal.reason == "malformed"
        assert refusal.remedy
        return
    assert isinstance(request, TYPES[key.kind])
    assert 0 < request.valid_for_s <= messages.MAX_VALIDITY_S
    assert request.sequence >= 1
    assert all(math.isfinite(a) for a in getattr(request, "arguments", []))
    assert msgspec.json.decode(msgspec.json.encode(request), type=type(request)) == request


@pytest.mark.parametrize(
    "change",
    [
        '"arguments": [NaN]',
        '"arguments": [Infinity]',
        '"arguments": [1e999]',
        '"arguments": [1e300]',
        '"arguments": ["1"]',
        '"arguments": [true]',
        '"arguments": [0,0,0,0,0,0,0,0,0]',
        '"speed": 1',
        '"sequence": 0',
        '"sequence": 99999999999999999999',
        '"source": ""',
        '"valid_for_s": 0',
        '"valid_for_s": 11',
        '"timestamp_ns": -1',
    ],
)
def test_what_is_wrong_is_refused(change):
    good = json.dumps({k: v for k, v in GOOD.items() if f'"{k}"' not in change})[:-1]
    with pytest.raises(Refusal) as refused:
        messages.decode(MOVE, f"{good}, {change}}}".encode())
    assert refused.value.reason == "malformed"


def test_deep_nesting_is_refused():
    with pytest.raises(Refusal):
        messages.decode(REQUESTS["param/set"], b'{"values": {"a": ' + b"[" * 60000)


@given(st.floats(-1, 20), st.floats(0.001, messages.MAX_VALIDITY_S))
def test_the_horizon(age_s, valid_for_s):
    now = time.time_ns()
    request = messages.CommandRequest(
        source="a", sequence=1, timestamp_ns=now - round(age_s * 1e9), valid_for_s=valid_for_s
    )
    if age_s < -messages.FUTURE_S - 1e-9:
        expected = "clock"
    elif age_s >= valid_for_s + 1e-9:
        expected = "expired"
    else:
        expected = ""
    try:
        left = request.remaining_s(now)
        assert 0 < left <= valid_for_s
        assert left == pytest.approx(min(valid_for_s - age_s, valid_for_s), abs=1e-6)
        reason = ""
    except Refusal as refusal:
        reason = refusal.reason
    near_edge = min(abs(age_s + messages.FUTURE_S), abs(age_s - valid_for_s)) < 1e-6
    assert near_edge or reason == expected


def test_numbers_that_are_none_do_not_reach_the_wire():
    reply = messages.refuse(Refusal("x", "text", "remedy", float("nan"), float("inf")))
    content = json.loads(messages.encode(reply))
    assert content == {"accepted": False, "reason": "x", "text": "text", "remedy": "remedy"}
