"""Makes the golden logs of this folder anew: ``make golden``. Commit them with the reason why the arithmetic changed.

Short lockstep runs with four milliseconds a tick and a sensor without noise, which keeps them small. None has a detector: its
tables come from LAPACK, whose last bit depends on the processor.
"""

import sys
import tempfile
from collections.abc import Callable
from pathlib import Path

import numpy as np

from rtctl import parameters
from rtctl.commands import Reason, Verb
from rtctl.electrode.robot_path import pack
from rtctl.exchange.control import Grade
from rtctl.gateway.setup import header_of, tables_of
from rtctl.guidance.impedance.layout import PAIRS
from rtctl.lifecycle import Operating, Task
from rtctl.lockstep import Lockstep
from rtctl.log.format import PARAMETERS, PLANS
from rtctl.replaying.golden import condense
from rtctl.settings import from_table, load, table_of
from rtctl.simulation import Recorder

FOLDER = Path(__file__).resolve().parent
SEED = 5
QUICK = (
    "loop.period_s=0.004", "trajectory.speed_mm_per_s=20.0", "trajectory.acceleration_mm_per_s2=400.0",
    "trajectory.jerk_mm_per_s3=8000.0", "trajectory.depth_acceleration_mm_per_s2=50.0",
    "trajectory.depth_jerk_mm_per_s3=2000.0", "homing.speed_rad_per_s=100.0", "homing.stall_s=0.05",
    "wrench.unbias_s=0.1", "wrench.cutoff_hz=20.0", "safety.power_on_ticks=10",
    "backend.options.sensor.force_noise_n=0.0", "backend.options.sensor.moment_noise_nmm=0.0",
    "backend.options.anatomy.entry_in_base_mm=[169.5, -4.35]",
)  # fmt: skip
START = np.array([151.0, -8.0, 0.0])
"""Near the home pose; the tip of an array is then a millimetre in front of the entry."""
BEARING_RAD = 0.224
DEPTHS_MM = np.linspace(0.0, 6.0, 13)


class Run:
    """A lockstep run that is logged."""

    def __init__(self, log: Path, *overrides: str) -> None:
        self.settings = load("planar-sim", [*QUICK, *overrides])
        self.recorder = Recorder()
        self.lockstep = Lockstep(self.settings, SEED, self.recorder.take)
        header = header_of(self.settings, SEED, Grade.SIM, 0)
        self.recorder.open(log, tables_of(self.lockstep.controller, self.lockstep.backend), header, 192 * 1024)
        self.memory = self.lockstep.controller.memory
        self.lockstep.advance(5)

    def do(self, verb: Verb, *arguments: float, verdict: Reason = Reason.ACCEPTED) -> None:
        given = Reason(int(self.lockstep.command(verb, *arguments)["command_verdict"]))
        assert given is verdict, f"{verb.name}: {given.name}"

    def until(self, done: Callable[[np.void], bool], limit: int = 2500) -> None:
        for _ in range(0, limit, 5):
            if done(self.lockstep.advance(5)):
                return
        raise AssertionError(f"did not happen within {limit} ticks")

    def rest(self) -> None:
        self.until(lambda r: not r["is_busy"])

    def home(self) -> None:
        self.do(Verb.ENABLE)
        self.until(lambda r: bool(r["powered"]))
        self.do(Verb.HOME)
        self.until(lambda r: bool(r["is_homed"]) and not r["is_busy"])

    def stage(self, topic: str, name: str, verb: Verb, record: np.ndarray, **content: object) -> None:
        self.recorder.document(topic, 0, {"number": int(record["number"][0]), **content}, record)
        self.memory[name] = record
        self.do(verb, float(record["number"][0]))

    def approach(self) -> None:
        """Homed, and an array at the beginning of a path that bends and pulls the stylet."""
        self.home()
        self.do(Verb.LOAD_ARRAY)
        self.do(Verb.UNBIAS)
        self.rest()
        d = DEPTHS_MM
        axis = np.array([np.cos(BEARING_RAD), np.sin(BEARING_RAD), 0.0])
        pose = START + np.outer(d, axis) + np.column_stack((0.0 * d, 0.01 * d**2, 0.01 * d))
        entry = np.array([169.5, -4.35, 0.0])
        path = pack(d, pose, 0.5 * np.maximum(d - 1.0, 0.0), entry_in_base=entry, insertion_axis_in_base=axis, number=1)
        self.stage(PLANS, "staged_plan", Verb.LOAD_PLAN, path)
        self.do(Verb.APPROACH)
        self.until(lambda r: r["task_state"] == Task.AT_ENTRY)


