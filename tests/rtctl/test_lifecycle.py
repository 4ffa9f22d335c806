"""The operating states, over every state, every verb, and every condition alone and in pairs."""

import string
from itertools import combinations

import pytest

from rtctl.commands import EXPLANATIONS, Reason, Verb, explain
from rtctl.lifecycle import (
    FAULT_MASK,
    NEVER_BLOCK_RETRACTION,
    PAUSE_MASK,
    REACTION,
    STOP_MASK,
    TABLE,
    Condition,
    Operating,
    Reaction,
    mask,
    permits,
    step,
)

STATES = list(Operating)
VERBS = list(Verb)
SETS = [0, *(1 << c for c in Condition), *(1 << a | 1 << b for a, b in combinations(Condition, 2))]
HARMLESS_IN_PAUSE = {Verb.STOP, Verb.DISABLE, Verb.SET_PARAMETERS, Verb.LOAD_PLAN, Verb.PAUSE, Verb.UNLOAD_ARRAY}


@pytest.fixture(scope="module")
def steps():
    """(state, active, verb, retracting) -> (state, verdict), over everything."""
    return {
        (state, active, verb, retracting): tuple(
            kind(v)
            for kind, v in zip((Operating, Reason), step(int(state), active, int(verb), retracting), strict=True)
        )
        for state in STATES
        for active in SETS
        for verb in VERBS
        for retracting in (False, True)
    }


def test_every_fault_condition_leads_to_fault_from_every_state_whatever_is_asked(steps):
    for (_, active, _, _), (after, _) in steps.items():
        if active & FAULT_MASK:
            assert after is Operating.FAULT


def test_a_fault_is_left_only_by_an_acknowledgement_without_its_cause(steps):
    for (state, active, verb, _), (after, verdict) in steps.items():
        if state is Operating.FAULT and after is not Operating.FAULT:
            assert verb is Verb.ACKNOWLEDGE
            assert not active & FAULT_MASK
            assert (after, verdict) == (Operating.DISABLED, Reason.ACCEPTED)
        if state is Operating.FAULT and verb is Verb.ACKNOWLEDGE and active & FAULT_MASK:
            assert verdict is Reason.STILL_PRESENT


def test_power_comes_only_by_enable_out_of_disabled(steps):
    powered = {Operating.ENABLED, Operating.PAUSED}
    for (state, _, verb, _), (after, _) in steps.items():
        if state not in powered and after in powered:
            assert (state, verb) == (Operating.DISABLED, Verb.ENABLE)


def test_enable_is_refused_while_a_fault_condition_holds(steps):
    for (state, active, verb, _), (_, verdict) in steps.items():
        if verb is Verb.ENABLE and (active & FAULT_MASK or state is Operating.FAULT):
            assert verdict is Reason.WRONG_STATE


def test_stop_and_disable_are_accepted_in_every_state_under_every_condition(steps):
    for (_, active, verb, _), (after, verdict) in steps.items():
        if verb in (Verb.STOP, Verb.DISABLE):
            assert verdict is Reason.ACCEPTED
        if verb is Verb.DISABLE and not active & FAULT_MASK:
            assert after in (Operating.DISABLED, Operating.FAULT)


def test_a_pausing_condition_pauses_whatever_is_enabled(steps):
    for (state, active, _, retracting), (after, _) in steps.items():
        if active & PAUSE_MASK and not retracting and state is Operating.ENABLED:
            assert after is not Operating.ENABLED or (active & ~mask_of(NEVER_BLOCK_RETRACTION)) & PAUSE_MASK == 0


def test_nothing_that_moves_is_accepted_in_the_tick_that_pauses(steps):
    for (state, _, verb, _), (after, verdict) in steps.items():
        if after is Operating.PAUSED and verdict is Reason.ACCEPTED:
            assert verb in HARMLESS_IN_PAUSE | {Verb.ENABLE}, (state, verb)


def test_only_resume_and_retract_leave_a_pause_for_motion(steps):
    for (state, _, verb, _), (after, verdict) in steps.items():
        if state is Operating.PAUSED and after is Operating.ENABLED:
            assert verb in (Verb.RESUME, Verb.RETRACT)
            assert verdict is Reason.ACCEPTED


