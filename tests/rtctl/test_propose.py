"""Motion profiles beside the tick: the same motion as ruckig's, straight, and refused with numbers."""

import ast
import inspect
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from ruckig import InputParameter, Ruckig, Synchronization, Trajectory

from hal.kernel import kernel
from rtctl import profile as profiles
from rtctl import propose
from rtctl.commands import Reason, Verb, explain
from rtctl.controller import Controller
from rtctl.electrode.robot_path import pack
from rtctl.lifecycle import Motion
from rtctl.settings import load

START = np.array([160.0, -2.0, 0.0])
LIMITS = ("speed", "acceleration", "jerk")


@kernel
def sample(profile, channels, times, result):
    for k in range(times.shape[0]):
        for c in range(channels):
            p, v, a = profiles.evaluate(profile[0], c, times[k])
            result[k, c, 0], result[k, c, 1], result[k, c, 2] = p, v, a


@pytest.fixture(scope="module")
def controller():
    return Controller(load("planar-sim"))


@pytest.fixture
def desk(controller):
    """The controller's memory as if homed, at rest at START, with a plan of 10 mm."""
    state = controller.memory["state"][0]
    for name in state.dtype.names:
        state[name] = np.zeros_like(state[name])
    state["homed"] = state["plan_number"] = 1
    state["setpoint"][:3] = state["pose"] = state["reference"] = START
    d = np.linspace(0.0, 10.0, 11)
    pose = START + np.column_stack((d, 0.02 * d**2, 0.01 * d))
    plan = pack(d, pose, d * 0.0, entry_in_base=np.zeros(3), insertion_axis_in_base=np.eye(3)[0], number=1)
    controller.memory["plan"] = plan
    return controller


def proposed(controller, verb, *arguments, tick=100):
    command = controller.memory["command"]
    command["verb"], command["argument"] = verb, 0.0
    command["argument"][0, : len(arguments)] = arguments
    controller.propose(tick)
    return controller.memory["proposal"]


def sampled(proposal, times, channels=4):
    result = np.zeros((len(times), channels, 3))
    sample(proposal, channels, np.asarray(times), result)
    return result


def independent(controller, goal, velocity, acceleration):
    p = controller.memory["parameters"][0]
    i, trajectory = InputParameter(3), Trajectory(3)
    i.synchronization = Synchronization.Phase
    i.current_position, i.current_velocity, i.current_acceleration = START, velocity, acceleration
    i.target_position = goal
    i.max_velocity, i.max_acceleration, i.max_jerk = (p[name][:3] for name in LIMITS)
    assert Ruckig(3).calculate(i, trajectory).value >= 0
    return trajectory


goals = st.tuples(st.floats(155.0, 168.0), st.floats(-4.0, 3.0), st.floats(-0.05, 0.2))
shares = st.tuples(*[st.floats(-1.0, 1.0)] * 3)


@given(goal=goals, v=shares, a=shares, excess=st.sampled_from([0.0, 0.9, 1.8]))
def test_the_profile_is_ruckigs_trajectory_from_any_state_of_motion(controller, goal, v, a, excess):
    memory = controller.memory
    state, parameters = memory["state"][0], memory["parameters"][0]
    state["homed"], state["on_path"] = 1, 0
    state["setpoint"][:3] = state["reference"] = START
    state["setpoint_rate"][:3] = excess * np.array(v) * parameters["speed"][:3]
    state["setpoint_acceleration"][:3] = excess * np.array(a) * parameters["acceleration"][:3]
    proposal = proposed(controller, Verb.SERVO_CP, *goal)
    assert proposal["reason"][0] == Reason.ACCEPTED
    expected = independent(controller, goal, state["setpoint_rate"][:3], state["setpoint_acceleration"][:3])
    assert proposal["duration_s"][0] == expected.duration
    times = np.linspace(0.0, expected.duration, 60)
    want = np.array([np.transpose(expected.at_time(t)) for t in times])
    assert sampled(proposal, times, 3) == pytest.approx(want, abs=1e-8)
    rest = sampled(proposal, [expected.duration + 1.0], 3)[0]
    assert rest[:, 0] == pytest.approx(goal, abs=1e-8)
    assert not rest[:, 1:].any()


