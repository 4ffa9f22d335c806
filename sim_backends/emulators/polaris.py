"""``python -m sim_backends.emulators.polaris``: the emulated Polaris as a process of its own, on a pseudo terminal.

It prints the path to open, and takes orders from its standard input, one a line, each answered by "done":

    step N               go to step N of the scene
    inject FAULT VALUE   see :mod:`sim_backends.emulators.polaris_device`
    break                a serial break, which a pseudo terminal does not carry

The end of its input is its own.
"""

import math
import os
import select
import sys
import termios
import tty
from collections.abc import Callable, Sequence
from pathlib import Path

from sim_backends.emulators.polaris_device import EmulatedPolaris, Transform


def still(tool: int, step: int) -> Transform:
    """A scene for trying a client: tools beside each other, turned by a tenth of a radian a step about z."""
    half = 0.05 * step
    return math.cos(half), 0.0, 0.0, math.sin(half), 50.0 * tool, 10.0 * step, -1000.0


def scene_of(path: Path) -> Callable[[int, int], Transform]:
    """A scene from lines "w x y z x_mm y_mm z_mm": tool 0 at steps 0, 1, ...; all others stand still at the tracker's front."""
    steps = [tuple(float(v) for v in line.split()) for line in path.read_text().splitlines()]
    return lambda tool, step: steps[min(step, len(steps) - 1)] if tool == 0 else (1.0, 0.0, 0.0, 0.0, 0.0, 0.0, -1000.0)


def main(arguments: Sequence[str]) -> int:
    """Serve a pseudo terminal until standard input ends."""
    device = EmulatedPolaris(scene_of(Path(arguments[0])) if arguments else still)
    master, slave = os.openpty()
    tty.setraw(slave)
    print(os.ttyname(slave), flush=True)
    orders = b""
    while True:
        ready, _, _ = select.select([master, 0], [], [])
        if master in ready:
            data = os.read(master, 4096)
            if termios.tcgetattr(master)[5] == getattr(
                termios, f"B{device.baud}"
            ):  # at another rate it sees no characters
                os.write(master, device.feed(data))
        if 0 in ready:
            data = os.read(0, 4096)
            if not data:
                return 0
            *lines, orders = (orders + data).split(b"\n")
            for line in lines:
                _order(device, line.decode().split(), master)


def _order(device: EmulatedPolaris, words: list[str], master: int) -> None:
    match words:
        case ["step", number]:
            device.step = int(number)
        case ["inject", fault, value]:
            device.inject(fault, float(value))
        case ["break"]:
            os.write(master, device.restart())
    print("done", flush=True)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
