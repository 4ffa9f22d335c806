"""Scopes in the gateway, without a network: hostile requests, limits, silence, and scopes that break."""

import json

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rtctl.gateway import messages, scopes
from rtctl.gateway.keys import REQUESTS
from rtctl.gateway.messages import Reply
from rtctl.gateway.refusal import Refusal
from rtctl.gateway.scopes import Scopes
from rtctl.log.format import CONTROLLER, TRUTH
from rtctl.record import controller_table
from rtctl.scope.scope import Scope
from sim_backends.plant.state import TABLE as TRUTH_TABLE

TABLES = {CONTROLLER: controller_table(3), TRUTH: TRUTH_TABLE}
GOOD = {"source": "a", "sequence": 1, "timestamp_ns": 10**18}
NOTHING = np.zeros(0)


@pytest.fixture(autouse=True, scope="module")
def _every_row_at_once():
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(scopes, "BATCH_ROWS", 1)
        yield


def rows(first: int, count: int) -> np.ndarray:
    made = np.zeros(count, TABLES[CONTROLLER].dtype)
    made["tick"] = np.arange(first, first + count)
    return made


def ask(desk: Scopes, name: str, **fields) -> tuple[Reply, bytes]:
    request = messages.decode(REQUESTS[f"scope/{name}"], json.dumps({**GOOD, **fields}).encode())
    return desk.answer(f"scope/{name}", request)


def begin(desk: Scopes, **setup) -> str:
    reply, _ = ask(desk, "open", setup={"signals": ["force_axial_n"], **setup})
    return reply.result["scope"]


numbers = st.one_of(st.integers(-2, 2**40), st.floats(), st.none(), st.booleans(), st.integers(1, 50))
names = st.one_of(
    st.sampled_from(["force_axial_n", "tick", "wrench_in_base[2]", "pose_measured", "truth.array_depth_mm", "x[", "a[99999999]"]),
    st.text(max_size=12),
)  # fmt: skip
triggers = st.fixed_dictionaries(
    {"kind": st.sampled_from(["free", "manual", "level", "edge", "event", "other"])},
    optional={
        "signal": names, "level": numbers, "side": st.sampled_from("<>="), "slope": st.sampled_from(["rising", "up"]),
        "event": st.one_of(st.sampled_from(["state:fault", "condition:overrun", "command:insert", "task:"]), st.text(max_size=9)),
    },
)  # fmt: skip
setups = st.fixed_dictionaries(
    {},
    optional={
        "signals": st.lists(names, max_size=3), "trigger": triggers, "samples": numbers, "pre": numbers,
        "decimation": numbers, "captures": numbers, "auto": numbers,
    },
)  # fmt: skip


@settings(max_examples=120, deadline=None)
@given(setups)
def test_any_setup_becomes_a_scope_or_is_refused(setup):
    desk = Scopes(TABLES)
    refused, token = None, ""
    try:
        token = ask(desk, "open", setup=setup)[0].result["scope"]
    except Refusal as refusal:
        refused = refusal
    assert len(desk) == (refused is None)
    if refused:
        assert refused.reason in ("malformed", "invalid_scope")
        assert refused.text
        assert refused.remedy
        return
    desk.feed(rows(0, 40), NOTHING)
    assert ask(desk, "state", scope=token)[0].result["state"] in ("filling", "waiting", "triggered", "resting", "done")


def test_a_capture_is_read_in_pieces_and_then_forgotten(monkeypatch):
    monkeypatch.setattr(scopes, "PIECE_BYTES", 100)
    desk = Scopes(TABLES)
    token = begin(desk, samples=10, captures=2)
    desk.feed(rows(5, 30), NOTHING)
    assert ask(desk, "state", scope=token)[0].result == {"state": "done", "filled": 0, "finished": 2}
    for seen in (0, 1):
        data, size = b"", 1
        while len(data) < size:
            reply, piece = ask(desk, "read", scope=token, seen=seen, offset=len(data))
            assert 0 < len(piece) <= 100
            data, size = data + piece, reply.result["size"]
        ticks = np.frombuffer(data, [("time_ns", "u8"), ("tick", "i8"), ("gaps", "i4", (2,)), ("force", "f8")])["tick"]
        assert ticks.tolist() == list(range(5 + 10 * seen, 15 + 10 * seen))
        assert reply.result["facts"]["number"] == seen
        with pytest.raises(Refusal) as refused:
            ask(desk, "read", scope=token, seen=seen, offset=len(data))
        assert refused.value.reason == "no_capture"
    with pytest.raises(Refusal) as refused:
        ask(desk, "read", scope=token, seen=2)
    assert refused.value.reason == "no_capture"
    ask(desk, "close", scope=token)
    assert len(desk) == 0


