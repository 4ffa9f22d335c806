"""What the supervisor hands to its children through inherited descriptors, and how they take it."""

import json
import os
from typing import Any

from hal.backend import Backend
from hal.options import table_of
from rtctl.controller import Controller
from rtctl.exchange.segment import Layout
from rtctl.settings import Settings, from_table


def write_settings(settings: Settings) -> int:
    """Descriptor of an anonymous file with the settings, secrets included; it never touches a disk."""
    fd = os.memfd_create("rtctl-settings")
    os.pwrite(fd, json.dumps(table_of(settings)).encode(), 0)
    return fd


def read_settings(fd: int) -> Settings:
    """The settings behind a descriptor of :func:`write_settings`; any number of children may read it."""
    table: dict[str, Any] = json.loads(os.pread(fd, os.fstat(fd).st_size, 0))
    return from_table(table)


def layout(controller: Controller, backend: Backend) -> Layout:
    """The shared memory of this controller and backend."""
    truth = backend.truth()
    dtype = controller.memory.dtype
    return Layout(
        record=controller.table.dtype,
        truth=truth[1].dtype if truth is not None else None,
        plan=dtype["staged_plan"],
        parameters=dtype["staged_parameters"],
        capacity=controller.settings.log.ring_rows,
    )
