"""Look into a step the simulated array could not solve, and try to go on from there.

    python -m studies.failed_step insertion.failed-step

The file is what `rtctl sim --log insertion.mcap` leaves beside its log. Shown is how the array lies; then the step is
tried again with a clean start and in ever smaller parts.
"""

import argparse
import sys
from pathlib import Path

import numpy as np

from hal.errors import RtctlError
from hal.kernel import kernel
from sim_backends.plant.rod.step import advance
from sim_backends.plant.snapshot import from_bytes

PARTS = (1, 10, 100, 1000)


@kernel
def _advance(device, pose, stylet_mm, step_s):
    return advance(device[0].array, device[0].scala, pose, stylet_mm, step_s)


def go_on(device: np.ndarray, parts: int) -> bool:
    """Take the failed tick of a bench (1,) again in `parts` equal steps; False if one of them fails too."""
    d = device[0]
    array, goal, period_s = d["array"], d["pose"].copy(), float(d["period_s"])
    start, stylet_mm = array["pose"].copy(), float(d["stylet_mm"])
    array["pace_mm"] = 0.0
    return all(
        _advance(device, start + (goal - start) * k / parts, stylet_mm, period_s / parts) for k in range(1, parts + 1)
    )


def main(arguments: list[str] | None = None) -> int:
    """Tell of a failed step; 0 if it can be gone on from."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("file", type=Path)
    file = parser.parse_args(arguments).file
    try:
        device = from_bytes(file.read_bytes())
    except (OSError, RtctlError) as error:
        print(f"failed_step: {error}", file=sys.stderr)
        return 1
    array = device[0]["array"]
    print(
        f"tick {device[0]['tick']}, gripper {np.round(array['pose'], 4).tolist()}, stylet {array['stylet_mm']:.3f} mm"
    )
    print(f"depth {array['depth_mm']:.3f} mm, folded {array['folded']}, buckled {array['buckled']}")
    print(f"wrench {np.round(array['wrench'], 4).tolist()}, posts {np.round(array['post_press_n'], 4).tolist()}")
    for parts in PARTS:
        again = device.copy()
        ended = go_on(again, parts)
        print(
            f"in {parts} parts: {'converged' if ended else 'failed'}, {again[0]['array']['iterations']} iterations in the last"
        )
        if ended:
            return 0
    return 1


if __name__ == "__main__":
    sys.exit(main())
