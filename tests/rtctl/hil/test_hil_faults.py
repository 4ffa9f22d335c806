"""The failure table, acted out in the middle of an insertion: what is seen, how fast, and what the robot does."""

import pytest

from rtctl.hil.faults import LONGEST_TICKS, SETS, run
from rtctl.settings import load

STATE = {
    "card lost, or wrong base": ("FAULT", 1),
    "ADC never done": ("PAUSED", 1),
    "stale ADC channel": ("PAUSED", 21),
    "ADC reference drifts by 2 %": ("PAUSED", 1),
    "ADC input saturated": ("PAUSED", 1),
    "transducer's cable cut": ("PAUSED", 1),
    "gauges noisy": ("ENABLED", 100),
    "load 85 % of rated": ("PAUSED", 1),
    "load 110 % of rated": ("FAULT", 1),
    "encoder pulses where none should be": ("FAULT", 2),
    "encoder's index cut": ("ENABLED", 150),
    "encoder loses counts": ("FAULT", 1000),
    "encoder makes an illegal step": ("FAULT", 1),
    "encoder jumps": ("FAULT", 2),
    "encoder's wires cut": ("FAULT", 200),
    "encoder's wires swapped": ("FAULT", 50),
    "set value's wire cut": ("FAULT", 200),
    "analog output stuck": ("FAULT", LONGEST_TICKS),
    "amplifier not ready": ("FAULT", 2),
    "nobody pets the card's watchdog": ("FAULT", 103),
    "telemetry silent": ("ENABLED", 211),
    "telemetry loses samples": ("ENABLED", 281),
    "telemetry reorders": ("ENABLED", 211),
    "telemetry's sender starts anew": ("ENABLED", 71),
    "telemetry corrupt": ("ENABLED", 281),
    "telemetry of another length": ("ENABLED", 281),
    "telemetry frozen": ("ENABLED", 4 * 1470 + 71),
    "somebody else sends": ("ENABLED", 281),
    "Net F/T silent": ("PAUSED", 6),
    "Net F/T loses records": ("ENABLED", 5),
    "Net F/T frozen but streaming": ("PAUSED", 6),
    "Net F/T starts anew": ("PAUSED", 6),
    "Net F/T saturated (status bit 17)": ("PAUSED", 1),
    "Net F/T records corrupt": ("ENABLED", 1),
    "CAN bus off": ("FAULT", 2),
    "CAN error-passive": ("ENABLED", 2),
    "CAN transmit queue full": ("FAULT", 3),
    "drive silent": ("FAULT", 5),
    "drive starts anew": ("FAULT", 7),
    "drive faults": ("FAULT", 2),
    "drive ignores its set value": ("FAULT", 7),
    "drive without heartbeat": ("FAULT", 61),
    "SYNC late by 8 exchanges": ("FAULT", 5),
}
"""State the controller must reach, and within how many ticks the fault must have been seen: 07 section 7, and the settings."""


@pytest.fixture(scope="module")
def outcomes():
    return {o.fault.what: o for o in run(load("planar-hil"))}


def test_every_fault_has_its_line():
    assert [f.what for _, faults in SETS for f in faults] == list(STATE)


@pytest.mark.parametrize("what", STATE)
def test_a_fault_is_seen_in_time_and_leads_to_a_safe_state(outcomes, what):
    outcome, (state, most) = outcomes[what], STATE[what]
    assert outcome.seen_ticks is not None, "nobody has seen it"
    assert 1 <= outcome.seen_ticks <= most
    assert outcome.state == state
    assert outcome.moving == (state == "ENABLED"), "what only warns does not stop the insertion, all else does"
    assert outcome.text, "the operator is told"