def test_over_speed_is_braked_first(desk):
    desk.memory["state"]["setpoint_rate"][0, 0] = 12.0  # the limit was lowered under way
    proposal = proposed(desk, Verb.SERVO_CP, 168.0, -2.0, 0.0)
    assert proposal["segments"][0, 0] > 8, "pieces of the brake come before those of the move"
    speed = sampled(proposal, np.linspace(0.0, 3.0, 400))[:, 0, 1]
    assert speed.max() <= 12.0 + 1e-9
    assert speed[-1] == 0.0


tiny = st.tuples(*[st.sampled_from([0.0, 1e-9, 1.1e-6, -1e-5, 1e-3])] * 3).map(lambda d: tuple(START + d))


@given(goal=goals | tiny)
def test_a_move_from_rest_stays_on_the_straight_line(controller, goal):
    memory = controller.memory
    state = memory["state"][0]
    state["homed"], state["on_path"] = 1, 0
    state["setpoint"][:3] = state["reference"] = START
    state["setpoint_rate"] = state["setpoint_acceleration"] = 0.0
    proposal = proposed(controller, Verb.MOVE_CP, *goal)
    assert proposal["reason"][0] == Reason.ACCEPTED
    poses = sampled(proposal, np.linspace(0.0, float(proposal["duration_s"][0]), 50), 3)[:, :, 0]
    way = np.array(goal) - START
    share = (poses - START) @ way / max(way @ way, 1e-12)
    assert poses == pytest.approx(START + share[:, None] * way, abs=2e-6)
    assert (np.diff(share) >= -1e-7).all()
    motion = sampled(proposal, np.linspace(0.0, float(proposal["duration_s"][0]), 200), 3)
    for k, name in enumerate(LIMITS[:2], 1):
        assert (np.abs(motion[:, :, k]) <= memory["parameters"][name][0, :3] + 1e-7).all(), name


def test_a_profile_begins_one_tick_before_its_command_so_that_the_command_s_tick_moves(desk):
    assert proposed(desk, Verb.MOVE_CP, 165.0, 0.0, 0.0, tick=100)["start_tick"][0] == 99


def refusal(controller, verb, *arguments):
    p = proposed(controller, verb, *arguments)[0]
    assert not p["valid"]
    text, remedy = explain(int(p["reason"]), float(p["reason_value"]), float(p["reason_bound"]))
    assert "nan" not in text
    assert remedy
    return Reason(int(p["reason"])), float(p["reason_value"]), float(p["reason_bound"])


@pytest.mark.parametrize("verb", [Verb.MOVE_CP, Verb.SERVO_CP])
def test_a_goal_outside_the_box_is_refused_with_coordinate_and_value(desk, verb):
    reason, value, coordinate = refusal(desk, verb, 180.0, 0.0, 0.0)
    assert (reason, coordinate) == (Reason.OUTSIDE_BOX, 0)
    assert value > 176.0
    reason, value, coordinate = refusal(desk, verb, 160.0, 0.0, -0.5)
    assert (reason, coordinate) == (Reason.OUTSIDE_BOX, 2)


@pytest.mark.parametrize("verb", [Verb.MOVE_CP, Verb.SERVO_CP])
def test_a_goal_out_of_stroke_is_refused_with_joint_and_stroke(desk, verb):
    goal = (175.0, 7.5, -0.3)
    robot = desk.robot
    assert robot.explain(goal).what.startswith("q")
    reason, stroke, joint = refusal(desk, verb, *goal)
    low, high = robot.record["joint_low"][0], robot.record["joint_high"][0]
    assert reason is Reason.STROKE_LIMIT
    assert not low[int(joint)] <= stroke <= high[int(joint)]


