"""Compiles the tick in C++ with the compiler of the machine and calls it."""

import ctypes
import shutil
import subprocess
from pathlib import Path

import numpy as np

from bench.layout import header
from rtctl.controller import Controller

SOURCES = Path(__file__).with_name("cpp")
FLAGS = ("-std=c++20", "-O2", "-ffp-contract=off", "-Wall", "-Wextra", "-shared", "-fPIC")
"""No contraction: the kernels round after every operation, too, so that the results can be compared to the bit."""


def compiler() -> str | None:
    """Path of the C++ compiler, None where there is none."""
    return shutil.which("g++")


def version() -> str:
    """Of that compiler; empty without one."""
    found = compiler()
    command = [found or "", "-dumpfullversion"]
    return subprocess.run(command, capture_output=True, text=True).stdout.strip() if found else ""


def build(controller: Controller, directory: Path, name: str) -> Path:
    """Compile the source called `name` for the records of `controller` into a library in `directory`.

    Raises:
        subprocess.CalledProcessError: the C++ does not compile, as when a field it uses is gone.
    """
    (directory / "layout.hpp").write_text(header(controller))
    return compile_source(name, directory)


def compile_source(name: str, directory: Path) -> Path:
    """Compile the source called `name`, whose generated header is in `directory`, into a library there.

    Raises:
        subprocess.CalledProcessError: the C++ does not compile.
    """
    found = compiler()
    assert found is not None
    library = directory / f"{name}.so"
    subprocess.run([found, *FLAGS, f"-I{directory}", str(SOURCES / f"{name}.cpp"), "-o", str(library)], check=True)
    return library


class NativeTick:
    """The tick in C++, compiled for the records of one controller.

    Args:
        controller: whose dtypes to compile for.
        directory: where the header and the library go.

    Raises:
        subprocess.CalledProcessError: see :func:`build`.
    """

    def __init__(self, controller: Controller, directory: Path) -> None:
        self._drive = ctypes.CDLL(str(build(controller, directory, "tick"))).drive
        self._drive.argtypes = [ctypes.c_void_p] * 4 + [ctypes.c_int64]
        self._drive.restype = None

    def drive(self, memory: np.ndarray, sensors: np.ndarray, actuators: np.ndarray, records: np.ndarray) -> None:
        """The same as :func:`bench.recorded.drive`."""
        for array in (memory, sensors, actuators, records):
            assert array.flags.c_contiguous
        addresses = (a.ctypes.data for a in (memory, sensors, actuators, records))
        self._drive(*addresses, len(records))