def insertion(run: Run) -> None:
    """Force correction of path and stylet on the way in, a pause, and the way out."""
    run.approach()
    run.do(Verb.INSERT, 4.0, 3.0)
    run.lockstep.advance(200)
    run.do(Verb.PAUSE)
    run.lockstep.advance(30)
    run.do(Verb.RESUME)
    run.until(lambda r: r["task_state"] == Task.HOLDING)
    run.do(Verb.RETRACT, 3.0, 3.0)
    run.rest()


def guidance(run: Run) -> None:
    """Impedance guidance in an insertion."""
    run.approach()
    run.do(Verb.INSERT, 5.0, 5.0)
    run.until(lambda r: r["task_state"] == Task.HOLDING)


def operation(run: Run) -> None:
    """Refusals, a move, another parameter set under way, streams, and a drive that jams."""
    run.do(Verb.MOVE_CP, *START, verdict=Reason.NO_POWER)
    run.home()
    run.do(Verb.INSERT, 1.0, 1.0, verdict=Reason.NO_PLAN)
    run.do(Verb.MOVE_CP, *START)
    run.lockstep.advance(40)
    values = {"control.integral_v_per_rad_s": [55.0] * 4, "control.backlash_rad": [1.7, 1.7, 1.7, 0.0]}
    settings = from_table(parameters.with_values(table_of(run.settings), values))
    record = parameters.pack(settings, run.lockstep.controller.robot, 2)
    run.stage(PARAMETERS, "staged_parameters", Verb.SET_PARAMETERS, record, values=values)
    run.rest()
    for k in range(12):
        run.do(Verb.SERVO_CV, 2.0, 1.0 - 0.2 * k, 0.01)
        run.lockstep.advance(4)
    run.rest()
    run.do(Verb.MOVE_CP, 159.0, -4.0, 0.02)
    run.until(lambda r: r["operating_state"] == Operating.FAULT)
    run.lockstep.advance(50)
    run.do(Verb.ACKNOWLEDGE)
    run.lockstep.advance(20)


RUNS: dict[str, tuple[Callable[[Run], None], tuple[str, ...]]] = {
    "insertion": (insertion, (
        "admittance.stylet=true", "admittance.blend_start_mm=0.5", "admittance.blend_end_mm=2.0",
        "admittance.regulated_force_n=-0.02",
    )),
    "guidance": (guidance, (
        "impedance.guidance=true", "impedance.interval_mm=0.25", "admittance.blend_start_mm=0.5",
        "admittance.blend_end_mm=2.0", "backend.options.impedance.pair_period_s=0.008",
        "trajectory.depth_speed_mm_per_s=5.0", f"impedance.bias_ohm={[100.0] * PAIRS}",
    )),
    "operation": (operation, ("backend.options.inject.jam_after_s=2.5",)),
}  # fmt: skip


def make(name: str, folder: Path) -> Path:
    """Carry out a run and write its golden log to `folder`; the path."""
    script, overrides = RUNS[name]
    target = folder / f"{name}.mcap"
    target.unlink(missing_ok=True)
    with tempfile.TemporaryDirectory() as work:
        log = Path(work) / "log.mcap"
        run = Run(log, *overrides)
        script(run)
        run.lockstep.close()
        run.recorder.close()
        condense([log], target)
    return target


if __name__ == "__main__":
    for name in sys.argv[1:] or RUNS:
        made = make(name, FOLDER)
        print(f"{made.name}: {made.stat().st_size / 1000:.0f} kB")
