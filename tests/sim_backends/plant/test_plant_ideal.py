"""Each part of the chain without its faults, and the whole chain without any: then it is the printed equations."""

import math

import numpy as np
import pytest

from hal.errors import OptionError
from rtctl import robots
from rtctl.robots.planar_3rpr import Planar3rprOptions
from sim_backends.plant import sensor
from sim_backends.plant.backend import PlantBackend
from sim_backends.plant.ideal import idealised
from sim_backends.plant.options import Ideal, PlantOptions

PARTS = ("drive", "screw", "wire", "geometry", "sensor", "encoder")
WEIGHT_N, CENTRE_MM, LEVER_MM = 1.5, np.array([3.0, -2.0, 25.0]), 60.0
GRAVITY = np.array([0.10, -0.30, -0.95]) / np.linalg.norm([0.10, -0.30, -0.95])


def ideal(*parts):
    return {"ideal": dict.fromkeys(parts, True)}


def settled(bench, ticks, command_v):
    bench.run(ticks, command_v)
    bench.run(600, 0.0)
    return bench


def screws(bench):
    return bench.device["motor"]["angle_rad"][:3] * bench.device["motor"]["lead_mm_per_rad"][:3]


def static_load(pose, wrench):
    """Gravity and contact at the sensor (6,) in {F}, by vectors in space."""
    c, s = np.cos(pose[2]), np.sin(pose[2])
    rotation = np.array([[0, s, c], [0, -c, s], [1, 0, 0]])
    touch, weight = rotation.T @ [wrench[0], wrench[1], 0], rotation.T @ GRAVITY * WEIGHT_N
    moment = rotation.T @ [0, 0, wrench[2]] + np.cross([0, 0, LEVER_MM], touch) + np.cross(CENTRE_MM, weight)
    return np.concatenate((touch + weight, moment))


def test_there_is_a_switch_for_every_part_and_none_is_on():
    assert tuple(Ideal.__dataclass_fields__) == PARTS
    assert not any(getattr(Ideal(), part) for part in PARTS)
    with pytest.raises(OptionError, match="ideal"):
        PlantBackend({"ideal": {"motor": True}}, period_s=0.001, seed=0)
    with pytest.raises(OptionError, match=r"ideal\.wire"):
        PlantBackend({"ideal": {"wire": 1}}, period_s=0.001, seed=0)


@pytest.mark.parametrize("part", PARTS)
def test_a_switch_changes_its_part_only(part):
    before = PlantBackend({}, period_s=0.001, seed=0).options
    after = idealised(PlantBackend(ideal(part), period_s=0.001, seed=0).options)
    changed = {n for n in PlantOptions.__dataclass_fields__ if n != "ideal" and getattr(before, n) != getattr(after, n)}
    expected = {
        "drive": {"motor", "stylet"},
        "screw": {"motor", "stylet"},
        "wire": {"wire"},
        "geometry": {"geometry", "wire"},
        "sensor": {"sensor"},
        "encoder": {"motor", "stylet"},
    }
    assert changed == expected[part]


def test_an_ideal_drive_is_the_linear_machine(drive):
    """J dw/dt + b w = K g u from rest, for motors that carry nothing."""
    amplifier = {"amplifier": "voltage"}
    table = {"motor": amplifier, "stylet": {"motor": amplifier, "start_mm": 5.0}, **ideal("drive", "screw")}
    bench = drive(table)
    bench.run(30, (0.0, 0.0, 0.0, 9.0))
    expected = 20.0 * 0.2 * 9.0 / 0.06 * (1 - math.exp(-0.03 * 0.06 / 1.2e-3))
    assert bench.truth["motor_rate_rad_per_s"][3] == pytest.approx(expected, rel=0.01)
    creeping = drive(ideal("drive", "screw"))
    creeping.run(100, (0.0, 0.0, 0.0, 0.001))
    assert creeping.truth["motor_rate_rad_per_s"][3] > 0.0


def test_an_ideal_screw_is_driven_back_by_its_load(drive):
    for parts, turns in (((), False), (("screw",), True)):
        bench = drive({"wire": {"backlash_rad": [0.0] * 3}, **ideal(*parts)})
        bench.device["leg"]["piston_mm"] += 0.6  # a wire pulled out by hand
        bench.run(3, 0.0)
        assert bool((bench.truth["motor_rate_rad_per_s"][:3] > 0.0).all()) is turns


