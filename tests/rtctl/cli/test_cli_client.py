"""Client commands against a controller that is made up: what they send, and how they end."""

import json
import sys
import time

import numpy as np
import pytest

from rtctl.cli import child, client, main, motion, parameters, plan, watching
from rtctl.cli.exit_codes import Exit
from rtctl.cli.parameters import assignment
from rtctl.client import NoReply, Reply
from rtctl.commands import CommandRefused, Verb
from rtctl.lifecycle import Condition, Operating, Task
from rtctl.record import controller_table
from rtctl.settings import load

STATUS = {
    "robot": "planar", "kind": "planar_3rpr", "dof": 3, "backend": "plant", "state": "ENABLED", "real_time": "running",
    "overruns": 0, "missed_ticks": 0, "max_lateness_ns": 0, "log": "x/log.mcap", "lost_records": 0, "conditions": [],
    "fault_cause": None,
}  # fmt: skip


class FakeClient:
    """Answers at once; `rows` are the records that arrive."""

    def __init__(self) -> None:
        self.sent: list[tuple] = []
        self.rows: list[np.void] = []
        self.stopped = 0
        self.refusal: Exception | None = None
        self.interrupt = False
        self.answer = dict(STATUS)

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.sent.append(("closed",))

    def command(self, verb, *arguments, **_):
        if self.refusal:
            raise self.refusal
        self.sent.append((verb, *arguments))
        return Reply(tick=5)

    def stop(self):
        self.stopped += 1
        return Reply(tick=5)

    def plan(self, document=None):
        self.sent.append(("plan",) if document is None else ("plan", document))
        return Reply(tick=5, result={"number": 1})

    def status(self):
        return self.answer

    def parameters(self, *_):
        return {"workflow.depth_mm": 15.0, "workflow.speed_mm_per_s": 1.0, "admittance.lateral": True}

    def set_parameters(self, values):
        self.sent.append(("set", values))
        return Reply(tick=9, result={"number": 2})

    def latest(self):
        return self.rows[-1]

    def wait(self, done, *_, **__):
        if self.interrupt:
            raise KeyboardInterrupt
        return next(r for r in self.rows if done(r))


def record(tick: int, **fields) -> np.void:
    row = np.zeros(1, controller_table(3).dtype)[0]
    row["tick"], row["operating_state"], row["stop_cause"], row["fault_cause"] = tick, Operating.ENABLED, -1, -1
    for name, value in fields.items():
        row[name] = value
    return row


@pytest.fixture
def robot(monkeypatch) -> FakeClient:
    fake = FakeClient()
    for module in (client, motion, plan, parameters, watching):
        monkeypatch.setattr(module, "connect", lambda *_: fake)
    return fake


def test_negative_numbers_are_numbers(robot):
    robot.rows = [record(6)]
    assert main(["move", "165", "-2", "0.05"]) == Exit.OK
    assert robot.sent[0] == (Verb.MOVE_CP, 165.0, -2.0, 0.05)
    assert main(["move", "-1e-3", "-.5", "-0.05", "--timeout", "20"]) == Exit.OK
    assert robot.sent[2] == (Verb.MOVE_CP, -0.001, -0.5, -0.05)


def test_a_stream_is_sent_until_its_time_is_over_and_then_stopped(robot):
    robot.rows = [record(6)]
    assert main(["servo", "--velocity", "1", "-0.5", "0", "--seconds", "0.1"]) == Exit.OK
    sent = [s for s in robot.sent if s[0] == Verb.SERVO_CV]
    assert 2 <= len(sent) <= 6
    assert set(sent) == {(Verb.SERVO_CV, 1.0, -0.5, 0.0)}
    assert robot.stopped == 1


def test_a_stream_is_either_of_velocities_or_of_poses(robot):
    assert main(["servo", "1", "0", "0"]) == Exit.BAD_INPUT
    assert main(["servo", "--pose", "--velocity", "1", "0", "0"]) == Exit.BAD_INPUT
    assert robot.sent == []


@pytest.mark.parametrize("command", [["move", "1", "2", "3"], ["approach"], ["retract"], ["home"]])
def test_ctrl_c_stops_the_robot_first(robot, command, capsys):
    robot.interrupt = True
    assert main(command) == Exit.INTERRUPTED
    assert robot.stopped == 1
    assert "stopped" in capsys.readouterr().err


def test_a_refusal_is_told_with_its_remedy_and_its_code(robot, capsys):
    robot.refusal = CommandRefused("not_homed", "the robot is not homed", remedy="run `rtctl home`")
    assert main(["move", "1", "2", "3"]) == Exit.REFUSED
    assert capsys.readouterr().err == "rtctl: the robot is not homed; run `rtctl home`\n"


def test_nobody_there_has_a_code_of_its_own(robot):
    robot.refusal = NoReply("nobody answers", remedy="start it")
    assert main(["enable"]) == Exit.UNREACHABLE


def test_a_motion_that_ends_in_fault_is_told_with_what_the_controller_says(robot, capsys):
    robot.rows = [record(7, operating_state=Operating.FAULT, fault_cause=Condition.FOLLOWING_ERROR)]
    robot.answer["fault_cause"] = {
        "name": "following_error",
        "text": "a motor is 7 rad off",
        "remedy": "look for a jam",
    }
    assert main(["move", "1", "2", "3"]) == Exit.FAULT
    assert capsys.readouterr().err == "rtctl: move: ended early: a motor is 7 rad off; look for a jam\n"