def test_a_way_through_a_forbidden_region_is_refused_although_its_goal_is_fine(desk):
    desk.memory["robot"]["box_high"][0, 1] = 2.0
    desk.memory["state"]["setpoint"][0, :3] = desk.memory["state"]["reference"][0] = (160.0, -3.0, 0.0)
    try:
        assert proposed(desk, Verb.SERVO_CP, 160.0, 1.9, 0.0)["reason"][0] == Reason.ACCEPTED
        assert refusal(desk, Verb.MOVE_CP, 160.0, 2.1, 0.0)[0] is Reason.OUTSIDE_BOX
    finally:
        desk.memory["robot"] = desk.robot.record[0]


def test_a_singular_goal_is_refused_with_the_share_of_the_way():
    table = ["robot.geometry.box_low_mm_rad=[120, -60, -1.2]", "robot.geometry.box_high_mm_rad=[200, 60, 1.2]",
             "robot.geometry.stroke_min_mm=[-9, -9, -9]", "robot.geometry.stroke_max_mm=[200, 200, 200]"]  # fmt: skip
    controller = Controller(load("planar-sim", table))
    state = controller.memory["state"][0]
    state["homed"] = 1
    state["setpoint"][:3] = (162.5, 0.0, 0.0)
    reason, share, _ = refusal(controller, Verb.MOVE_CP, 162.5, 0.0, 1.1)
    assert reason is Reason.SINGULAR
    assert 0.6 < share < 1.0, "det J vanishes near 57 degrees = 0.9 of the way"
    assert controller.robot.explain((162.5, 0.0, 1.1 * (share - 0.02))) is None
    assert "singularity" in controller.robot.explain((162.5, 0.0, 1.1 * share)).what


def test_the_way_back_into_the_workspace_is_open(desk):
    desk.memory["state"]["setpoint"][0, :3] = (160.0, 8.3, 0.0)
    assert proposed(desk, Verb.MOVE_CP, 160.0, 7.0, 0.0)["reason"][0] == Reason.ACCEPTED
    assert refusal(desk, Verb.MOVE_CP, 160.0, 8.2, 0.0)[0] is Reason.OUTSIDE_BOX, "but not to stay outside"
    assert refusal(desk, Verb.MOVE_CP, 160.0, -11.5, 0.0)[0] is Reason.OUTSIDE_BOX, "nor out on the other side"


def test_a_move_off_the_path_begins_at_the_reference(desk):
    state = desk.memory["state"][0]
    state["on_path"], state["reference"] = 1, START + np.array([0.0, 1.5, 0.0])
    proposal = proposed(desk, Verb.MOVE_CP, *START)
    assert sampled(proposal, [0.0], 3)[0, :, 0] == pytest.approx(START + np.array([0.0, 1.5, 0.0]))


@pytest.mark.parametrize("speed", [0.0, -1.0, 3.0001])
def test_a_speed_outside_its_limits_is_refused_with_them(desk, speed):
    assert refusal(desk, Verb.INSERT, 5.0, speed) == (Reason.SPEED, speed, 3.0)


@pytest.mark.parametrize(
    ("verb", "depth", "goal", "bound"),
    [(Verb.INSERT, 0.0, 10.5, 10.0), (Verb.INSERT, 4.0, 3.0, 4.0), (Verb.INSERT, 0.0, -1.0, 0.0),
     (Verb.RETRACT, 4.0, 5.0, 4.0), (Verb.RETRACT, 4.0, -0.1, 4.0)],
)  # fmt: skip
def test_a_depth_outside_the_plan_or_behind_is_refused_with_the_limit(desk, verb, depth, goal, bound):
    desk.memory["state"]["setpoint"][0, 3] = depth
    assert refusal(desk, verb, goal, 1.0) == (Reason.DEPTH, goal, bound)


