"""The state machine: what comes out is what a slow, obvious scope gives, however the rows are cut into pieces."""

import itertools
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rtctl.commands import Reason, Verb
from rtctl.lifecycle import Condition, Operating
from rtctl.log.format import CONTROLLER
from rtctl.record import controller_table
from rtctl.scope.probe import Rows
from rtctl.scope.scope import Scope, State
from rtctl.scope.setup import FAULT, Edge, Event, Free, Level, Manual, ScopeError, make_setup

TABLES = {CONTROLLER: controller_table(3)}
SIGNAL = "force_axial_n"
TRIGGERS = [
    Free(), Manual(), FAULT, Event("condition:force_limit"), Event("command:insert"), Event("task:inserting"),
    *(Level(SIGNAL, side, level) for side in "<>" for level in (0.0, 1.0)),
    *(Edge(SIGNAL, 0.5, slope) for slope in ("rising", "falling", "either")),
    *(Edge(SIGNAL, 1.0, slope) for slope in ("rising", "falling", "either")),
]  # fmt: skip


def rows_of(n: int, **fields) -> np.ndarray:
    rows = np.zeros(n, TABLES[CONTROLLER].dtype)
    rows["tick"] = np.arange(n)
    for name, values in fields.items():
        rows[name] = values
    rows["time_ns"] = 1_000_000 * rows["tick"] + 7
    return rows


@st.composite
def streams(draw):
    """Rows with gaps of both kinds, values around the levels, and everything events are made of."""
    n, rng = draw(st.integers(0, 60)), np.random.default_rng(draw(st.integers(0, 2**32)))
    numbers = lambda low, high: rng.integers(low, high, n, endpoint=True)  # noqa: E731
    missed, lost = np.maximum(numbers(-6, 3), 0), np.maximum(numbers(-9, 2), 0)
    values = np.array([-0.5, 0.0, 0.5, 1.0, 1.5, math.nan])[numbers(0, 5)]
    return rows_of(
        n,
        tick=draw(st.integers(0, 9)) + np.cumsum(1 + missed + lost),
        missed_ticks=missed,
        force_axial_n=values,
        operating_state=numbers(0, 3),
        task_state=numbers(2, 4),
        condition_active=numbers(0, 1) << Condition.FORCE_LIMIT,
        command_verb=np.where(numbers(0, 3) == 0, Verb.INSERT, Verb.NONE),
        command_verdict=numbers(1, 2),
    )


def fires(trigger, row, last) -> bool:
    value, before = float(row[SIGNAL]), math.nan if last is None else float(last[SIGNAL])
    if isinstance(trigger, Level):
        return value < trigger.level if trigger.side == "<" else value > trigger.level
    if isinstance(trigger, Edge):
        rising = before < trigger.level <= value
        falling = before > trigger.level >= value
        return {"rising": rising, "falling": falling, "either": rising or falling}[trigger.slope]
    if isinstance(trigger, Event):
        if trigger.event == "command:insert":
            return bool(row["command_verb"] == Verb.INSERT and row["command_verdict"] == Reason.ACCEPTED)
        holds = {
            "state:fault": lambda r: r["operating_state"] == Operating.FAULT,
            "condition:force_limit": lambda r: int(r["condition_active"]) == 1 << Condition.FORCE_LIMIT,
            "task:inserting": lambda r: r["task_state"] == 3,
        }[trigger.event]
        return bool(last is not None and holds(row) and not holds(last))
    return isinstance(trigger, Free)


def slow_scope(rows, setup, forced):
    """One row after the other, by the words of the documentation."""
    captures, samples, waiting_since, at, order = [], [], None, None, False
    missed = lost = 0
    for i, row in enumerate(rows):
        last = rows[i - 1] if i else None
        if len(captures) == setup.captures:
            break
        missed += int(row["missed_ticks"])
        lost += 0 if last is None else int(row["tick"] - last["tick"]) - 1 - int(row["missed_ticks"])
        order = order or (i in forced and at is None)
        if at is None and len(samples) >= setup.pre:
            waiting_since = row["tick"] if waiting_since is None else waiting_since
            overdue = setup.auto and row["tick"] - waiting_since >= setup.samples * setup.decimation
            if order or overdue or fires(setup.trigger, row, last):
                at, samples = int(row["tick"]), samples[len(samples) - setup.pre :]
        if row["tick"] % setup.decimation == 0:
            samples.append((int(row["tick"]), float(row[SIGNAL]), missed, lost))
            missed = lost = 0
        if at is not None and len(samples) == setup.samples:
            captures.append((at, [(s[0], s[1], *(s[2:] if k else (0, 0))) for k, s in enumerate(samples)]))
            samples, waiting_since, at, order = [], None, None, False
    return captures


@settings(max_examples=200, deadline=None)
@given(
    streams(), st.sampled_from(TRIGGERS), st.integers(1, 12), st.integers(0, 11), st.integers(1, 3), st.integers(1, 4),
    st.booleans(), st.sets(st.integers(0, 60)), st.sets(st.integers(0, 60), max_size=3),
)  # fmt: skip
def test_any_pieces_give_what_a_slow_scope_gives(rows, trigger, samples, pre, decimation, captures, auto, cuts, forced):
    setup = make_setup(
        signals=[SIGNAL], trigger=trigger, samples=samples, pre=pre % samples, decimation=decimation,
        captures=captures, auto=auto,
    )  # fmt: skip
    scope = Scope(setup, TABLES)
    edges = sorted({0, len(rows), *(c for c in cuts | forced if c < len(rows))})
    for start, end in itertools.pairwise(edges):
        if start in forced:
            scope.force()
        scope.feed(Rows(rows[start:end].copy()))
    got = [(c.trigger_tick, list(zip(*(c[n].tolist() for n in ("tick", SIGNAL, "missed", "lost")), strict=True)))
           for c in scope.finished]  # fmt: skip
    np.testing.assert_equal(got, slow_scope(rows, setup, forced))
    assert all(c.rows["tick"][c.trigger_index] >= c.trigger_tick and len(c) == samples for c in scope.finished)
    assert (scope.state is State.DONE) == (len(got) == captures)


