"""What impedance guidance refuses to begin with, and the script that rests at intervals."""

import math

import numpy as np
import pytest

from hal.errors import OptionError
from rtctl import robots
from rtctl.commands import Verb
from rtctl.guidance.impedance.layout import CONTACTS, MEASURING, READY
from rtctl.lifecycle import Operating, Task
from rtctl.parameters import pack
from rtctl.record import controller_table
from rtctl.settings import load
from rtctl.workflow import Script, WorkflowError

BIAS = [float(k) for k in range(21)]
CALIBRATED = f"impedance.bias_ohm={BIAS}"


@pytest.mark.parametrize(
    ("overrides", "words"),
    [
        (["impedance.guidance=true"], ("bias_ohm", "calibrate saline")),
        ([f"impedance.bias_ohm={BIAS[:20]}"], ("20 numbers", "21 with pair_step = 1")),
        ([CALIBRATED, "impedance.pair_step=2"], ("21 numbers", "20 with pair_step = 2")),
        ([CALIBRATED, "impedance.guidance=true", "admittance.stylet=true"], ("one law", "admittance.stylet")),
        (["impedance.left_out=[1.5]"], ("left_out", "1.5")),
        (["impedance.left_out=[21]"], ("left_out", "21")),
        (["impedance.left_out=[-1]"], ("left_out", "-1")),
        (["impedance.left_out=[20]", "impedance.pair_step=2"], ("left_out", "0 .. 19")),
        ([CALIBRATED, "impedance.guidance=true", f"impedance.left_out={BIAS[:19]}"], ("too few pairs", "least_pairs = 3")),
        (["impedance.pitch_mm=0.9"], ("not on the array", "electrode.length_mm")),
        ([f"impedance.bias_ohm={[math.nan] * 21}"], ("finite",)),
        (["impedance.step_limit_mm=1.5"], ("step_limit_mm", "0 .. 1 mm")),
        (["impedance.mode=sometimes"], ("continuous | stepwise",)),
        (["impedance.when_blind=fault"], ("note | pause",)),
    ],
)  # fmt: skip
def test_what_cannot_guide_is_refused(overrides, words):
    with pytest.raises(OptionError) as error:
        load("planar-sim", overrides)
    for word in words:
        assert word in str(error.value)


def test_it_is_off_unless_asked_for():
    assert not load("planar-sim").impedance.guidance


def packed(*overrides):
    settings = load("planar-sim", overrides)
    robot = robots.load(settings.robot.kind, settings.robot.geometry)
    return pack(settings, robot, 1)[0]["impedance_law"]


def test_contacts_lie_on_the_array_from_the_tip_on():
    law = packed("impedance.first_contact_mm=0.5", "impedance.pitch_mm=0.6")
    assert law["place_mm"] == pytest.approx(18.0 - 0.5 - 0.6 * np.arange(CONTACTS))
    assert law["length_mm"] == 18.0


def test_twenty_pairs_leave_the_last_place_empty():
    law = packed("impedance.pair_step=2", f"impedance.bias_ohm={BIAS[1:]}", "impedance.left_out=[3, 19]")
    assert law["pairs"] == 20
    assert law["bias_ohm"].tolist() == [*BIAS[1:], 0.0]
    assert np.flatnonzero(law["left_out"]).tolist() == [3, 19]


class Obedient:
    """An operator whose array is wherever it is told to be, and whose law is ready after a while, or never."""

    def __init__(self, ready=True):
        self.row = np.zeros(1, controller_table(3).dtype)[0]
        self.row["operating_state"], self.row["stop_cause"], self.row["fault_cause"] = Operating.ENABLED, -1, -1
        self.ready, self.stops = ready, []

    def command(self, verb, *arguments):
        assert verb is Verb.INSERT
        self.row["depth_mm"], self.row["task_state"] = arguments[0], Task.HOLDING
        self.row["impedance_phase"] = MEASURING
        self.stops.append(arguments[0])
        return 0

    def wait(self, until, _timeout_s):
        assert not until(self.row), "it must wait for the law"
        if self.ready:
            self.row["impedance_phase"] = READY
        until(self.row)
        return self.row

    def plan(self, _progress):
        raise AssertionError

    def causes(self, _row):
        return []


def script(operator):
    return Script(operator, lambda _: None, ("insert",))


def test_a_stepwise_insertion_rests_at_every_interval_and_at_its_end():
    operator = Obedient()
    script(operator).insert(2.2, 1.0, 0.5)
    assert operator.stops == pytest.approx([0.5, 1.0, 1.5, 2.0, 2.2])
    operator = Obedient()
    script(operator).insert(3.0, 1.0, 1.0)
    assert operator.stops == pytest.approx([1.0, 2.0, 3.0])


def test_a_law_that_never_gets_ready_ends_the_insertion_with_a_word():
    with pytest.raises(WorkflowError, match="insert: not finished"):
        script(Obedient(ready=False)).insert(2.0, 1.0, 1.0)
