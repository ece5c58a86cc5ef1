"""Motions that the loop plans, beside those of the original ruckig."""

import csv
import json
import random
import subprocess

import numpy
import pytest
import ruckig
from pinocchio_robot import ROOT, TORQUECTL
from processes import Process, daemon

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


@pytest.mark.real_time
def test_a_running_robot_refuses_what_it_cannot_do_with_the_reason(tmp_path, monkeypatch):
    monkeypatch.setenv("TORQUED_RUN_DIR", str(tmp_path))

    def torquectl(*arguments):
        answer = subprocess.run([TORQUECTL, *arguments], capture_output=True, text=True)
        return answer.returncode, answer.stderr

    with daemon(ROOT / "config/lift-gripper/robot.toml", "--simulate") as running:
        running.wait_for("state: holding")
        # The finger, which stays, reaches 100 mm/s.
        assert torquectl("move", "boom=0", "--speed", "150") == (0, "")
        code, error = torquectl("move", "finger=20", "--speed", "150")
        assert code == 2 and "the velocity limit of every joint that is named" in error, error
        code, error = torquectl("move", "lift=300")
        assert code == 2 and "lift=300 is beyond its limits; allowed: -200.0 to 200.0 mm" in error, error
    with daemon(CONFIG, "--simulate") as running:
        running.wait_for("state: holding")
        code, error = torquectl("cartesian", "foot", "--stiffness", "1e6")
        assert code == 2 and "--stiffness" in error and "[[frame]]" in error, error
        code, error = torquectl("cartesian", "foot", "--damping-ratio", "9")
        assert code == 2 and "0.3 to 2" in error, error