def test_resume_is_refused_as_long_as_the_cause_of_the_pause_holds(steps):
    for (state, active, verb, retracting), (after, verdict) in steps.items():
        if state is Operating.PAUSED and verb is Verb.RESUME and active & PAUSE_MASK and not retracting:
            expected = Reason.WRONG_STATE if active & FAULT_MASK else Reason.STILL_PRESENT
            assert verdict is expected
            assert after is not Operating.ENABLED


def test_what_must_not_block_a_retraction_neither_refuses_nor_pauses_one(steps):
    open_way = {1 << c for c in NEVER_BLOCK_RETRACTION} | {
        1 << a | 1 << b for a, b in combinations(NEVER_BLOCK_RETRACTION, 2)
    }
    for (state, active, verb, retracting), (after, verdict) in steps.items():
        if active not in open_way:
            continue
        if verb is Verb.RETRACT and state in (Operating.ENABLED, Operating.PAUSED):
            assert (after, verdict) == (Operating.ENABLED, Reason.ACCEPTED)
        if verb is Verb.NONE and state is Operating.ENABLED and retracting:
            assert after is Operating.ENABLED


def test_a_verdict_is_given_exactly_for_a_verb(steps):
    for (_, _, verb, _), (_, verdict) in steps.items():
        assert (verdict is Reason.NONE) == (verb is Verb.NONE)


def test_without_a_verb_and_without_conditions_nothing_changes(steps):
    for state in STATES:
        assert steps[state, 0, Verb.NONE, False] == (state, Reason.NONE)


def test_notes_and_stops_change_no_operating_state(steps):
    quiet = mask(Reaction.NOTE) | STOP_MASK
    for (state, active, verb, retracting), result in steps.items():
        if active & ~quiet == 0:
            assert result == steps[state, 0, verb, retracting]


def test_a_refused_verb_changes_nothing_by_itself(steps):
    for (state, active, verb, retracting), (after, verdict) in steps.items():
        if verb is not Verb.NONE and verdict is Reason.WRONG_STATE:
            assert after is steps[state, active, Verb.NONE, retracting][0]


def test_permission_agrees_with_the_verdict_where_nothing_is_wrong(steps):
    for state in STATES:
        for verb in VERBS[1:]:
            accepted = steps[state, 0, verb, False][1] is Reason.ACCEPTED
            assert accepted == permits(int(state), int(verb))


def test_every_condition_has_a_row_and_its_reaction():
    assert set(TABLE) == set(Condition)
    assert [TABLE[c].reaction for c in Condition] == list(REACTION)
    assert sorted(Condition) == list(range(len(Condition))), "bit numbers without gaps"
    assert FAULT_MASK | PAUSE_MASK | STOP_MASK | mask(Reaction.NOTE) == (1 << len(Condition)) - 1


def test_the_never_block_set_holds_pausing_conditions_only():
    assert all(TABLE[c].reaction is Reaction.PAUSE for c in NEVER_BLOCK_RETRACTION)


@pytest.mark.parametrize("condition", Condition, ids=lambda c: c.name)
def test_the_texts_of_the_table_fill_in_and_end_without_a_stop(condition):
    row = TABLE[condition]
    text = row.text.format(value=1.25, bound=2.5)
    assert text
    assert row.remedy
    assert not text.endswith(".")
    assert {name for _, name, _, _ in string.Formatter().parse(row.text) if name} <= {"value", "bound"}


@pytest.mark.parametrize("reason", [r for r in Reason if r > Reason.ACCEPTED], ids=lambda r: r.name)
def test_every_refusal_explains_itself_with_a_remedy(reason):
    assert reason in EXPLANATIONS
    text, remedy = explain(int(reason), 1.25, 2.0)
    assert text
    assert remedy
    assert "{" not in text + remedy
    assert explain(int(reason), float("nan"), float("nan"))[0], "numbers may be missing"


def mask_of(conditions):
    return sum(1 << c for c in conditions)
