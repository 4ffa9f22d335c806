"""The device's side: read it at a fixed rate and publish what it says. Nothing else, so that it is easily trusted."""

import itertools
import os
import socket
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol, Self

import zenoh

from rtctl.client import open_session
from rtctl.gateway.keys import OPERATOR_TWIST
from rtctl.operator.message import NO_BUTTON, Button, Frame, OperatorMessage, encode

PERIOD_S = 0.01
Twist = tuple[float, float, float, float, float, float]
REST: Twist = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)


@dataclass(frozen=True)
class Sample:
    """What a device says now: twist [mm/s, rad/s], buttons that are down, and the level of the deadman."""

    twist: Twist = REST
    buttons: Button = NO_BUTTON
    deadman: bool = False


class Device(Protocol):
    """Something a person drives with."""

    def sample(self, now_s: float) -> Sample | None:
        """What it says now, None when it has come to its end; the deadman only if it is known to be held now.

        Raises:
            RtctlError: the device is gone.
        """
        ...

    def wait(self, timeout_s: float) -> None:
        """Return when there may be news, after `timeout_s` at the latest."""
        ...


class Publisher:
    """Publishes the messages of one device; a context manager, after which the deadman is released.

    Args:
        robot, endpoint, user, password: as of :class:`rtctl.client.Client`.
        device: its name; host and process id make it the source.
        frame: whose axes the twists are along.

    Raises:
        NoReply: nobody listens at the endpoint.
    """

    def __init__(
        self, robot: str, endpoint: str, device: str, frame: Frame = "gripper", user: str = "", password: str = ""
    ) -> None:
        self._source = f"{device}-{socket.gethostname()}-{os.getpid()}"[-64:]
        self._frame: Frame = frame
        self._sequence = itertools.count(1)
        self._session = open_session(endpoint, user, password)
        self._publisher = self._session.declare_publisher(
            f"rtctl/{robot}/{OPERATOR_TWIST}",
            encoding=zenoh.Encoding("application/json"),
            congestion_control=zenoh.CongestionControl.DROP,
            priority=zenoh.Priority.REAL_TIME,
            express=True,
        )

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_error: object) -> None:
        self.send(Sample())
        self._session.close()

    def send(self, sample: Sample) -> None:
        """Publish `sample` as true now; dropped rather than waited for."""
        message = OperatorMessage(
            version=1,
            source=self._source,
            sequence=next(self._sequence),
            timestamp_ns=time.time_ns(),
            frame=self._frame,
            twist=sample.twist,
            buttons=sample.buttons,
            deadman=sample.deadman,
        )
        self._publisher.put(encode(message))


def publish(device: Device, send: Callable[[Sample], None]) -> None:
    """Send what `device` says every :data:`PERIOD_S`, and at once when deadman or buttons change, until it ends."""
    due_s, last = time.monotonic(), Sample()
    while (sample := device.sample(now_s := time.monotonic())) is not None:
        if now_s >= due_s or (sample.deadman, sample.buttons) != (last.deadman, last.buttons):
            send(sample)
            last, due_s = sample, now_s + PERIOD_S
        device.wait(max(0.0, due_s - time.monotonic()))
