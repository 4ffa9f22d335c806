"""The storm of a soak counts every request, and knows a gateway that is gone."""

from rtctl.soak.storm import BATCH, Storm


def test_a_storm_gets_an_answer_to_everything(world):
    storm = Storm("planar", world.endpoint, seed=1)
    for _ in range(3):
        storm.batch()
    assert storm.sent == storm.answered == 3 * BATCH
    assert sum(storm.reasons.values()) == storm.answered
    assert {"accepted", "malformed", "unknown_key"} <= set(storm.reasons)
    assert storm.doubled == 0
    assert storm.unanswered_ns == []


def test_what_nobody_answers_is_counted_with_its_time(world):
    storm = Storm("nobody", world.endpoint, seed=1)
    storm.batch()
    assert (storm.sent, storm.answered) == (BATCH, 0)
    assert len(storm.unanswered_ns) == BATCH
    assert all(begin <= end for begin, end in storm.unanswered_ns)