def test_a_stopped_motion_is_not_done(robot, capsys):
    robot.rows = [record(7, stop_cause=Condition.WORKSPACE)]
    assert main(["move", "1", "2", "3"]) == Exit.FAILED
    assert "workspace" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("now", "sent"),
    [
        ({"plan_number": 0, "task_state": Task.IDLE}, [("plan",), (Verb.APPROACH,), (Verb.INSERT, 12.0, 0.5)]),
        ({"plan_number": 1, "task_state": Task.IDLE}, [(Verb.APPROACH,), (Verb.INSERT, 12.0, 0.5)]),
        ({"plan_number": 1, "task_state": Task.AT_ENTRY}, [(Verb.INSERT, 12.0, 0.5)]),
        ({"plan_number": 1, "task_state": Task.HOLDING}, [(Verb.INSERT, 12.0, 0.5)]),
    ],
)
def test_insert_does_first_what_is_missing(robot, now, sent):
    later = [
        record(8, plan_number=1, task_state=Task.AT_ENTRY),
        record(9, plan_number=1, task_state=Task.HOLDING, depth_mm=12.0),
    ]
    robot.rows = [record(1, **now), *later]
    assert main(["insert", "12", "0.5"]) == Exit.OK
    assert robot.sent[:-1] == sent


def test_insert_takes_depth_and_speed_from_the_settings(robot):
    robot.rows = [record(1, plan_number=1, task_state=Task.AT_ENTRY), record(9, task_state=Task.HOLDING, depth_mm=15.0)]
    assert main(["insert"]) == Exit.OK
    assert robot.sent[0] == (Verb.INSERT, 15.0, 1.0)


@pytest.mark.parametrize("arguments", [["nan"], ["12", "inf"], ["12", "nan"]])
def test_an_insertion_to_nowhere_moves_nothing_before_it_is_refused(robot, arguments, capsys):
    robot.rows = [record(1)]
    assert main(["insert", *arguments]) == Exit.BAD_INPUT
    assert robot.sent == [("closed",)]
    assert "must be a finite number" in capsys.readouterr().err


def test_parameters_are_read_and_set_as_toml(robot, capsys):
    assert main(["param", "set", "wrench.cutoff_hz=10", "admittance.lateral=false", "robot.name=mine"]) == Exit.OK
    assert robot.sent[0] == ("set", {"wrench.cutoff_hz": 10, "admittance.lateral": False, "robot.name": "mine"})
    assert "parameter set 2 is in force from tick 9" in capsys.readouterr().out
    assert main(["param", "get", "admittance.lateral"]) == Exit.OK
    assert "admittance.lateral = true" in capsys.readouterr().out
    assert assignment("control.backlash_rad=[1, 2.5]") == ("control.backlash_rad", [1, 2.5])
    assert main(["param", "set", "nonsense"]) == Exit.BAD_INPUT


def test_status_in_fault_has_the_code_of_a_fault(robot, capsys):
    assert main(["status", "--json"]) == Exit.OK
    assert json.loads(capsys.readouterr().out)["state"] == "ENABLED"
    robot.answer |= {
        "state": "FAULT",
        "fault_cause": {"name": "watchdog", "text": "power was removed", "remedy": "look"},
    }
    assert main(["status"]) == Exit.FAULT
    assert "power was removed; look" in capsys.readouterr().out


def test_watch_without_a_terminal_writes_lines(robot, capsys):
    robot.rows = [record(42, depth_mm=3.0)]
    assert main(["watch", "--seconds", "0.2"]) == Exit.OK
    out = capsys.readouterr().out
    assert "tick 42" in out
    assert "depth 3.00" in out


def daemon_that(program: str, tmp_path) -> child.Daemon:
    daemon = child.Daemon(load("planar-sim"), "planar-sim", [], 0, tmp_path)
    daemon._command = [sys.executable, "-c", program]
    return daemon


@pytest.fixture(autouse=True)
def _keep_signals():
    import signal

    before = signal.getsignal(signal.SIGTERM)
    yield
    signal.signal(signal.SIGTERM, before)


def test_a_daemon_that_ends_at_once_is_an_error_with_its_last_words(tmp_path):
    with daemon_that("print('no such device'); raise SystemExit(3)", tmp_path) as daemon:
        for _ in range(100):
            if daemon._process.poll() is not None:
                break
            time.sleep(0.05)
        with pytest.raises(child.DaemonError, match="ended with 3: no such device"):
            daemon.operator()
    assert daemon.exit_code == 3


def test_the_daemon_is_ended_whatever_happens(tmp_path):
    with pytest.raises(KeyboardInterrupt), daemon_that("import time; time.sleep(60)", tmp_path) as daemon:
        raise KeyboardInterrupt
    assert daemon.exit_code == -15


def test_a_daemon_that_does_not_end_is_killed(tmp_path, monkeypatch):
    monkeypatch.setattr(child, "END_S", 0.3)
    program = (
        "import signal, time; signal.signal(signal.SIGTERM, signal.SIG_IGN); print('deaf', flush=True); time.sleep(60)"
    )
    with daemon_that(program, tmp_path) as daemon:
        while "deaf" not in daemon.output.read_text():
            time.sleep(0.02)
    assert daemon.exit_code == -9
