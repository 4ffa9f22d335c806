"""The C++ loop in a process of its own, which takes hold of the machine as the real-time process does.

    python -m bench.c_loop DIRECTORY PERIOD_NS TICKS PRIORITY CPU

DIRECTORY has loop.so and the arrays of a recorded piece, see :func:`prepare`. Prints how many grid points were missed.
"""

import ctypes
import subprocess
import sys
from pathlib import Path

import numpy as np

from bench.native import build
from bench.recorded import Piece
from rtctl.controller import Controller
from rtctl.machine import Machine, die_with_parent
from rtctl.settings import Loop, Settings

ARRAYS = ("memory", "sensors", "actuators", "records")


def prepare(settings: Settings, piece: Piece, directory: Path) -> None:
    """Compile the loop, and put the ticks of `piece` beside it. Raises subprocess.CalledProcessError."""
    build(Controller(settings), directory, "loop")
    for name, array in zip(ARRAYS, (piece.memory, piece.sensors, piece.actuators, piece.inputs()), strict=True):
        np.save(directory / f"{name}.npy", array)


def missed(directory: Path, loop: Loop, ticks: int) -> int:
    """Grid points a run of `ticks` missed. Raises subprocess.CalledProcessError if it did not come to its end."""
    numbers = round(loop.period_s * 1e9), ticks, loop.priority, loop.cpu
    command = [sys.executable, "-m", "bench.c_loop", str(directory), *map(str, numbers)]
    return int(subprocess.run(command, capture_output=True, text=True, check=True).stdout)


def main() -> None:
    """See the head of the module."""
    die_with_parent()
    directory = Path(sys.argv[1])
    period_ns, ticks, priority, cpu = (int(a) for a in sys.argv[2:])
    run_loop = ctypes.CDLL(str(directory / "loop.so")).run_loop
    run_loop.argtypes = [ctypes.c_void_p] * 5 + [ctypes.c_int64] * 3
    run_loop.restype = ctypes.c_int64
    arrays = [np.load(directory / f"{name}.npy") for name in ARRAYS]
    start = arrays[0].copy()
    addresses = [a.ctypes.data for a in (start, *arrays)]
    machine = Machine(Loop(priority=priority, cpu=cpu))
    print(run_loop(*addresses, len(arrays[-1]), period_ns, ticks))
    del machine  # it has held the machine until here


if __name__ == "__main__":
    main()
