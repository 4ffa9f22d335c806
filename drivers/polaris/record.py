"""``python -m drivers.polaris.record``: tracked poses as CSV, one row for every frame in which the tool was seen.

    pose, frame                  number of the pose, from 1 on; the tracker's own frame number, 60 a second
    x_mm, y_mm, z_mm             position of the tool, in the frame of the reference tool, or of the tracker where there is none
    q0, qx, qy, qz               its unit quaternion
    error_mm                     the tracker's own rms of the tool's markers

Lines that begin with # are comments. Frames in which a tool was hidden or outside the volume are not in it, and counted.
"""

import argparse
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TextIO

import numpy as np

from drivers.polaris.geometry import relative
from drivers.polaris.line import TrackerPort
from drivers.polaris.tracker import Tracker
from hal.errors import BackendError

COLUMNS = "pose,frame,x_mm,y_mm,z_mm,q0,qx,qy,qz,error_mm"
PATIENCE = 10
"""Requests for every frame wanted, before a tool counts as hidden."""
EXAMPLES = """examples:
  the gripper in the frame of a tool on the robot's base, twenty frames a pose; press Enter at each pose, Ctrl-D at the end:
    python -m drivers.polaris.record --port /dev/ttyUSB0 --tool gripper.rom --reference base.rom --out tracked.csv

`python -m drivers.polaris.join` makes of it what `rtctl calibrate backlash` reads.
"""


def parser() -> argparse.ArgumentParser:
    """Arguments of the command."""
    p = argparse.ArgumentParser("python -m drivers.polaris.record", description="Record poses of a tool from a Polaris.", epilog=EXAMPLES, formatter_class=argparse.RawDescriptionHelpFormatter)  # fmt: skip
    p.add_argument("--port", required=True, metavar="PATH", help="serial port of the tracker")
    p.add_argument("--tool", required=True, type=Path, metavar="ROM", help="definition file of the tool")
    p.add_argument(
        "--reference", type=Path, metavar="ROM", help="definition file of the tool that poses are relative to"
    )
    p.add_argument("--out", required=True, type=Path, metavar="FILE", help="CSV file to write; it must not exist")
    p.add_argument("--frames", type=int, default=20, metavar="N", help="frames a pose, 1 to 1000 (20)")
    return p


def main(arguments: Sequence[str] | None = None, orders: TextIO | None = None) -> int:
    """Record a pose for every line of `orders`, else of standard input; 0, or 2 for what went wrong."""
    p = parser()
    given = p.parse_args(arguments)
    if not 1 <= given.frames <= 1000:
        p.error(f"--frames {given.frames}: allowed are 1 to 1000")
    if given.reference is not None and given.reference.stem == given.tool.stem:
        p.error(f"--reference {given.reference}: the tool and its reference need definition files of different names")
    try:
        with _new(given.out) as file, Tracker(TrackerPort(given.port)) as tracker:
            _record(tracker, given, file, orders or sys.stdin)
    except BackendError as error:
        print(f"record: {error}", file=sys.stderr)
        return 2
    return 0


def _new(path: Path) -> TextIO:
    try:
        return path.open("x")
    except OSError as error:
        raise BackendError("the file cannot be made", value=str(path), remedy=f"name a new one ({error.strerror})") from None  # fmt: skip


def _record(tracker: Tracker, given: argparse.Namespace, file: TextIO, orders: TextIO) -> None:
    tracker.connect()
    handle = tracker.load(given.tool)
    reference = None if given.reference is None else tracker.load(given.reference)
    tracker.start()
    of = "the tracker" if given.reference is None else given.reference.stem
    print(f"# {given.tool.stem} in the frame of {of}\n{COLUMNS}", file=file)
    print("record: Enter at every pose, Ctrl-D at the end", flush=True)
    poses = 0
    for _ in orders:
        rows = list(_frames(tracker, handle, reference, given.frames))
        if len(rows) < given.frames:
            print(f"record: seen in {len(rows)} of {given.frames} frames wanted; this pose is not kept, {_said(tracker)}", flush=True)  # fmt: skip
            continue
        poses += 1
        for row in rows:
            print(f"{poses},{row}", file=file)
        file.flush()
        print(f"record: pose {poses}, {_said(tracker)}", flush=True)
    print(f"record: {poses} poses in {given.out}", flush=True)


def _frames(tracker: Tracker, handle: int, reference: int | None, wanted: int) -> Iterator[str]:
    """Rows of new frames in which all were seen, `wanted` at most."""
    found = 0
    for _ in range(PATIENCE * wanted):
        new = tracker.poses()
        frame, pose = new.get(handle, (-1, None))
        if pose is None:
            continue
        quaternion, place = np.array(pose.quaternion), np.array(pose.position_mm)
        if reference is not None:
            reference_frame, seen = new.get(reference, (-1, None))
            if seen is None or reference_frame != frame:
                continue
            quaternion, place = relative(pose, seen)
        yield f"{frame}," + ",".join(f"{v:.4f}" for v in place) + "," + ",".join(f"{v:.6f}" for v in quaternion) + f",{pose.error_mm:.4f}"  # fmt: skip
        found += 1
        if found == wanted:
            return


def _said(tracker: Tracker) -> str:
    return ", ".join(f"{name} {count}" for name, count in sorted(tracker.counts.items())) or "nothing missed"


if __name__ == "__main__":
    sys.exit(main())