def test_there_are_only_so_many_scopes_of_only_so_many_bytes():
    desk = Scopes(TABLES)
    for _ in range(scopes.SCOPES):
        token = begin(desk)
    with pytest.raises(Refusal, match="of a") as refused:
        begin(desk)
    assert refused.value.reason == "too_many_scopes"
    ask(desk, "close", scope=token)
    begin(desk, signals=["wrench_in_base"], samples=scopes.CAPTURE_BYTES // 72)
    with pytest.raises(Refusal, match="too large") as refused:
        begin(desk, signals=["wrench_in_base"], samples=scopes.CAPTURE_BYTES // 72 + 1)
    assert refused.value.reason == "invalid_scope"


def test_captures_that_nobody_reads_do_not_pile_up(monkeypatch):
    monkeypatch.setattr(scopes, "CAPTURE_BYTES", 10_000)
    desk = Scopes(TABLES)
    token = begin(desk, samples=50, captures=1000)
    for k in range(20):
        desk.feed(rows(1000 * k, 1000), NOTHING)
    finished = ask(desk, "state", scope=token)[0].result
    assert finished == {"state": "resting", "filled": 0, "finished": 10_000 // (50 * 32)}


def test_a_scope_dies_with_its_client(monkeypatch):
    now_s = 0.0
    monkeypatch.setattr(scopes.time, "monotonic", lambda: now_s)
    desk = Scopes(TABLES)
    alive, silent = begin(desk), begin(desk)
    now_s = 0.9 * scopes.SILENT_S
    ask(desk, "state", scope=alive)
    now_s = 1.5 * scopes.SILENT_S
    desk.feed(rows(0, 1), NOTHING)
    ask(desk, "state", scope=alive)
    with pytest.raises(Refusal) as refused:
        ask(desk, "state", scope=silent)
    assert refused.value.reason == "no_scope"


def test_rows_are_collected_for_a_while_and_a_forced_trigger_is_not_of_the_past(monkeypatch):
    monkeypatch.setattr(scopes, "BATCH_ROWS", 256)
    monkeypatch.setattr(scopes, "BATCH_S", 60.0)
    desk = Scopes(TABLES)
    token = begin(desk, samples=5, trigger={"kind": "manual"})
    desk.feed(rows(0, 1), NOTHING)
    for k in range(1, 30):
        desk.feed(rows(k, 1), NOTHING)
    ask(desk, "force", scope=token)
    desk.feed(rows(30, 250), NOTHING)
    assert ask(desk, "state", scope=token)[0].result["finished"] == 0
    desk.feed(rows(280, 6), NOTHING)
    assert ask(desk, "read", scope=token)[0].result["facts"]["trigger_tick"] == 30


def test_a_scope_that_breaks_harms_nobody_else(monkeypatch):
    desk = Scopes(TABLES)
    broken, good = begin(desk, trigger={"kind": "manual"}), begin(desk, samples=5)
    feed = Scope.feed

    def fails(scope, batch):
        if str(scope.setup.trigger) == "a manual trigger":
            raise ZeroDivisionError("a bug")
        feed(scope, batch)

    monkeypatch.setattr(Scope, "feed", fails)
    desk.feed(rows(0, 5), NOTHING)
    assert ask(desk, "state", scope=good)[0].result["finished"] == 1
    with pytest.raises(Refusal, match="a bug"):
        ask(desk, "state", scope=broken)
