"""The emulated tracker behind a line in memory, and as a process on a pseudo terminal."""

import subprocess
import sys

from sim_backends.emulators.polaris import still
from sim_backends.emulators.polaris_device import EmulatedPolaris


class MemoryLine:
    """A serial line whose other end answers at once, if the rates agree."""

    def __init__(self, hears_break=True):
        self.device = EmulatedPolaris(still)
        self.baud, self.hears_break, self.is_open = 9600, hears_break, True
        self.breaks, self.sent = 0, []
        self._coming = bytearray()

    def send(self, data):
        self.sent.append(bytes(data))
        if self.baud == self.device.baud:
            self._coming += self.device.feed(bytes(data))

    def receive(self, buffer):
        n = min(len(self._coming), len(buffer), 7)  # in pieces, as lines do
        buffer[:n] = self._coming[:n]
        del self._coming[:n]
        return n or -1

    def set_baud(self, baud):
        self.baud = baud

    def send_break(self):
        self.breaks += 1
        if self.hears_break:
            self._coming += self.device.restart()

    def close(self):
        self.is_open = False


class PtyTracker:
    """The emulator in its own process; `tell` gives it an order and waits until it is obeyed."""

    def __init__(self, *arguments):
        command = [sys.executable, "-m", "sim_backends.emulators.polaris", *map(str, arguments)]
        self._process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, bufsize=1)
        self.path = self._process.stdout.readline().strip()

    def tell(self, order):
        self._process.stdin.write(order + "\n")
        assert self._process.stdout.readline() == "done\n"

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self._process.stdin.close()
        self._process.wait(timeout=5)
        self._process.stdout.close()


def rom(directory, name, size=752):
    """A tool definition of `size` bytes."""
    path = directory / f"{name}.rom"
    path.write_bytes(b"NDI\x00" + bytes(n % 251 for n in range(size - 4)))
    return path
