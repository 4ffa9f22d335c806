"""The one segment of shared memory, and who owns it.

The memory has no name: `Segment.create` makes an anonymous file (memfd) in the supervisor, whose children
inherit its descriptor (`subprocess.Popen(..., pass_fds=[segment.fd])`) and attach to it. The kernel counts who
still holds it and frees it after the last one, however they died, so nothing is left in /dev/shm after a kill -9,
and there is no name that a reader could unlink behind the others. (multiprocessing.shared_memory does just that:
its resource tracker removes the segment when any process that attached to it ends.) The size is sealed, since a
process that shrinks the file would kill all others with SIGBUS at their next access.

Each array has one writer: start the replacement of a dead process only when the dead one is reaped.
"""

import fcntl
import hashlib
import mmap
import os
from dataclasses import dataclass
from itertools import accumulate

import numpy as np

from hal.errors import RtctlError
from rtctl.commands import COMMAND
from rtctl.exchange.atomics import WORD
from rtctl.exchange.control import WORDS, Word
from rtctl.exchange.mailbox import MAILBOX_SHAPE, staging_shape
from rtctl.exchange.ring import ring_shape

MAGIC = int.from_bytes(b"rtctl/1\0", "little")
CACHE_LINE = 64
HEADER = np.dtype([("magic", "u8"), ("layout", "u8"), ("size", "u8")])


class LayoutError(RtctlError):
    """The two sides of the exchange do not mean the same bytes."""


@dataclass(frozen=True)
class Layout:
    """What the segment holds. Both sides build it from the same settings, and attaching checks that they did.

    Args:
        record: dtype of the controller's record.
        truth: dtype of the simulation's truth, or None without a simulation.
        plan: dtype of an insertion plan.
        parameters: dtype of a parameter set.
        capacity: records kept in each ring; 8192 are 8 s at 1 kHz, for a gateway to be restarted in.

    Raises:
        LayoutError: a dtype is not a whole number of 64-bit words, or there is no room for a record.
    """

    record: np.dtype
    truth: np.dtype | None
    plan: np.dtype
    parameters: np.dtype
    capacity: int = 8192

    def __post_init__(self) -> None:
        if self.capacity < 1:
            raise LayoutError("a ring has no room", value=self.capacity, bound="at least 1 record")
        for name in ("record", "truth", "plan", "parameters"):
            dtype = getattr(self, name)
            if dtype is not None and (dtype.itemsize == 0 or dtype.itemsize % WORD.itemsize):
                raise LayoutError(
                    f"a row of {name} does not fit 64-bit words",
                    value=dtype.itemsize,
                    bound="a multiple of 8 bytes",
                    remedy="pad the dtype",
                )

    @property
    def shapes(self) -> dict[str, tuple[int, ...]]:
        """Shape of each int64 array in the segment, in order."""
        return {
            "control": (WORDS,),
            "records": ring_shape(self.record, self.capacity),
            "truths": ring_shape(self.truth, self.capacity) if self.truth is not None else (0, 0),
            "mailbox": MAILBOX_SHAPE,
            "plans": staging_shape(self.plan),
            "parameters": staging_shape(self.parameters),
        }

    @property
    def offsets(self) -> list[int]:
        """Byte offset of each array, and at the end the size of the segment. Each array starts a cache line."""
        sizes = [int(np.prod(shape)) * WORD.itemsize for shape in self.shapes.values()]
        return list(accumulate((_whole_lines(s) for s in sizes), initial=_whole_lines(HEADER.itemsize)))

    @property
    def digest(self) -> int:
        """64 bits that change with any field of any dtype, any control word, and any shape."""
        dtypes = (self.record, self.truth, self.plan, self.parameters, COMMAND)
        fields = [None if d is None else np.lib.format.dtype_to_descr(d) for d in dtypes]
        text = repr((fields, [(w.name, w.value) for w in Word], self.shapes))
        return int.from_bytes(hashlib.sha256(text.encode()).digest()[:8], "little")


class Segment:
    """The mapped segment. `truths` is None without a simulation.

    Attributes:
        fd: descriptor to hand to a child process.
        control: control words (:mod:`rtctl.exchange.control`).
        records, truths: rings (:mod:`rtctl.exchange.ring`).
        mailbox, plans, parameters: commands and staging slots (:mod:`rtctl.exchange.mailbox`).
    """

    def __init__(self, fd: int, layout: Layout) -> None:
        """Map what :meth:`create` or :meth:`attach` made sure of; every page is there before this returns."""
        self.fd, self.layout = fd, layout
        *offsets, size = layout.offsets
        memory = mmap.mmap(fd, size, mmap.MAP_SHARED | mmap.MAP_POPULATE)
        arrays = [
            np.frombuffer(memory, WORD, int(np.prod(shape)), offset).reshape(shape)
            for shape, offset in zip(layout.shapes.values(), offsets, strict=True)
        ]
        self.control, self.records, truths, self.mailbox, self.plans, self.parameters = arrays
        self.truths = truths if layout.truth is not None else None

    @classmethod
    def create(cls, layout: Layout) -> "Segment":
        """Make a new segment: empty rings and mailbox, all control words zero. Done once, by the supervisor."""
        fd = os.memfd_create("rtctl", os.MFD_CLOEXEC | os.MFD_ALLOW_SEALING)
        size = layout.offsets[-1]
        os.ftruncate(fd, size)
        fcntl.fcntl(fd, fcntl.F_ADD_SEALS, fcntl.F_SEAL_SHRINK | fcntl.F_SEAL_GROW | fcntl.F_SEAL_SEAL)
        os.pwrite(fd, np.array([(MAGIC, layout.digest, size)], HEADER).tobytes(), 0)
        return cls(fd, layout)

    @classmethod
    def attach(cls, fd: int, layout: Layout) -> "Segment":
        """Map the segment behind an inherited descriptor, which then belongs to the Segment.

        Raises:
            LayoutError: it is no segment, or was made for another layout.
        """
        header = np.frombuffer(os.pread(fd, HEADER.itemsize, 0).ljust(HEADER.itemsize, b"\0"), HEADER)[0]
        if header["magic"] != MAGIC:
            raise LayoutError("not a segment of rtctl", value=fd, remedy="pass the descriptor of Segment.create")
        if (header["layout"], header["size"]) != (layout.digest, layout.offsets[-1]):
            raise LayoutError(
                "the shared memory was made for another layout",
                value=f"{layout.digest:016x}",
                bound=f"{int(header['layout']):016x}",
                remedy="start both processes from the same version and the same settings",
            )
        return cls(fd, layout)

    def close(self) -> None:
        """Give up the descriptor and the arrays; the memory stays mapped while the caller keeps one of the arrays."""
        if self.fd >= 0:
            os.close(self.fd)
            self.fd = -1
            del self.control, self.records, self.truths, self.mailbox, self.plans, self.parameters


def _whole_lines(size: int) -> int:
    return -(-size // CACHE_LINE) * CACHE_LINE