def test_an_insertion_is_a_motion_of_the_depth_alone(desk):
    proposal = proposed(desk, Verb.INSERT, 6.0, 1.0)
    assert proposal["segments"][0, :3].tolist() == [0, 0, 0]
    times = np.linspace(0.0, float(proposal["duration_s"][0]), 300)
    depth, speed, acceleration = np.moveaxis(sampled(proposal, times)[:, 3], 1, 0)
    assert (depth[0], depth[-1]) == (0.0, pytest.approx(6.0))
    assert speed.max() == pytest.approx(1.0)
    assert np.abs(acceleration).max() <= desk.memory["parameters"]["acceleration"][0, 3] + 1e-9


@pytest.mark.parametrize(("motion", "goal"), [(Motion.INSERT, 8.0), (Motion.RETRACT, 1.0)])
def test_resuming_goes_on_to_the_old_goal_at_the_old_speed(desk, motion, goal):
    state = desk.memory["state"][0]
    state["paused_motion"], state["setpoint"][3] = motion, 4.0
    state["depth_goal_mm"], state["depth_speed_mm_per_s"] = goal, 0.7
    proposal = proposed(desk, Verb.RESUME)
    end = sampled(proposal, [60.0])[0, 3]
    assert end[0] == pytest.approx(goal)
    assert np.abs(sampled(proposal, np.linspace(0, 10, 500))[:, 3, 1]).max() == pytest.approx(0.7)


def test_arguments_that_are_no_numbers_are_left_to_the_judge(desk):
    before = proposed(desk, Verb.MOVE_CP, 160.0, 0.0, 0.0).tobytes()
    assert proposed(desk, Verb.MOVE_CP, math.nan, 0.0, 0.0).tobytes() == before


def test_what_was_planned_before_has_no_influence(desk):
    desk.memory["state"]["setpoint_rate"][0, :3] = (1.0, -2.0, 0.01)
    times = np.linspace(0.0, 3.0, 100)
    first = sampled(proposed(desk, Verb.MOVE_CP, 165.0, 1.0, 0.1), times, 3).tobytes()
    proposed(desk, Verb.MOVE_CP, 158.0, -4.0, -0.02)
    proposed(desk, Verb.INSERT, 5.0, 1.0)
    assert sampled(proposed(desk, Verb.MOVE_CP, 165.0, 1.0, 0.1), times, 3).tobytes() == first


def test_nothing_of_ours_can_give_ruckig_intermediate_waypoints(desk):
    """They would be sent to a cloud service (design 9): no source names them, and no command fills them."""
    attributes = {
        node.attr for node in ast.walk(ast.parse(inspect.getsource(propose))) if isinstance(node, ast.Attribute)
    }
    waypoint_api = {
        name for kind in (InputParameter, Ruckig) for name in dir(kind) if "intermediate" in name or "waypoint" in name
    }
    assert "intermediate_positions" in waypoint_api
    assert not attributes & waypoint_api
    assert "max_number_of_waypoints" not in inspect.getsource(propose)
    for verb, arguments in (
        (Verb.MOVE_CP, (165.0, 0.0, 0.0)),
        (Verb.SERVO_CP, (161.0, 0.0, 0.0)),
        (Verb.INSERT, (5.0, 1.0)),
    ):
        proposed(desk, verb, *arguments)
    for inputs in (desk.proposer.pose_input, desk.proposer.depth_input):
        assert list(inputs.intermediate_positions) == []


def test_our_sources_import_ruckig_in_one_place_only():
    from hal.kernel import PACKAGES, ROOT

    users = [
        str(f.relative_to(ROOT))
        for p in PACKAGES
        for f in (ROOT / p).rglob("*.py")
        if any(
            "ruckig" in ast.unparse(n)
            for n in ast.walk(ast.parse(f.read_text()))
            if isinstance(n, ast.Import | ast.ImportFrom)
        )
    ]
    assert users == ["rtctl/propose.py"]
