"""A controller with a plant that a test can drive in a line, in lockstep: no process, no clock."""

from collections.abc import Callable, Iterable

import numpy as np
import pytest
from hypothesis import settings as hypothesis_settings

from rtctl.commands import Reason, Verb
from rtctl.electrode.robot_path import pack
from rtctl.lifecycle import Task
from rtctl.lockstep import Lockstep
from rtctl.settings import load

hypothesis_settings.register_profile("rtctl", deadline=None, max_examples=60, derandomize=True)
hypothesis_settings.load_profile("rtctl")

NOTHING_IN_REACH = "backend.options.anatomy.entry_in_base_mm=[400.0, 0.0]"
DOF = 3
ENTRY_POSE = np.array([160.0, 0.0, 0.0])
PATH_DEPTHS_MM = np.linspace(0.0, 10.0, 11)


def gentle_path(number: int = 1) -> np.ndarray:
    """A path (1,) of 10 mm from ENTRY_POSE that bends a little and pulls the stylet from 2 mm on."""
    d = PATH_DEPTHS_MM
    pose = ENTRY_POSE + np.column_stack((d, 0.02 * d**2, 0.01 * d))
    stylet = 0.8 * np.maximum(d - 2.0, 0.0)
    axis, entry = np.array([1.0, 0.0, 0.0]), np.array([*ENTRY_POSE[:2], 0.0])
    return pack(d, pose, stylet, entry_in_base=entry, insertion_axis_in_base=axis, number=number)


class Rig:
    """Lockstep with a memory: `rows` are all records so far, `truths` what the plant knows beside them."""

    def __init__(self, *overrides: str, seed: int = 1, anatomy: bool = False) -> None:
        self.settings = load("planar-sim", overrides if anatomy else (NOTHING_IN_REACH, *overrides))
        self._blocks: list[tuple[np.ndarray, np.ndarray]] = []
        self.lockstep = Lockstep(self.settings, seed, lambda r, t: self._blocks.append((r, t)))
        self.controller = self.lockstep.controller
        self.robot = self.controller.robot

    @property
    def rows(self) -> np.ndarray:
        return np.concatenate([r for r, _ in self._blocks])

    @property
    def truths(self) -> np.ndarray:
        return np.concatenate([t for _, t in self._blocks])

    @property
    def last(self) -> np.void:
        return self._blocks[-1][0][-1] if self._blocks else self._before

    @property
    def state(self) -> np.void:
        return self.controller.memory["state"][0]

    def order(self, verb: Verb, *arguments: float) -> Reason:
        """Give a command in the next tick; the verdict."""
        return Reason(int(self.lockstep.command(verb, *arguments)["command_verdict"]))

    def do(self, verb: Verb, *arguments: float) -> np.void:
        """Give a command that must be accepted; its record."""
        verdict = self.order(verb, *arguments)
        assert verdict is Reason.ACCEPTED, f"{verb.name} refused: {verdict.name}"
        return self.last

    def run(self, ticks: int) -> np.ndarray:
        """Let `ticks` ticks pass; their records."""
        first = len(self._blocks)
        self.lockstep.advance(ticks)
        return np.concatenate([r for r, _ in self._blocks[first:]])

    def until(self, predicate: Callable[[np.void], bool], limit: int = 30_000, step: int = 20) -> np.void:
        """Let time pass until `predicate` holds for a record; AssertionError after `limit` ticks."""
        for _ in range(0, limit, step):
            if predicate(self.last):
                return self.last
            self.lockstep.advance(step)
        raise AssertionError(f"did not happen within {limit} ticks")

    def rest(self) -> np.void:
        """Let the motion under way come to its end."""
        return self.until(lambda r: not r["is_busy"])

    def enable(self) -> "Rig":
        self.do(Verb.ENABLE)
        self.until(lambda r: r["powered"], step=1)
        return self

    def home(self) -> "Rig":
        self.enable()
        self.do(Verb.HOME)
        self.until(lambda r: r["is_homed"] and not r["is_busy"])
        return self

    def move(self, *pose: float) -> np.void:
        self.do(Verb.MOVE_CP, *pose)
        return self.rest()

    def load_plan(self, path: np.ndarray | None = None) -> Reason:
        """Stage a path, by default the gentle one, and load it."""
        path = gentle_path() if path is None else path
        self.controller.memory["staged_plan"] = path
        return self.order(Verb.LOAD_PLAN, float(path["number"][0]))

    def at_entry(self) -> "Rig":
        """Homed, array loaded, unbiased, plan loaded, and at the first pose of the plan."""
        self.home()
        self.do(Verb.LOAD_ARRAY)
        self.do(Verb.UNBIAS)
        self.rest()
        assert self.load_plan() is Reason.ACCEPTED
        self.do(Verb.APPROACH)
        self.until(lambda r: r["task_state"] == Task.AT_ENTRY)
        self.run(300)
        return self

    def fork(self) -> "Rig":
        """Another rig that goes on from here."""
        twin = object.__new__(Rig)
        twin.settings, twin._blocks, twin._before = self.settings, [], self.last
        twin.lockstep = Lockstep(self.settings, 1, lambda r, t: twin._blocks.append((r, t)))
        twin.controller, twin.robot = twin.lockstep.controller, self.robot
        a, b = self.lockstep, twin.lockstep
        for name in ("memory", "sensors", "actuators"):
            getattr(b.controller, name)[:] = getattr(a.controller, name)
        b.device.device[:] = a.device.device
        b.tick, b.sequence = a.tick, a.sequence
        return twin


def conditions(record: np.void) -> set[int]:
    """Numbers of the conditions that hold in a record."""
    return {c for c in range(63) if int(record["condition_active"]) >> c & 1}


@pytest.fixture(scope="session")
def make_rig() -> Callable[..., Rig]:
    return Rig


@pytest.fixture(scope="session")
def active_conditions() -> Callable[[np.void], Iterable[int]]:
    return conditions


@pytest.fixture(scope="session")
def homed_rig() -> Rig:
    """Homed and at rest in the middle of the workspace; fork it."""
    rig = Rig().home()
    rig.move(160.0, -2.0, 0.0)
    return rig


@pytest.fixture(scope="session")
def entry_rig() -> Rig:
    """At the entry of the gentle path, ready to insert; fork it."""
    return Rig().at_entry()


@pytest.fixture
def homed(homed_rig: Rig) -> Rig:
    return homed_rig.fork()


@pytest.fixture
def entry(entry_rig: Rig) -> Rig:
    return entry_rig.fork()
