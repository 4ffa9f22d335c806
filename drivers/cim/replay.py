"""``python -m drivers.cim.replay``: sends a recording of telemetry again, as it came, at its own pace or another."""

import argparse
import sys
import time
from collections.abc import Sequence
from pathlib import Path

from drivers.cim import recording
from hal.errors import RtctlError
from hal.sockets import UdpSocket

EXAMPLES = """examples:
  to a controller on this machine whose device "cim" has peer = "127.0.0.1:49301":
    python -m drivers.cim.replay cim-0001.cimrec --to 127.0.0.1:49300 --from 127.0.0.1:49301
  ten times as fast, to see what a decoder makes of it:
    python -m drivers.cim.replay cim-0001.cimrec --to 127.0.0.1:49300 --speed 10

Bytes are sent as they were recorded, with their sequence numbers and run. A device that has heard them already takes a second
replay for old datagrams; start it anew first.
"""


def parser() -> argparse.ArgumentParser:
    """Arguments of the command."""
    p = argparse.ArgumentParser("python -m drivers.cim.replay", description="Send recorded impedance telemetry again.", epilog=EXAMPLES, formatter_class=argparse.RawDescriptionHelpFormatter)  # fmt: skip
    p.add_argument("file", type=Path, metavar="FILE", help="recording of a device or of the relay")
    p.add_argument("--to", required=True, metavar="ADDRESS", help="where to, host:port: the device's `local`")
    p.add_argument("--from", dest="origin", default="", metavar="ADDRESS", help="where from, host:port: its `peer`")
    p.add_argument("--speed", type=float, default=1.0, metavar="FACTOR", help="0.01 to 1000 times its own pace (1)")
    return p


def main(arguments: Sequence[str] | None = None) -> int:
    """Replay the file; 0, or 2 if it cannot begin."""
    p = parser()
    given = p.parse_args(arguments)
    if not 0.01 <= given.speed <= 1000.0:
        p.error(f"--speed {given.speed:g}: allowed are 0.01 to 1000")
    try:
        datagrams = list(recording.read(given.file))
        socket = UdpSocket(given.origin, given.to)
    except RtctlError as error:
        print(f"replay: {error}", file=sys.stderr)
        return 2
    if not datagrams:
        print(f"replay: {given.file} holds no datagrams", file=sys.stderr)
        return 2
    print(
        f"replay: {len(datagrams)} datagrams in {(datagrams[-1][0] - datagrams[0][0]) / 1e6 / given.speed:.1f} s to {given.to}",
        flush=True,
    )
    try:
        _send(datagrams, socket, given.speed)
    except KeyboardInterrupt:
        print()
    finally:
        socket.close()
    return 0


def _send(datagrams: list[tuple[int, bytes]], socket: UdpSocket, speed: float) -> None:
    begin = time.monotonic()
    first_us = datagrams[0][0]
    for time_us, data in datagrams:
        time.sleep(max(begin + (time_us - first_us) / 1e6 / speed - time.monotonic(), 0.0))
        socket.send(data)


if __name__ == "__main__":
    sys.exit(main())
