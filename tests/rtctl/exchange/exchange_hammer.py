"""The other process of the exchange tests: `python exchange_hammer.py <fd> <what to do>`, until stopped or killed."""

import signal
import sys

import numpy as np

from hal.kernel import kernel
from rtctl.commands import COMMAND
from rtctl.exchange.atomics import load_acquire, words_of
from rtctl.exchange.control import Word, get, put
from rtctl.exchange.mailbox import post, stage
from rtctl.exchange.ring import RingReader, commit, committed
from rtctl.exchange.segment import Layout, Segment
from rtctl.record import controller_table

RECORD = controller_table(3).dtype
TRUTH = np.dtype([("time_ns", "u8"), ("tip_mm", "f8", (3,)), ("folded", "u1"), ("reserved", "u1", (7,))])
PLAN = np.dtype([("depth_mm", "f8", (400,)), ("rows", "i8")])
PARAMETERS = np.dtype([("gain", "f8", (6,)), ("enabled", "i4"), ("mode", "i4")], align=True)
CAPACITY = 8
LAYOUT = Layout(RECORD, TRUTH, PLAN, PARAMETERS, capacity=CAPACITY)
WEIGHT = 1 << 40
LIFETIME_S = 180


@kernel
def fill(words, number):
    """A pattern in which every word tells the record it belongs to, and its place."""
    for i in range(words.shape[0]):
        words[i] = number + i * WEIGHT


@kernel
def number_of(words):
    """The record number of an intact pattern, or -1 if it is a mixture."""
    for i in range(words.shape[0]):
        if words[i] - i * WEIGHT != words[0]:
            return -1
    return words[0]


@kernel
def commit_until_stopped(ring, record, control):
    while load_acquire(control, Word.STOP_REQUEST) == 0:
        fill(words_of(record), committed(ring))
        commit(ring, record)


@kernel
def stage_until_stopped(slots, payload, control):
    number = 0
    while load_acquire(control, Word.STOP_REQUEST) == 0:
        number += 1
        fill(words_of(payload), number)
        stage(slots, number, payload)


@kernel
def post_until_stopped(mailbox, command, control):
    number = 0
    while load_acquire(control, Word.STOP_REQUEST) == 0:
        fill(words_of(command), number)
        if post(mailbox, command):
            number += 1


def follow(segment: Segment) -> None:
    """A gateway that only keeps its position."""
    reader = RingReader(segment.records, RECORD, limit=3)
    while not get(segment.control, Word.STOP_REQUEST):
        reader.read()
        put(segment.control, Word.RECORD_POSITION, reader.position)


def main(fd: int, task: str) -> None:
    signal.alarm(LIFETIME_S)  # nobody is left behind if the tests themselves are killed
    segment = Segment.attach(fd, LAYOUT)
    put(segment.control, Word.REAL_TIME_STATE, 2)
    match task:
        case "records":
            commit_until_stopped(segment.records, np.zeros(1, RECORD)[0], segment.control)
        case "truths":
            commit_until_stopped(segment.truths, np.zeros(1, TRUTH)[0], segment.control)
        case "plans":
            stage_until_stopped(segment.plans, np.zeros(1, PLAN)[0], segment.control)
        case "commands":
            post_until_stopped(segment.mailbox, np.zeros(1, COMMAND)[0], segment.control)
        case "follow":
            follow(segment)


if __name__ == "__main__":
    main(int(sys.argv[1]), sys.argv[2])
