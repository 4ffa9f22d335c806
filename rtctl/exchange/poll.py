"""The one look the tick takes at the gateway: a command, if there is one, and how the gateway is."""

import numpy as np

from hal.kernel import kernel
from rtctl.exchange.atomics import load_acquire
from rtctl.exchange.control import (
    ALIVE,
    GATEWAY_EXPECTED,
    LOG_WRITING,
    OPERATOR_EXPECTED,
    OPERATOR_PRESENT,
    Word,
    get,
)
from rtctl.exchange.mailbox import take

POLLER = np.dtype([("heartbeat", "i8"), ("silent_ticks", "i8")], align=True)
"""What the tick remembers of the gateway: the heartbeat last seen, and the ticks since it last changed."""

FOREVER = 1 << 62
SAID_BY_GATEWAY = LOG_WRITING | OPERATOR_PRESENT | OPERATOR_EXPECTED


def new_poller(control: np.ndarray) -> np.ndarray:
    """A POLLER record, shape (1,), for which the gateway is dead until its heartbeat changes."""
    return np.array([(get(control, Word.GATEWAY_HEARTBEAT), FOREVER)], POLLER)


@kernel
def poll(control, mailbox, poller, command, heartbeat_limit_ticks):
    """Once per tick: take at most one command, and return the health bits of the gateway.

    `command` (a COMMAND record) is cleared when there is none.
    """
    take(mailbox, command)
    return listen(control, poller, heartbeat_limit_ticks)


@kernel
def listen(control, poller, heartbeat_limit_ticks):
    """Health bits of the gateway; once per tick, because its silence is counted in ticks.

    The gateway is alive while its heartbeat
    changed in this tick or one of the `heartbeat_limit_ticks` - 1 before it; what it says of the log and the
    operator is passed on as it is, also when it is dead.
    """
    heartbeat = load_acquire(control, Word.GATEWAY_HEARTBEAT)
    if heartbeat != poller.heartbeat:
        poller.heartbeat = heartbeat
        poller.silent_ticks = 0
    elif poller.silent_ticks < FOREVER:
        poller.silent_ticks += 1
    health = load_acquire(control, Word.GATEWAY_HEALTH) & SAID_BY_GATEWAY
    if poller.silent_ticks < heartbeat_limit_ticks:
        health |= ALIVE
    if load_acquire(control, Word.GATEWAY_EXPECTED) != 0:
        health |= GATEWAY_EXPECTED
    return health
