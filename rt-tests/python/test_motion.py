"""Motions that the loop plans, beside those of the original ruckig."""

import csv
import json
import random
import subprocess

import numpy
import pytest
import ruckig
from pinocchio_robot import ROOT, TORQUECTL

CONFIG = ROOT / "config/leg/robot.toml"
PERIOD_S = 1e-3


def preview(tmp_path, start, target, *more):
    """Limits and samples of a motion of the leg; angles in degrees by joint."""
    pairs = lambda angles: [f"{joint}={angle!r}" for joint, angle in angles.items()]
    out = tmp_path / "way.csv"
    command = [TORQUECTL, "move", *pairs(target), "--preview", CONFIG, "--json", "-o", out, *more]
    if start:
        command += ["--from", *pairs(start)]
    answer = subprocess.run(command, capture_output=True, text=True, check=True)
    with out.open() as file:
        rows = list(csv.DictReader(file))
    return json.loads(answer.stdout), rows


@pytest.fixture(scope="module")
def joints(tmp_path_factory):
    """Names of the leg's joints."""
    plan, _ = preview(tmp_path_factory.mktemp("motion"), {}, {"knee": 10.0})
    return [joint["joint"] for joint in plan["joints"]]


@pytest.mark.parametrize("seed", range(12))
def test_as_the_original(tmp_path, joints, seed):
    rng = random.Random(seed)
    moving = rng.sample(joints, rng.randint(1, len(joints)))
    start = {joint: rng.uniform(5, 20) for joint in joints}
    target = {joint: rng.uniform(5, 20) for joint in moving}
    more = ["--speed", repr(rng.uniform(5, 60))] if seed % 2 else []
    plan, rows = preview(tmp_path, start, target, *more)

    original = ruckig.InputParameter(len(joints))
    by_joint = lambda key: [joint[key] for joint in plan["joints"]]
    original.current_position = by_joint("from_rad")
    original.target_position = by_joint("to_rad")
    original.max_velocity = by_joint("velocity_rad_per_s")
    original.max_acceleration = by_joint("acceleration_rad_per_s2")
    original.max_jerk = by_joint("jerk_rad_per_s3")
    trajectory = ruckig.Trajectory(len(joints))
    result = ruckig.Ruckig(len(joints), PERIOD_S).calculate(original, trajectory)
    assert result == ruckig.Result.Working
    assert plan["duration_s"] == pytest.approx(trajectory.duration, rel=1e-9)
    for row in rows[:: max(1, len(rows) // 50)]:
        theirs = numpy.array(trajectory.at_time(float(row["t"])))
        ours = [[float(row[f"{j}.{key}"]) for j in joints] for key in ("q", "dq", "ddq")]
        # Profiles of equal duration may differ in a joint that is not the slowest.
        slowest = numpy.argmax(trajectory.independent_min_durations)
        numpy.testing.assert_allclose(
            numpy.array(ours)[:, slowest], theirs[:, slowest], rtol=0, atol=1e-7
        )
