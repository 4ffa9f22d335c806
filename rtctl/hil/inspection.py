"""Looking at the devices of a backend without moving anything: they are opened here, and never given power."""

import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np

from hal.backend import load
from hal.device import Device, Finding, Health
from hal.errors import BackendError, OptionError
from hal.frames import actuator_frame, sensor_frame
from rtctl.daemon import claim
from rtctl.settings import Settings

LOOK_S = 1.5
"""Longer than a sweep of the slowest device takes to be heard."""


@contextmanager
def opened(settings: Settings) -> Iterator[dict[str, Device]]:
    """The devices by name, opened and read for a while, without power; closed at the end.

    Raises:
        AlreadyRunningError: a daemon has them. OptionError: the backend is not made of devices.
        BackendError: one of them cannot be opened.
    """
    choice, period_s = settings.backend, settings.loop.period_s
    backend: Any = load(choice.name, choice.options, period_s=period_s, seed=0)
    if not hasattr(backend, "devices"):
        raise OptionError("this backend is not made of devices", value=choice.name, bound="hardware", remedy="take settings such as planar-hil")  # fmt: skip
    hold = claim(settings.robot.name)
    try:
        backend.open()
        _read(backend, round(LOOK_S / period_s), period_s)
        yield backend.devices
    finally:
        backend.close()
        hold.close()


def health(settings: Settings) -> dict[str, Health]:
    """What every device tells of itself. Raises as :func:`opened`."""
    with opened(settings) as devices:
        return {name: device.health() for name, device in devices.items()}


def findings(settings: Settings) -> dict[str, list[Finding]]:
    """What every device finds on its wires. Raises as :func:`opened`; a probe that fails is a finding."""
    found = {}
    with opened(settings) as devices:
        for name, device in devices.items():
            try:
                found[name] = device.probe()
            except BackendError as error:
                found[name] = [Finding("probe", str(error), False, error.remedy)]
    return found


def _read(backend: Any, ticks: int, period_s: float) -> None:
    sensors, actuators = np.zeros(1, sensor_frame(backend.axes)), np.zeros(1, actuator_frame(backend.axes))
    due = time.monotonic()
    for tick in range(1, ticks + 1):
        backend.read(tick, sensors)
        backend.write(tick, actuators)  # no power, but a card's watchdog is petted
        due += period_s
        if not backend.simulated:
            time.sleep(max(0.0, due - time.monotonic()))