def scope_of(trigger, **fields) -> Scope:
    return Scope(make_setup(signals=[SIGNAL, "wrench_in_base[2]", "pose_measured"], trigger=trigger, **fields), TABLES)


def test_a_capture_is_the_rows_around_the_edge():
    rows = rows_of(500, force_axial_n=-np.linspace(0.0, 0.1, 500))
    rows["wrench_in_base"][:, 2], rows["pose_measured"][:, 1] = rows["tick"], 2 * rows["tick"]
    scope = scope_of(Edge(SIGNAL, -0.05, "falling"), samples=100, pre=30)
    scope.feed(Rows(rows))
    (capture,) = scope.finished
    first = int(np.flatnonzero(rows[SIGNAL] <= -0.05)[0])
    expected = rows[first - 30 : first + 70]
    assert capture.trigger_tick == first
    assert capture.cause == "trigger"
    for name in ("tick", "time_ns", SIGNAL, "pose_measured"):
        np.testing.assert_array_equal(capture[name], expected[name])
    np.testing.assert_array_equal(capture["wrench_in_base[2]"], expected["wrench_in_base"][:, 2])
    assert capture.time_s[30] == 0.0
    assert capture.time_s[0] == pytest.approx(-0.03)
    assert capture.units == {SIGNAL: "N", "wrench_in_base[2]": "N, N mm", "pose_measured": "mm, rad"}


def test_a_trigger_counts_only_once_the_samples_before_it_are_there():
    scope = scope_of(Level(SIGNAL, ">", 0.5), samples=10, pre=5)
    scope.feed(Rows(rows_of(4, force_axial_n=1.0)))
    assert scope.state is State.FILLING
    assert scope.filled == 4
    scope.feed(Rows(rows_of(2, tick=[4, 5], force_axial_n=[1.0, 0.0])))
    assert scope.state is State.WAITING
    scope.force()
    scope.feed(Rows(rows_of(1, tick=6)))
    assert scope.state is State.TRIGGERED
    assert scope.filled == 6
    scope.interrupt()
    (capture,) = scope.finished
    assert not capture.complete
    assert capture.cause == "forced"
    assert capture["tick"].tolist() == [1, 2, 3, 4, 5, 6]


def test_finished_captures_take_no_more_than_their_limit_and_the_scope_goes_on_when_they_are_taken():
    setup = make_setup(signals=[SIGNAL], samples=10, captures=20)
    size = 10 * (8 + 8 + 4 + 4 + 8)
    scope = Scope(setup, TABLES, limit_bytes=3 * size)
    scope.feed(Rows(rows_of(100)))
    assert scope.state is State.RESTING
    assert len(scope.finished) == 3
    assert scope.take()["tick"].tolist() == list(range(10))
    assert scope.state is State.FILLING or scope.state is State.WAITING
    scope.feed(Rows(rows_of(30, tick=np.arange(100, 130))))
    assert [c["tick"][0] for c in scope.finished] == [10, 20, 100]
    assert all(c.lost_records == 0 for c in scope.finished)
    with pytest.raises(ScopeError, match="too large"):
        Scope(setup, TABLES, limit_bytes=size - 1)


def test_what_holds_already_is_no_event():
    scope = scope_of(FAULT, samples=2)
    scope.feed(Rows(rows_of(5, operating_state=[3, 3, 1, 3, 3])))
    assert [c.trigger_tick for c in scope.finished] == [3]


@pytest.mark.parametrize(
    ("fields", "text"),
    [
        ({"signals": ["forc_axial_n"]}, "did you mean force_axial_n"),
        ({"signals": ["wrench_in_base[6]"]}, "not so many numbers"),
        ({"signals": ["force_axial_n[0]"]}, "not so many numbers"),
        ({"signals": ["force_axial_n", "force_axial_n"]}, "named twice"),
        ({"signals": ["tick"]}, "named twice"),
        ({"signals": ["reserved"]}, "no such signal"),
        ({"signals": ["__class__"]}, "no such signal"),
        ({"signals": ["truth."]}, "simulation"),
        ({"trigger": Level("wrench_in_base", "<", 0.0)}, "one number"),
        ({"trigger": Event("force_limit")}, "kind of event"),
        ({"trigger": Event("condition:none")}, "no such condition"),
        ({"trigger": Event("command:none")}, "no such command"),
        ({"trigger": Level(SIGNAL, "<", math.nan)}, "setup"),
        ({"trigger": Edge(SIGNAL, 0.0, "up")}, "setup"),
        ({"samples": 0}, "setup"),
        ({"samples": 5, "pre": 5}, "less than"),
        ({"decimation": 0}, "setup"),
        ({"captures": 1001}, "setup"),
        ({"signals": []}, "setup"),
        ({"colour": 1}, "setup"),
    ],
)
def test_what_is_wrong_is_told(fields, text):
    with pytest.raises(ScopeError, match=text):
        Scope(make_setup(**({"signals": [SIGNAL]} | fields)), TABLES)
