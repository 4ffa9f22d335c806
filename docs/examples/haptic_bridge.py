"""A bridge from a vendor's haptic SDK to the operator's message: docs/how-to/drive-by-hand.md says how to use it."""

import time
from typing import Protocol

from rtctl.operator.publisher import Publisher, Sample, publish

FRESH_S = 0.05
"""A reading that has not been renewed for this time says nothing about the hand."""


class Sdk(Protocol):
    """What you write for your device, in a few lines around the vendor's library."""

    def read(self) -> tuple[int, tuple[float, float, float], tuple[float, float, float], bool]:
        """Count of readings, velocity of the handle [mm/s], its rate [rad/s], clutch held. Raises when it is gone."""


class HapticHandle:
    """A device of rtctl.operator.publisher: the deadman is the clutch, as long as the SDK has new readings."""

    def __init__(self, sdk: Sdk, scale: float = 0.1) -> None:
        self.sdk, self.scale, self.count, self.renewed_s = sdk, scale, -1, 0.0

    def sample(self, now_s: float) -> Sample:
        count, velocity, rate, held = self.sdk.read()
        if count != self.count:
            self.count, self.renewed_s = count, now_s
        vx, vy, vz, wx, wy, wz = (self.scale * value for value in (*velocity, *rate))
        return Sample((vx, vy, vz, wx, wy, wz), deadman=held and now_s - self.renewed_s < FRESH_S)

    def wait(self, timeout_s: float) -> None:
        time.sleep(timeout_s)


def bridge(sdk: Sdk, robot: str = "planar", endpoint: str = "tcp/127.0.0.1:7447") -> None:
    """Publish until the SDK raises or Ctrl-C; the deadman is released on the way out."""
    with Publisher(robot, endpoint, "haptic") as publisher:
        publish(HapticHandle(sdk), publisher.send)
