"""The ports of this machine: 16-bit port instructions after ioperm, in C, one call a batch (07 section 1.5)."""

import ctypes
import errno
import hashlib
import os
import platform
import shutil
import subprocess
import tempfile
from pathlib import Path

import numpy as np

from hal.errors import BackendError
from hal.kernel import cache_directory
from hal.seams import OPERATION, TIMED_OUT, Kind

SOURCE = Path(__file__).with_name("ports.c")
FLAGS = ("-std=c11", "-O2", "-Wall", "-Wextra", "-Werror", "-shared", "-fPIC")
LAST_PORT, ALIGNMENT = 0xFFFF, 0x40
NO_RIGHT = -1


class NativePorts:
    """See :class:`hal.seams.PortIO`.

    The call holds the interpreter's lock: giving it away would hand a tick to another thread for milliseconds, and a
    batch is bounded.

    Args:
        base: first I/O address of the card, a multiple of 0x40. size: how many, up to 0x40.
        defines: macros for the C compiler; tests put an array in the place of the ports.

    Raises:
        BackendError: no such address, no x86-64, no compiler, or no right to use ports.
    """

    def __init__(self, base: int, size: int, defines: tuple[str, ...] = ()) -> None:
        if base % ALIGNMENT or not 0 < size <= ALIGNMENT or not 0 <= base <= LAST_PORT + 1 - size:
            raise BackendError("no card can be at this I/O address", value=f"{base:#x} .. {base + size - 1:#x}", bound="0x40 addresses from a multiple of 0x40", remedy="see the jumpers J1 and base")  # fmt: skip
        self._base, self._size = base, size
        self.library = ctypes.PyDLL(str(build(defines)))
        self._execute = self.library.rtctl_ports_execute
        self._execute.argtypes = [ctypes.c_void_p, ctypes.c_int32, ctypes.c_int32, ctypes.c_int32]
        self._acquired = False
        self._acquire()

    def execute(self, operations: np.ndarray) -> int:
        """See :class:`hal.seams.PortIO`. A thread that may not use ports sees what an absent card shows.

        Raises:
            TypeError: no contiguous array of OPERATION.
            ValueError: an operation is of no kind, or its port is odd or not on the card; then nothing was done.
        """
        if operations.dtype != OPERATION or not operations.flags.c_contiguous:
            raise TypeError("operations must be a contiguous array of hal.seams.OPERATION")
        outcome = self._execute(operations.ctypes.data, len(operations), self._base, self._size)
        if outcome >= 0:
            return outcome
        if outcome == NO_RIGHT:
            return _absent(operations)
        raise ValueError(
            f"operation {NO_RIGHT - 1 - outcome} is none for this card: {operations[NO_RIGHT - 1 - outcome]}"
        )

    def close(self) -> None:
        """Give the right to use the ports back."""
        if self._acquired:
            self.library.rtctl_ports_release(self._base, self._size)
            self._acquired = False

    def _acquire(self) -> None:
        code = self.library.rtctl_ports_acquire(self._base, self._size)
        if code:
            raise BackendError("the ports of the card cannot be used", value=errno.errorcode.get(code, code), remedy=_remedy(code))  # fmt: skip
        self._acquired = True


def build(defines: tuple[str, ...] = ()) -> Path:
    """The helper's shared library, compiled if the cache beside the kernels does not hold it. Raises BackendError."""
    if platform.machine() not in ("x86_64", "AMD64") or ctypes.sizeof(ctypes.c_void_p) != 8:
        raise BackendError("port instructions need an x86-64 machine and system", value=platform.machine(), remedy='run the card\'s driver on its PC, or use the seams "rig"')  # fmt: skip
    flags = (*FLAGS, *(f"-D{name}" for name in defines))
    digest = hashlib.sha256(" ".join(flags).encode() + SOURCE.read_bytes()).hexdigest()[:16]
    library = cache_directory().parent / f"ports-{digest}.so"
    if not library.is_file():
        _compile(flags, library)
    return library


def _compile(flags: tuple[str, ...], library: Path) -> None:
    """Beside its place first, so that nobody ever loads half a library."""
    compiler = shutil.which("gcc") or shutil.which("cc")
    if compiler is None:
        raise BackendError("the port helper cannot be compiled: there is no C compiler", remedy="install gcc (apt-get install gcc libc6-dev), or copy the library from a machine like this")  # fmt: skip
    try:
        library.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(dir=library.parent) as directory:
            made = Path(directory) / library.name
            done = subprocess.run([compiler, *flags, str(SOURCE), "-o", str(made)], capture_output=True, text=True)
            if done.returncode:
                raise BackendError("the port helper does not compile", value=done.stderr.strip()[-300:], remedy="is libc6-dev installed?")  # fmt: skip
            made.chmod(0o755)
            made.replace(library)
    except OSError as error:
        raise BackendError("the port helper cannot be kept", value=str(library), remedy=f"open the card once as the user who owns the cache, or set RTCTL_CACHE_DIR ({error.strerror})") from None  # fmt: skip


def _remedy(code: int) -> str:
    if code == errno.EPERM:
        return "the process needs the capability CAP_SYS_RAWIO, and a kernel that is not locked down (secure boot)"
    if code == errno.ENOSYS:
        return "this kernel is built without X86_IOPL_IOPERM"
    return os.strerror(code)


def _absent(operations: np.ndarray) -> int:
    operations["result"][operations["kind"] == Kind.READ] = 0xFFFF
    polls = operations["kind"] == Kind.POLL
    operations["result"][polls] = TIMED_OUT
    return int(polls.sum())
