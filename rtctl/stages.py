"""The stages of a tick, in order, and what each may cost.

A budget is a time, not a share: at 4 kHz the devices are no faster. What does scale is the bound of the whole tick,
`TICK_SHARE` of the period; at 1 kHz that is the sum of the budgets.
"""

from dataclasses import dataclass

POLL, READ, PREPARE, TICK, WRITE, RECORD = range(6)
"""Index of a stage in the signal `stage_ns`."""


@dataclass(frozen=True)
class Stage:
    """One stage: what happens in it, what it may cost in a loop of 1 kHz, and why so much."""

    name: str
    what: str
    budget_us: float
    reason: str


STAGES = (
    Stage("poll", "from the wake-up on: the look at the gateway", 5.0,
          "tens of nanoseconds of work, but the first code after the sleep meets cold caches"),
    Stage("read", "the devices' sensors", 100.0,
          "two I/O cards with six gauges and eight encoders, as drivers in Python: 50 µs, and room for a bus"),
    Stage("prepare", "profile, plan or parameters of a command", 500.0,
          "ruckig's profile, in Python: 0.15 ms, three times that from cold caches; 0 in a tick without a command"),
    Stage("tick", "the controller", 25.0,
          "one compiled call of 1 to 3 µs; ten times that after a context switch has emptied the caches"),
    Stage("write", "the devices' actuators", 100.0,
          "eight outputs through the same drivers, or a frame a drive; a simulated plant steps its physics here"),
    Stage("record", "its commit to the ring, and that of a simulation's truth", 20.0,
          "a copy of 1 kB or two, and one system call that asks for page faults and switches"),
)  # fmt: skip
"""Every stage, at its index."""

TICK_SHARE = 0.75
"""Of the period: the rest is for the wake-up, and for everybody else on the core. A longer tick is over budget."""
LATE_SHARE = 0.2
"""Of the period: a real-time kernel wakes within a tenth of a millisecond. A later wake-up is over budget."""
USUAL_SWITCHES = 1
"""Voluntary context switches of a tick that went well: the sleep before it."""
