"""The lease alone, with a clock of the test's own."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from rtctl.exchange.control import OPERATOR_EXPECTED, OPERATOR_PRESENT
from rtctl.gateway.lease import Lease
from rtctl.gateway.refusal import Refusal

BOTH = OPERATOR_EXPECTED | OPERATOR_PRESENT


def refused(action, *arguments):
    with pytest.raises(Refusal) as error:
        action(*arguments)
    return error.value.reason


def test_only_one_holds_it():
    lease = Lease(1.0)
    token = lease.acquire("a", 0.0)
    assert refused(lease.acquire, "b", 0.5) == "lease_taken"
    assert refused(lease.acquire, "a", 0.5) == "lease_taken"
    lease.release(token)
    assert lease.acquire("b", 0.6) != token
    assert lease.holder == "b"


def test_silence_ends_it_and_life_prolongs_it():
    lease = Lease(1.0)
    token = lease.acquire("a", 0.0)
    lease.renew(token, 0.9)
    lease.authorise(token, 1, 1.8)
    assert lease.expire(False, 2.7) == ""
    assert lease.expire(False, 2.9) == "a"
    assert refused(lease.renew, token, 2.9) == "no_lease"
    assert lease.expire(False, 9.0) == ""


def test_a_wrong_token_is_nobodys():
    lease = Lease(1.0)
    for token in ("", "x", "ä"):
        assert refused(lease.authorise, token, 1, 0.0) == "no_lease"
    lease.acquire("a", 0.0)
    for token in ("", "x", "ä"):
        assert refused(lease.authorise, token, 1, 0.0) == "no_lease"
        assert refused(lease.release, token) == "no_lease"


def test_commands_do_not_overtake_each_other():
    lease = Lease(1.0)
    token = lease.acquire("a", 0.0)
    lease.authorise(token, 5, 0.0)
    assert refused(lease.authorise, token, 5, 0.0) == "out_of_order"
    assert refused(lease.authorise, token, 4, 0.0) == "out_of_order"
    lease.release(token)
    lease.authorise(lease.acquire("b", 0.0), 1, 0.0)


def test_what_the_tick_is_told_of_the_operator():
    lease = Lease(1.0)
    assert lease.health == 0
    token = lease.acquire("a", 0.0)
    assert lease.health == BOTH
    lease.release(token)
    assert lease.health == 0

    lease.acquire("a", 0.0)
    lease.expire(False, 2.0)
    assert lease.health == 0, "nothing moved, so nobody is missed"

    lease.acquire("a", 2.0)
    lease.expire(True, 4.0)
    assert lease.health == OPERATOR_EXPECTED
    lease.acquire("b", 5.0)
    assert lease.health == BOTH


@given(
    st.lists(
        st.tuples(st.sampled_from(["acquire", "renew", "release", "expire"]), st.sampled_from("ab"), st.floats(0, 2))
    )
)
def test_whatever_happens_at_most_one_token_works(steps):
    lease, now, tokens = Lease(1.0), 0.0, {}
    for what, who, wait in steps:
        now += wait
        try:
            if what == "acquire":
                tokens[who] = lease.acquire(who, now)
            elif what == "expire":
                lease.expire(True, now)
            else:
                getattr(lease, what)(tokens.get(who, ""), *([now] if what == "renew" else []))
        except Refusal:
            pass
        working = []
        for name, token in tokens.items():
            try:
                lease.renew(token, now)
                working.append(name)
            except Refusal:
                pass
        assert working in ([], [lease.holder])
