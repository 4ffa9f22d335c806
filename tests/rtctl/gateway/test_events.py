"""Events read off records, and the state shown to clients."""

import numpy as np

from hal import troubles
from hal.troubles import Trouble
from rtctl.commands import Reason, Verb
from rtctl.exchange.control import Grade
from rtctl.gateway.events import Watcher
from rtctl.gateway.feedback import Feedback, operating_state
from rtctl.gateway.keys import FEEDBACK
from rtctl.lifecycle import TABLE, Condition, Operating, Task
from rtctl.record import controller_table

CONTROLLER_TABLE = controller_table(3)


def rows(n):
    r = np.zeros(n, CONTROLLER_TABLE.dtype)
    r["tick"] = np.arange(n)
    r["condition_reported"] = r["fault_cause"] = -1
    r["condition_value"] = r["condition_bound"] = np.nan
    return r


def texts(events):
    return [e.text for e in events]


def test_nothing_happens_without_a_change():
    watcher = Watcher()
    assert texts(watcher.watch(rows(1))) == ["state is disabled", "task is idle"]
    assert watcher.watch(rows(100)) == []
    assert watcher.watch(rows(0)) == []


def test_transitions_are_told_once_with_their_tick_however_rows_are_batched():
    r = rows(30)
    r["operating_state"][7:] = Operating.ENABLED
    r["task_state"][20:] = Task.INSERTING
    whole = Watcher().watch(r)
    watcher = Watcher()
    pieces = [e for i in range(0, 30, 7) for e in watcher.watch(r[i : i + 7])]
    assert pieces == whole
    assert [(e.tick, e.text) for e in whole[2:]] == [
        (7, "state is enabled (was disabled)"),
        (20, "task is inserting (was idle)"),
    ]


def test_a_condition_is_told_with_its_numbers_when_it_rises_and_when_it_is_over():
    r = rows(9)
    r["condition_active"][3:6] = 1 << Condition.FORCE_LIMIT
    r["condition_reported"][3] = Condition.FORCE_LIMIT
    r["condition_value"][3], r["condition_bound"][3] = 0.75, 0.5
    watcher = Watcher()
    rise, over = watcher.watch(r)[2:]
    assert (rise.tick, rise.severity, rise.value, rise.bound) == (3, "error", 0.75, 0.5)
    assert rise.text == "force 0.75 N exceeds 0.5 N"
    assert rise.remedy == TABLE[Condition.FORCE_LIMIT].remedy
    assert (over.tick, over.text) == (6, "over: force limit")


def test_a_condition_that_was_not_the_gravest_has_no_made_up_numbers():
    r = rows(2)
    r["condition_active"][1] = 1 << Condition.FORCE_LIMIT | 1 << Condition.AMPLIFIER
    r["condition_reported"][1] = Condition.AMPLIFIER
    said = texts(Watcher().watch(r)[2:])
    assert said == ["an amplifier reports not ready", "force limit"]


def test_commands_are_told_with_their_verdict_but_streams_only_when_refused():
    r = rows(4)
    r["command_sequence"] = [1, 2, 3, 0]
    r["command_verb"] = [Verb.HOME, Verb.SERVO_CP, Verb.SERVO_CP, 0]
    r["command_verdict"] = [Reason.ACCEPTED, Reason.ACCEPTED, Reason.SPEED, 0]
    r["reason_value"][2], r["reason_bound"][2] = 9.0, 8.0
    accepted, refused = (e for e in Watcher().watch(r) if e.kind == "command")
    assert accepted.text == "home accepted"
    assert refused.text.startswith("servo_cp refused: speed 9 is outside")
    assert refused.remedy
    assert (refused.value, refused.bound) == (9.0, 8.0)


def test_every_feedback_key_carries_its_signals():
    r = rows(1)
    for k, name in enumerate(n for names in FEEDBACK.values() for n in names):
        r[name] = k + 1.0
    payloads = Feedback(CONTROLLER_TABLE).payloads(r[0])
    assert payloads.keys() == FEEDBACK.keys()
    for key, names in FEEDBACK.items():
        expected = [float(v) for name in names for v in np.atleast_1d(r[0][name])]
        assert payloads[key]["values"] == expected


def test_the_state_shows_what_is_wrong_and_what_to_do():
    r = rows(1)
    r["operating_state"], r["fault_cause"] = Operating.FAULT, Condition.FOLLOWING_ERROR
    r["condition_active"] = r["condition_latched"] = 1 << Condition.FOLLOWING_ERROR
    r["condition_reported"], r["condition_value"], r["condition_bound"] = Condition.FOLLOWING_ERROR, 7.5, 6.0
    watcher = Watcher()
    watcher.watch(r)
    state = operating_state(r[0], Grade.BEST_EFFORT, "", watcher.causes)
    assert state["state"] == "FAULT"
    assert state["grade"] == "best-effort"
    assert state["lease_holder"] is None
    assert state["fault_cause"]["text"] == "a motor is 7.5 rad from its reference (limit 6)"
    assert state["conditions"] == [state["fault_cause"]]
    assert state["latched"] == ["following_error"]


def test_a_trouble_is_told_with_the_name_of_its_device_and_again_when_another_follows():
    r = rows(12)
    for first, trouble, device, value in ((3, Trouble.ENCODER_ERROR, 1, 2.0), (7, Trouble.BUS_OFF, 0, np.nan)):
        last = 7 if first == 3 else 12
        r["trouble"][first:last], r["trouble_device"][first:last], r["trouble_value"][first:last] = (
            trouble,
            device,
            value,
        )
    r["condition_active"][3:] = 1 << Condition.DEVICE_FAULT
    r["condition_reported"][3] = Condition.DEVICE_FAULT
    r["condition_value"][3], r["condition_bound"][3] = Trouble.ENCODER_ERROR, 2.0
    watcher = Watcher(["card_a", "motor_2"])
    first, second = watcher.watch(r)[2:]
    assert (first.tick, first.severity) == (3, "error")
    assert first.text == "motor_2: the counter of axis 2 saw a step no encoder makes"
    assert first.remedy == troubles.TABLE[Trouble.ENCODER_ERROR].remedy
    assert (second.tick, second.text) == (7, "card_a: the CAN controller is bus-off")
    assert watcher.causes[Condition.DEVICE_FAULT] == (first.text, first.remedy)


def test_every_trouble_says_what_and_what_to_do():
    for trouble in Trouble:
        text, remedy = troubles.say(trouble, 3.0)
        assert "{" not in text
        assert remedy
    assert troubles.say(9999, 1.0)[0] == "trouble number 9999"
