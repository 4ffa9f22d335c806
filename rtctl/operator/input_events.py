"""Game controllers and 3-D mice as the Linux kernel tells of them: the event interface, read without a library.

Source: the kernel's user-space interface, Documentation/input/input.rst, event-codes.rst and linux/input.h. One event is
a time (two longs), type and code (u16) and a value (s32).
"""

import contextlib
import fcntl
import os
import select
import struct
from pathlib import Path
from typing import Self

from hal.errors import RtctlError

EVENT = struct.Struct("@llHHi")
ABSOLUTE_INFO = struct.Struct("@6i")
"""value, minimum, maximum, fuzz, flat, resolution"""
IDENTITY = struct.Struct("@4H")
"""bus, vendor, product, version"""

EV_SYN, EV_KEY, EV_REL, EV_ABS = 0, 1, 2, 3
SYN_REPORT, SYN_DROPPED = 0, 3
BUS_BLUETOOTH = 5
REL_FULL_SCALE = 350.0
"""Largest value of a 3-D mouse that reports relative axes [U]."""
REL_FRESH_S = 0.1
"""Such a mouse repeats what is deflected, and says nothing at rest."""
GROUPS = (range(3), range(3, 6))
"""Relative axes that come in one report: those of translation, those of rotation."""


class DeviceError(RtctlError):
    """The input device cannot be used, or is gone."""

    exit_code = 3


def _read_request(number: int, size: int) -> int:
    """Number of an ioctl of the event interface that reads `size` bytes (asm-generic/ioctl.h)."""
    return 2 << 30 | size << 16 | ord("E") << 8 | number


GET_IDENTITY = _read_request(0x02, IDENTITY.size)
GRAB = 1 << 30 | struct.calcsize("i") << 16 | ord("E") << 8 | 0x90


class EventDevice:
    """State of one device, kept from its events; a context manager.

    Args:
        fd: where events are read; must not block.
        ranges: absolute axis -> (value at one end, value at the other).
    """

    def __init__(self, fd: int, ranges: dict[int, tuple[int, int]], name: str = "device") -> None:
        self.fd, self.name, self._ranges = fd, name, ranges
        self._values: dict[int, float] = {}
        self._relative: dict[int, float] = {}
        self._frame: dict[int, float] = {}
        self._relative_s = dict.fromkeys(GROUPS, -REL_FRESH_S)
        self._held: set[int] = set()
        self._lost = False
        self._rest = b""

    @classmethod
    def open(cls, path: Path) -> Self:
        """The device at `path`, for us alone.

        Raises:
            DeviceError: it is not there, not ours to read, in use, or wireless by Bluetooth.
        """
        try:
            fd = os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC)
        except PermissionError:
            remedy = "become a member of the group input, or see docs/how-to/drive-by-hand.md"
            raise DeviceError("the input device may not be read", value=str(path), remedy=remedy) from None
        except OSError as error:
            remedy = "connect it, or name it with --device"
            raise DeviceError(f"no input device: {error.strerror}", value=str(path), remedy=remedy) from None
        try:
            bus = IDENTITY.unpack(fcntl.ioctl(fd, GET_IDENTITY, bytes(IDENTITY.size)))[0]
            if bus == BUS_BLUETOOTH:
                remedy = "connect it by its cable: a lost radio link would hold the deadman"
                raise DeviceError("a Bluetooth device cannot be a deadman", value=str(path), remedy=remedy)
            fcntl.ioctl(fd, GRAB, 1)
            return cls(fd, _ranges(fd), path.name)
        except OSError as error:
            os.close(fd)
            remedy = "name an event device (/dev/input/event*), and end other programs that use it, like spacenavd"
            raise DeviceError(
                f"the input device cannot be used: {error.strerror}", value=str(path), remedy=remedy
            ) from None
        except DeviceError:
            os.close(fd)
            raise

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_error: object) -> None:
        os.close(self.fd)

    def wait(self, timeout_s: float) -> None:
        """Until there are events, `timeout_s` at the longest."""
        select.select([self.fd], [], [], timeout_s)

    def update(self, now_s: float) -> None:
        """Take every event that has arrived.

        Raises:
            DeviceError: the device is gone.
        """
        while select.select([self.fd], [], [], 0.0)[0]:
            try:
                data = os.read(self.fd, 64 * EVENT.size)
            except BlockingIOError:
                break
            except OSError as error:
                raise DeviceError(f"the device is gone: {error.strerror}", value=self.name) from None
            if not data:
                raise DeviceError("the device is gone", value=self.name, remedy="connect it and start again")
            data = self._rest + data
            whole = len(data) - len(data) % EVENT.size
            self._rest = data[whole:]
            for _, _, kind, code, value in EVENT.iter_unpack(data[:whole]):
                self._take(kind, code, value, now_s)

    def axis(self, code: int, now_s: float) -> float:
        """Deflection of an axis, -1 to 1; 0 where it is not known."""
        group = GROUPS[0] if code in GROUPS[0] else GROUPS[1]
        if now_s - self._relative_s[group] < REL_FRESH_S:
            return self._relative.get(code, 0.0)
        return self._values.get(code, 0.0)

    def is_held(self, code: int) -> bool:
        """Whether a button is down; only those count that were seen to go down."""
        return code in self._held

    def _take(self, kind: int, code: int, value: int, now_s: float) -> None:
        if kind == EV_SYN and code == SYN_DROPPED:  # the kernel ran out of room: nothing we knew is certain
            self._lost = True
            self._held.clear()
            self._values.clear()
            self._relative.clear()
        elif kind == EV_SYN and code == SYN_REPORT:
            if not self._lost:
                self._end_frame(now_s)
            self._frame.clear()
            self._lost = False
        elif self._lost:
            return
        elif kind == EV_KEY:
            (self._held.add if value else self._held.discard)(code)
        elif kind == EV_ABS and code in self._ranges:
            low, high = self._ranges[code]
            self._values[code] = min(max((2 * value - low - high) / (high - low), -1.0), 1.0)
        elif kind == EV_REL and code < 6:
            self._frame[code] = min(max(value / REL_FULL_SCALE, -1.0), 1.0)

    def _end_frame(self, now_s: float) -> None:
        """A relative axis at zero is not in its report: whatever of its group is missing is zero."""
        for group in GROUPS:
            if any(code in self._frame for code in group):
                self._relative_s[group] = now_s
                for code in group:
                    self._relative[code] = self._frame.get(code, 0.0)


def _ranges(fd: int) -> dict[int, tuple[int, int]]:
    """Ends of every absolute axis of sticks and 3-D mice (codes 0 to 5)."""
    ranges = {}
    for code in range(6):
        with contextlib.suppress(OSError):  # it does not have this one
            info = fcntl.ioctl(fd, _read_request(0x40 + code, ABSOLUTE_INFO.size), bytes(ABSOLUTE_INFO.size))
            _, low, high, *_ = ABSOLUTE_INFO.unpack(info)
            if high > low:
                ranges[code] = low, high
    return ranges
