"""What the axes and buttons of a game controller and of a 3-D mouse mean."""

import math
from dataclasses import dataclass, field
from pathlib import Path

from rtctl.operator.input_events import DeviceError, EventDevice
from rtctl.operator.message import NO_BUTTON, Button
from rtctl.operator.publisher import Sample, Twist

DEAD = 0.1
"""Deflection below which a stick or a cap counts as centred."""

BTN_0, BTN_1 = 0x100, 0x101
BTN_SOUTH, BTN_EAST, BTN_NORTH, BTN_WEST = 0x130, 0x131, 0x133, 0x134
BTN_TR, BTN_SELECT, BTN_START = 0x137, 0x13A, 0x13B
X, Y, Z, RX, RY, RZ = range(6)


@dataclass(frozen=True)
class Layout:
    """One kind of device.

    Attributes:
        axes: component of the twist -> axis and sign.
        buttons: code -> meaning.
        deadman: code of the button that must be held.
        links: where the kernel's device manager puts such devices.
    """

    name: str
    axes: dict[int, tuple[int, float]]
    buttons: dict[int, Button]
    deadman: int
    links: str = field(default="", repr=False)


GAMEPAD = Layout(
    "gamepad",
    {0: (Y, -1.0), 1: (X, -1.0), 2: (RY, -1.0), 5: (RX, -1.0)},
    {
        BTN_EAST: Button.STOP, BTN_SOUTH: Button.SLOWER, BTN_NORTH: Button.FASTER,
        BTN_START: Button.INSERT, BTN_SELECT: Button.RETRACT, BTN_WEST: Button.RESUME,
    },
    BTN_TR,
    "*-event-joystick",
)  # fmt: skip
"""Left stick: forwards and left; right stick: turn, and up; the right shoulder button is the deadman."""

SPACE_MOUSE = Layout(
    "space-mouse",
    {0: (Y, -1.0), 1: (X, -1.0), 2: (Z, -1.0), 3: (RY, -1.0), 4: (RX, -1.0), 5: (RZ, -1.0)},
    {BTN_1: Button.STOP},
    BTN_0,
    "*3Dconnexion*-event-*",
)
"""The cap's own axes are right, towards the person, down [U]; the left button is the deadman, the right one stops."""


class HandDevice:
    """A device of :mod:`rtctl.operator.publisher` on an input device with a layout.

    Args:
        speed_mm_per_s, speed_rad_per_s: of full deflection.
    """

    def __init__(self, events: EventDevice, layout: Layout, speed_mm_per_s: float, speed_rad_per_s: float) -> None:
        self._events, self._layout = events, layout
        self._speeds = speed_mm_per_s, speed_rad_per_s

    def sample(self, now_s: float) -> Sample:
        """See :class:`rtctl.operator.publisher.Device`."""
        self._events.update(now_s)
        twist = [0.0] * 6
        for component, (code, sign) in self._layout.axes.items():
            deflection = sign * self._events.axis(code, now_s)
            live = max(abs(deflection) - DEAD, 0.0) / (1.0 - DEAD)
            twist[component] = math.copysign(live, deflection) * self._speeds[component // 3]
        buttons = NO_BUTTON
        for code, button in self._layout.buttons.items():
            if self._events.is_held(code):
                buttons |= button
        vx, vy, vz, wx, wy, wz = twist
        whole: Twist = (vx, vy, vz, wx, wy, wz)
        return Sample(whole, buttons, self._events.is_held(self._layout.deadman))

    def wait(self, timeout_s: float) -> None:
        """Until the device has news."""
        self._events.wait(timeout_s)


def find(layout: Layout, directory: Path = Path("/dev/input/by-id")) -> Path:
    """The only device of that kind.

    Raises:
        DeviceError: there is none, or more than one.
    """
    found = sorted(directory.glob(layout.links))
    if len(found) != 1:
        remedy = "connect one, or name it with --device /dev/input/event*"
        names = ", ".join(str(path) for path in found) or "none"
        raise DeviceError(f"no single {layout.name} found", value=names, bound="one", remedy=remedy)
    return found[0]
