"""What the tick learns of the gateway in one look."""

import numpy as np
import pytest

from rtctl.commands import COMMAND, Verb
from rtctl.exchange.control import (
    ALIVE,
    GATEWAY_EXPECTED,
    LOG_WRITING,
    OPERATOR_EXPECTED,
    OPERATOR_PRESENT,
    WORDS,
    Word,
    get,
    put,
)
from rtctl.exchange.mailbox import MAILBOX_SHAPE, post
from rtctl.exchange.poll import new_poller, poll

LIMIT = 5


class Tick:
    """The real-time side, one poll a tick."""

    def __init__(self) -> None:
        self.control = np.zeros(WORDS, np.int64)
        self.mailbox = np.zeros(MAILBOX_SHAPE, np.int64)
        self.command = np.zeros(1, COMMAND)
        self.poller = new_poller(self.control)

    def beat(self) -> None:
        put(self.control, Word.GATEWAY_HEARTBEAT, get(self.control, Word.GATEWAY_HEARTBEAT) + 1)

    def poll(self) -> int:
        return poll(self.control, self.mailbox, self.poller[0], self.command[0], LIMIT)


def test_words_of_one_owner_share_no_cache_line_with_those_of_another() -> None:
    supervisor = (Word.STOP_REQUEST, Word.REAL_TIME_PID, Word.GATEWAY_PID, Word.GATEWAY_EXPECTED)
    gateway = [w for w in Word if w >= Word.GATEWAY_HEARTBEAT]
    loop = [w for w in Word if w not in supervisor and w not in gateway]
    assert {w // 8 for w in supervisor} == {0}
    assert {w // 8 for w in loop} == {1}
    assert {w // 8 for w in gateway} == {2}


def test_control_words_are_independent() -> None:
    control = np.zeros(WORDS, np.int64)
    for word in Word:
        put(control, word, -1000 - word)
    assert {word: get(control, word) for word in Word} == {word: -1000 - word for word in Word}


def test_gateway_is_alive_for_as_many_ticks_as_the_limit_after_each_heartbeat() -> None:
    tick = Tick()
    assert [tick.poll() for _ in range(3)] == [0, 0, 0]
    tick.beat()
    assert [tick.poll() for _ in range(LIMIT + 2)] == [ALIVE] * LIMIT + [0, 0]
    tick.beat()
    assert tick.poll() == ALIVE


def test_the_last_heartbeat_of_a_dead_gateway_is_no_sign_of_life() -> None:
    tick = Tick()
    tick.beat()
    tick.poller = new_poller(tick.control)  # the real-time process starts after that
    assert tick.poll() == 0


@pytest.mark.parametrize("said", [0, LOG_WRITING, LOG_WRITING | OPERATOR_PRESENT | OPERATOR_EXPECTED])
@pytest.mark.parametrize("expected", [0, 1])
def test_health_is_what_the_gateway_says_and_what_the_supervisor_expects(said: int, expected: int) -> None:
    tick = Tick()
    put(tick.control, Word.GATEWAY_HEALTH, said | ALIVE | GATEWAY_EXPECTED | 1 << 20)  # it has no say in those
    put(tick.control, Word.GATEWAY_EXPECTED, expected)
    assert tick.poll() == said | (GATEWAY_EXPECTED if expected else 0)


def test_one_command_a_tick_and_a_clean_record_without_one() -> None:
    tick = Tick()
    row = np.zeros(1, COMMAND)
    for sequence in (11, 12):
        row["sequence"], row["verb"], row["argument"] = sequence, Verb.MOVE_CP, 1.5
        post(tick.mailbox, row[0])
    seen = []
    for _ in range(3):
        tick.poll()
        seen.append(int(tick.command[0]["sequence"]))
    assert seen == [11, 12, 0]
    assert tick.command.tobytes() == np.zeros(1, COMMAND).tobytes()
