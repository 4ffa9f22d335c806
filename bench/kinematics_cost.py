"""Forward kinematics of the hexapod, tick by tick along a motion, against the same arithmetic in C++ compiled in this run."""

import ctypes
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

from bench.figures import Figure, Target, compare, in_turns
from bench.layout import robot_header
from bench.native import compile_source, compiler, version
from bench.real_time import BenchError
from hal.kernel import kernel
from rtctl import robots
from rtctl.robots import Robot, hexapod, interface

PART = "kinematics"
COUNT = 20_000
ROUNDS = 51
TARGET = Target(1.5)

Forward = Callable[[np.ndarray, np.ndarray, np.ndarray, np.ndarray], None]


class NativeForward:
    """The forward kinematics in C++, compiled into `directory`. Raises subprocess.CalledProcessError: it does not compile."""

    def __init__(self, robot: Robot, directory: Path) -> None:
        (directory / "robot.hpp").write_text(robot_header(robot.record.dtype, hexapod))
        self._drive = ctypes.CDLL(str(compile_source("hexapod", directory))).drive
        self._drive.argtypes = [ctypes.c_void_p] * 4 + [ctypes.c_int64]
        self._drive.restype = None

    def __call__(self, record: np.ndarray, motor: np.ndarray, pose: np.ndarray, steps: np.ndarray) -> None:
        """The same as :func:`forward_many`."""
        arrays = record, motor, pose, steps
        assert all(array.flags.c_contiguous for array in arrays)
        self._drive(*(array.ctypes.data for array in arrays), len(motor))


@kernel
def forward_many(record, motor, pose, steps):
    """Poses (n, 6) at the motor angles (n, 6), each found from the value it has; the Newton steps (n,) of each."""
    for k in range(motor.shape[0]):
        steps[k] = interface.forward(record[0], motor[k], pose[k])


def motion(robot: Robot, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Motor angles (count, 6) of a motion through the box, and the poses (count, 6) from a period before: what a tick has."""
    low, high = robot.record["box_low"][0], robot.record["box_high"][0]
    phase = 2.0 * np.pi * np.arange(-1, count)[:, None] / COUNT
    poses = 0.5 * (low + high) + 0.4 * (high - low) * np.sin(phase * np.arange(1, 7))
    return np.array([robot.inverse(pose)[1] for pose in poses[1:]]), np.ascontiguousarray(poses[:-1])


def measure() -> list[Figure]:
    """Ratio of the times, in turns.

    Raises:
        BenchError: the two do not compute the same, so a ratio would mean nothing.
    """
    name = "forward kinematics of the hexapod"
    if compiler() is None:
        return [Figure(PART, name, "us", None, target=TARGET, note="skipped: no g++ on this machine")]
    robot = robots.load("hexapod", {})
    motor, start = motion(robot, COUNT)
    with tempfile.TemporaryDirectory() as directory:
        native = NativeForward(robot, Path(directory))

        def run_us(forward: Forward) -> tuple[float, np.ndarray]:
            pose, steps = start.copy(), np.zeros(COUNT, np.int64)
            began = time.perf_counter()
            forward(robot.record, motor, pose, steps)
            return (time.perf_counter() - began) / COUNT * 1e6, pose

        if (run_us(forward_many)[1] != run_us(native)[1]).any():
            raise BenchError("C++ computes other poses of the hexapod", value=COUNT, bound="the same to the bit", remedy="bring bench/cpp/hexapod.cpp up to date")  # fmt: skip
        ours, theirs = in_turns(ROUNDS, lambda: run_us(forward_many)[0], lambda: run_us(native)[0])
    note = f"{ROUNDS} rounds of {COUNT}, a tick of motion each; equal to the bit"
    return [compare(PART, name, "us", ours, theirs, reference_name=f"g++ {version()} -O2", target=TARGET, note=note)]