def test_an_ideal_wire_makes_the_piston_follow_the_screw(drive):
    bench, real = settled(drive(ideal("wire")), 700, 2.0), settled(drive(), 700, 2.0)
    for command in (2.0, -2.0, 1.0):
        bench.run(50, command)
        assert bench.device["leg"]["piston_mm"] == pytest.approx(screws(bench), abs=0.03)  # half a millisecond apart
        settled(bench, 1, 0.0)
        assert bench.device["leg"]["piston_mm"] == pytest.approx(screws(bench), abs=1e-7)
    assert np.abs(real.device["leg"]["piston_mm"] - screws(real)).min() > 0.05


def test_an_ideal_robot_is_the_printed_one(drive):
    bench = settled(drive(ideal("geometry")), 500, 2.0)
    nominal = robots.load("planar_3rpr", {})
    _, motors = nominal.inverse(bench.truth["pose_gripper_in_base"])
    assert np.array(motors) * 0.097 == pytest.approx(bench.device["leg"]["piston_mm"], abs=1e-8)
    assert bench.device["motor"]["lead_mm_per_rad"][:3] == pytest.approx(Planar3rprOptions().eta_mm_per_rad)


def test_an_ideal_encoder_tells_the_angle(drive):
    bench = settled(drive(ideal("encoder")), 300, 2.0)
    turned = bench.device["motor"]["angle_rad"] - bench.device["motor"]["zero_rad"]
    assert bench.sensors["axis_angle_rad"][0] == pytest.approx(turned, abs=1e-10)
    counting = settled(drive(), 300, 2.0)
    turned = counting.device["motor"]["angle_rad"] - counting.device["motor"]["zero_rad"]
    assert np.abs(counting.sensors["axis_angle_rad"][0] - turned).max() > 1e-5


@pytest.mark.parametrize("loaded", [0, 1])
def test_an_ideal_sensor_reads_weight_and_touch_to_the_last_digit(drive, loaded):
    bench = drive(ideal("sensor"))
    bench.load_array(loaded)
    for command in (2.0, -1.0, 0.0):
        settled(bench, 200, command)
        truth = bench.truth
        expected = static_load(truth["pose_gripper_in_base"], truth["wrench_on_gripper_in_base"])
        assert bench.sensors["wrench_in_sensor"][0] == pytest.approx(expected, abs=1e-6)


@pytest.mark.parametrize("wrench", [[-0.2, 0.05, 0.3], [0.0, 0.1, -1.0]])
def test_an_ideal_sensor_reads_a_touch_of_known_size(drive, wrench):
    one, pose, reading = drive(ideal("sensor")).device["sensor"], np.array([160.0, 0.0, 0.2]), np.zeros(6)
    sensor.stand(one, pose)
    sensor.bear(one, np.array(wrench), 0.2, 0.0, 0.0, 0.0)
    sensor.settle(one)
    assert sensor.sample(one, np.uint64(1), 5, reading)
    assert reading == pytest.approx(static_load(pose, wrench), abs=1e-12)


def test_with_everything_ideal_the_chain_is_transparent(drive):
    """Encoder = motor, piston = eta theta, pose = printed forward kinematics, reading = weight and - m a."""
    bench = drive(ideal(*PARTS))
    nominal = robots.load("planar_3rpr", {})
    start = screws(bench) / 0.097
    _, expected = nominal.inverse(bench.truth["pose_gripper_in_base"])
    assert start == pytest.approx(expected, abs=1e-9)
    for command, ticks in ((1.0, 200), (-0.5, 100), (0.0, 1500)):
        bench.run(ticks, command)
        angle = start + bench.sensors["axis_angle_rad"][0, :3]
        lag_rad = np.abs(bench.truth["motor_rate_rad_per_s"][:3]).max() * 0.0005  # of the piston behind its motor
        assert bench.device["leg"]["piston_mm"] == pytest.approx(0.097 * angle, abs=0.097 * lag_rad + 1e-8)
        pose = np.zeros(3)
        pose[:] = bench.truth["pose_gripper_in_base"]
        _, motors = nominal.inverse(pose)
        assert np.array(motors) == pytest.approx(angle, abs=lag_rad + 1e-7)
    assert bench.sensors["wrench_in_sensor"][0] == pytest.approx(static_load(pose, np.zeros(3)), abs=1e-5)


def test_an_ideal_bench_at_rest_stays_at_rest(drive):
    bench = drive(ideal(*PARTS))
    pose = bench.truth["pose_gripper_in_base"].copy()
    bench.run(1000, 0.0)
    assert bench.truth["pose_gripper_in_base"] == pytest.approx(pose, abs=1e-10)
    assert bench.sensors["wrench_in_sensor"][0] == pytest.approx(static_load(pose, np.zeros(3)), abs=1e-9)
