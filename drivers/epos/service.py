"""Slow dialogue with the drives while nothing is in real time: SDO and NMT by canopen, without its threads."""

import time
from collections.abc import Sequence
from typing import Any

import can
import canopen
from canopen.sdo import SdoClient

from drivers.epos.objects import Setting
from hal.errors import BackendError

RESPONSE_S, MOST_WAITING = 0.3, 1000
START, PREOPERATIONAL = 0x01, 0x80


class Service:
    """SDO clients of all nodes on a bus. Every method raises BackendError with what to do."""

    def __init__(self, bus: Any, nodes: Sequence[int]) -> None:
        self._bus = bus
        self._network = canopen.Network(bus=bus)
        self._clients = {node: WaitingClient(node, self) for node in nodes}
        for client in self._clients.values():
            client.network = self._network
            self._network.subscribe(client.tx_cobid, client.on_response)

    def forget(self) -> None:
        """Drop what waits."""
        for _ in range(MOST_WAITING):
            if not self.take(0.0):
                return

    def take(self, wait_s: float) -> bool:
        """Receive one frame and pass it on; False for none."""
        message = self._bus.recv(wait_s)
        if message is None:
            return False
        if message.is_error_frame and message.arbitration_id & 0x40:
            raise BackendError("the CAN controller is bus-off", remedy="check termination and wiring, then set the interface down and up")  # fmt: skip
        if not message.is_error_frame:
            self._network.notify(message.arbitration_id, message.data, message.timestamp)
        return True

    def command(self, command: int, node: int = 0) -> None:
        """NMT command to one node, or to all."""
        try:
            self._network.send_message(0, bytes((command, node)))
        except (can.CanError, OSError) as error:
            raise _dead(error) from None

    def read(self, node: int, index: int, sub: int, signed: bool = False) -> int:
        """Upload an object of at most four bytes."""
        what = f"{index:04X}:{sub} of node {node}"
        try:
            return int.from_bytes(self._clients[node].upload(index, sub), "little", signed=signed)
        except canopen.SdoAbortedError as error:
            raise BackendError(f"a drive refuses to tell its object {what}", value=f"abort {error.code:08X}", remedy="check its firmware and the generation in the settings") from None  # fmt: skip
        except canopen.SdoCommunicationError:
            raise _silent(node) from None
        except (can.CanError, OSError) as error:
            raise _dead(error) from None

    def write(self, node: int, setting: Setting) -> None:
        """Download an object."""
        try:
            self._clients[node].download(setting.index, setting.sub, setting.pack())
        except canopen.SdoAbortedError as error:
            raise BackendError(f"a drive refuses object {setting} of node {node}, value {setting.value}", value=f"abort {error.code:08X}", remedy="check the setting against the drive's manual") from None  # fmt: skip
        except canopen.SdoCommunicationError:
            raise _silent(node) from None
        except (can.CanError, OSError) as error:
            raise _dead(error) from None

    def hold(self, node: int, setting: Setting) -> None:
        """Write an object, and see that it has taken the value."""
        if not setting.fixed:
            self.write(node, setting)
        held = self.read(node, setting.index, setting.sub, setting.size < 0)
        if not setting.held_by(held):
            raise BackendError(f"a drive does not hold object {setting} of node {node}", value=held, bound=f"{setting.value}", remedy="check the setting against the drive's manual, and its firmware")  # fmt: skip


class WaitingClient(SdoClient):
    """canopen's SDO client, which receives from the bus by itself instead of waiting for a thread."""

    RESPONSE_TIMEOUT = 0.0

    def __init__(self, node: int, service: Service) -> None:
        super().__init__(0x600 + node, 0x580 + node, canopen.ObjectDictionary())
        self._service = service

    def read_response(self) -> bytes:
        """Let frames come in until the answer is among them. Raises as canopen's does."""
        end = time.monotonic() + RESPONSE_S
        while self.responses.empty() and (left := end - time.monotonic()) > 0.0 and self._service.take(left):
            pass
        return super().read_response()


def _silent(node: int) -> BackendError:
    return BackendError("a drive does not answer", value=f"node {node}", remedy="check its supply, its number, the bit rate and the termination")  # fmt: skip


def _dead(error: Exception) -> BackendError:
    return BackendError("nothing can be sent on the CAN bus", value=str(error), remedy="is the interface up and the other end connected? see docs/how-to/wire-epos-drives.md")  # fmt: skip
