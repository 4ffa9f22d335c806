"""Emulated drives on an emulated CAN bus: the double of the device kind "epos_bus".

In the torque modes (CST, current) a drive is an amplifier of the bench: its current reaches the bench's motor as a command,
and its encoder shows the bench's angle, so that the plant closes the loop. In all other modes, and for an axis that the
bench does not have, the drive turns a motor of its own (:mod:`sim_backends.emulators.epos_rotor`), which the bench does not
see.
"""

from collections.abc import Mapping
from typing import Any

from hal.emulator import Bench, Station
from hal.errors import BackendError
from sim_backends.emulators.epos_can import ACTIVE, BUS_OFF, CONTROLLER, PASSIVE, LockstepBus
from sim_backends.emulators.epos_node import Node

MOST_TICKS = 100
"""That are caught up when the bench stood still."""
OVER_CURRENT, CURRENT_REGISTER = 0x2310, 0x03


class EmulatedEposBus:
    """One bus with its drives, made from the table of :class:`drivers.epos.device.EposBus`.

    Faults, with what their value says: bus_off, bus_passive, tx_full; busy (share of the bus that others take, 0 .. 1);
    mute, heartbeat_dead, ignore_setpoint, drive_fault, reboot (number of the node); sdo_abort, wrong_readback (index of
    the object, in all nodes); sync_delay (SYNCs that all nodes miss from now on). 0 mends.
    """

    faults = (
        "bus_off", "bus_passive", "tx_full", "busy", "mute", "heartbeat_dead", "ignore_setpoint", "drive_fault", "reboot",
        "sdo_abort", "wrong_readback", "sync_delay",
    )  # fmt: skip

    apart = False

    def __init__(self, name: str, table: Mapping[str, Any], station: Station) -> None:
        self.name, self._period_s = name, station.period_s
        channel = table["channel"]
        self.bus = LockstepBus(channel, int(table.get("bitrate", 1_000_000)))
        self.nodes: dict[int, Node] = {}
        self._wiring: list[tuple[Node, int, float, float]] = []
        for entry in table["nodes"]:
            node = Node(int(entry["node"]), entry.get("generation", "epos4"))
            node.drive.loops.counts_per_rad = float(entry["counts_per_rad"])
            self.nodes[node.node] = node
            self.bus.join(node)
            wire = (node, int(entry["axis"]), float(entry.get("direction", 1)), float(entry.get("gain_a_per_v", 1.0)))
            self._wiring.append(wire)
        self._tick: int | None = None
        station.switchboard.plug_bus(channel, self.bus)

    def sense(self, tick: int, bench: Bench) -> None:  # noqa: ARG002
        """The encoders see where the bench has come to."""
        for node, axis, direction, _ in self._wiring:
            if axis >= len(bench.angle_rad):
                continue
            node.drive.loops.sense(direction * float(bench.angle_rad[axis]), self._period_s)
            node.drive.loops.show()

    def drive(self, tick: int, bench: Bench) -> None:
        """Let one period pass on the bus and in the drives, and put their currents on the bench."""
        elapsed = 1 if self._tick is None else min(max(tick - self._tick, 1), MOST_TICKS)
        self._tick = tick
        for _ in range(elapsed):
            self.bus.let_pass(self._period_s)
            for node in self.nodes.values():
                node.advance(self._period_s)
        for node, axis, direction, gain_a_per_v in self._wiring:
            if axis >= len(bench.angle_rad):
                continue
            turned = node.drive.loops.turns_bench
            bench.enabled[axis] = turned and node.drive.power_stage
            bench.command_v[axis] = direction * node.drive.loops.current_set_a / gain_a_per_v if turned else 0.0

    def inject(self, fault: str, value: float = 1.0) -> None:
        """Break or mend something, see the class. Raises BackendError."""
        if fault not in self.faults:
            raise BackendError(f"emulated {self.name} has no such fault", value=fault, bound=" | ".join(self.faults))
        getattr(self, f"_{fault}")(value)

    def _bus_off(self, value: float) -> None:
        self.bus.off = bool(value)
        if value:
            self.bus.raise_error(BUS_OFF)

    def _bus_passive(self, value: float) -> None:
        self.bus.raise_error(CONTROLLER, PASSIVE if value else ACTIVE)

    def _tx_full(self, value: float) -> None:
        self.bus.full = bool(value)

    def _busy(self, value: float) -> None:
        self.bus.busy = value

    def _mute(self, value: float) -> None:
        for node in self.nodes.values():
            node.mute = node.node == value

    def _heartbeat_dead(self, value: float) -> None:
        for node in self.nodes.values():
            node.heartbeat_dead = node.node == value

    def _ignore_setpoint(self, value: float) -> None:
        for node in self.nodes.values():
            node.drive.ignores = node.node == value

    def _drive_fault(self, value: float) -> None:
        for node in self.nodes.values():
            node.drive.stuck_fault = node.node == value
            if node.node == value:
                node.drive.fail(OVER_CURRENT, CURRENT_REGISTER)

    def _reboot(self, value: float) -> None:
        if value:
            self._node(value).restart()

    def _sdo_abort(self, value: float) -> None:
        for node in self.nodes.values():
            node.sdo.refused = int(value)

    def _wrong_readback(self, value: float) -> None:
        for node in self.nodes.values():
            node.sdo.distorted = int(value)

    def _sync_delay(self, value: float) -> None:
        for node in self.nodes.values():
            node.deaf_to_sync = int(value)

    def _node(self, number: float) -> Node:
        if number not in self.nodes:
            raise BackendError(f"emulated {self.name} has no such node", value=number, bound=" | ".join(map(str, self.nodes)))  # fmt: skip
        return self.nodes[int(number)]
