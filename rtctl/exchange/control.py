"""The control words: single numbers that cross between the processes, each with one owner who writes it."""

import enum

import numpy as np

from hal.kernel import kernel
from rtctl.exchange.atomics import load_acquire, store_release


class Word(enum.IntEnum):
    """Index of a control word. Every owner has a cache line (eight words) of its own; all start at zero."""

    # the supervisor; anybody may ask for a stop
    STOP_REQUEST = 0
    """1: the real-time process is to stop safely and end"""
    REAL_TIME_PID = 1
    GATEWAY_PID = 2
    """of the gateway that runs now"""
    GATEWAY_EXPECTED = 3
    """1: a run without a gateway is a fault of the run"""

    # the real-time process
    REAL_TIME_STATE = 8
    """a RealTimeState"""
    GRADE = 9
    """a Grade"""
    EPOCH_NS = 10
    """Unix time of tick 0 [ns]; 0 in lockstep"""
    TICK = 11
    """number of the tick last committed"""
    OVERRUNS = 12
    """ticks that ended after the next grid point"""
    MISSED_TICKS = 13
    """grid points skipped because of them"""
    MAX_LATENESS_NS = 14
    """latest wake-up after its grid point [ns]"""
    GARBAGE_COLLECTIONS = 15
    """of the loop's interpreter, since the loop began: more than 0 if somebody switched its collector on"""

    # the gateway
    GATEWAY_HEARTBEAT = 16
    """counts up at least every 50 ms"""
    GATEWAY_HEALTH = 17
    """bits LOG_WRITING, OPERATOR_PRESENT, OPERATOR_EXPECTED"""
    RECORD_POSITION = 18
    """number of the first record not yet dealt with: where a restarted gateway goes on"""
    TRUTH_POSITION = 19
    """the same for the ring of the simulation's truth"""
    LOST_RECORDS = 20
    """records overwritten before any gateway read them"""
    LOST_TRUTHS = 21


WORDS = 24


class RealTimeState(enum.IntEnum):
    """How far the real-time process has come."""

    STARTING = 0
    READY = 1
    """compiled, exercised, waiting for its first grid point"""
    RUNNING = 2
    STOPPED = 3
    """ended with the safe output written"""
    FAILED = 4


class Grade(enum.IntEnum):
    """What the real-time process obtained from the machine."""

    SIM = 0
    BEST_EFFORT = 1
    RT = 2


# bits of what `poll` returns, the record's signal gateway_health
ALIVE, LOG_WRITING, OPERATOR_PRESENT, OPERATOR_EXPECTED, GATEWAY_EXPECTED = 1, 2, 4, 8, 16
# bit the loop adds: the grade of the machine, or an explicit flag, allows hardware to be armed
ARMING_ALLOWED = 32


def get(control: np.ndarray, word: Word) -> int:
    """The value of a control word, for Python; kernels use `load_acquire(control, word)`."""
    return _get(control, int(word))


def put(control: np.ndarray, word: Word, value: int) -> None:
    """Write a control word, for Python; kernels use `store_release(control, word, value)`."""
    _put(control, int(word), int(value))


@kernel
def _get(control, index):
    return load_acquire(control, index)


@kernel
def _put(control, index, value):
    store_release(control, index, value)
