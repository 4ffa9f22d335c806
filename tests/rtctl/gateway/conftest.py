"""A controller's world without a controller: shared memory, a double of the real-time process, and the gateway."""

import os
import socket
import subprocess
import sys
import threading
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pytest
from real_time_double import RealTimeDouble

from hal.backend import load
from rtctl.client import Client
from rtctl.controller import Controller
from rtctl.exchange.segment import Segment
from rtctl.gateway.process import Gateway
from rtctl.gateway.setup import tables_of
from rtctl.handover import layout, write_settings
from rtctl.settings import Settings, from_table


def free_endpoint() -> str:
    with socket.socket() as s:
        s.bind(("127.0.0.1", 0))
        return f"tcp/127.0.0.1:{s.getsockname()[1]}"


@dataclass
class World:
    """Everything a test of the gateway needs."""

    directory: Path
    table: dict[str, Any] = field(default_factory=dict)
    clients: list[Client] = field(default_factory=list)
    gateway: Gateway | None = None
    exit_code: int | None = None
    processes: list[subprocess.Popen] = field(default_factory=list)

    def __post_init__(self) -> None:
        options = {"endpoint": free_endpoint(), "lease_s": 0.5, "state_rate_hz": 100.0}
        self.table.setdefault("trajectory", {"speed_rad_per_s": 0.5})  # what the planned path needs
        self.table["gateway"] = options | self.table.get("gateway", {})
        self.settings: Settings = from_table(self.table)
        self.endpoint = self.settings.gateway.endpoint
        controller, choice = Controller(self.settings), self.settings.backend
        backend = load(choice.name, choice.options, period_s=self.settings.loop.period_s, seed=7)
        self.robot, self.tables = controller.robot, tables_of(controller, backend)
        self.segment = Segment.create(layout(controller, backend))
        self.real_time = RealTimeDouble(self.segment, self.tables, self.settings, self.robot.dof)

    def serve(self) -> Gateway:
        """The gateway on a thread of this process."""
        self.gateway = Gateway(os.dup(self.segment.fd), self.settings, self.directory, seed=7)
        self.thread = threading.Thread(target=self._serve, daemon=True)
        self.thread.start()
        return self.gateway

    def _serve(self) -> None:
        assert self.gateway is not None
        self.exit_code = self.gateway.serve()

    def join(self) -> int | None:
        """Wait for the gateway to end; its exit code."""
        self.thread.join(timeout=10.0)
        assert not self.thread.is_alive()
        return self.exit_code

    def spawn(self) -> subprocess.Popen:
        """The gateway as the supervisor starts it."""
        settings_fd = write_settings(self.settings)
        command = [sys.executable, "-m", "rtctl.gateway", "--memory-fd", str(self.segment.fd)]
        command += ["--settings-fd", str(settings_fd), "--run-directory", str(self.directory), "--seed", "7"]
        process = subprocess.Popen(command, pass_fds=[self.segment.fd, settings_fd], stderr=subprocess.PIPE, text=True)
        os.close(settings_fd)
        self.processes.append(process)
        return process

    def client(self, source: str = "test", **options: Any) -> Client:
        client = Client(self.settings.robot.name, self.endpoint, source, **options)
        self.clients.append(client)
        return client

    def close(self) -> None:
        for client in self.clients:
            client.close()
        self.real_time.stop()
        if self.gateway is not None:
            self.gateway.stop()
            self.join()
        for process in self.processes:
            if process.poll() is None:
                process.kill()
            process.communicate()


@pytest.fixture
def make_world(tmp_path):
    """A function that makes a world from a settings table; all is taken down afterwards."""
    worlds: list[World] = []

    def make(table: dict[str, Any] | None = None) -> World:
        worlds.append(World(tmp_path / f"run-{len(worlds)}", table or {}))
        return worlds[-1]

    yield make
    for world in worlds:
        world.close()


@pytest.fixture
def world(make_world):
    """A running double with its gateway on a thread."""
    made = make_world()
    made.real_time.start()
    made.serve()
    return made
