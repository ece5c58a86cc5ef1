"""`torquectl prove` in front of the second robot: sound wiring is proven and kept, wrong wiring is named."""

import json
import shutil
import subprocess

import pytest
from processes import BINARIES
from second_robot import JOINTS, DisturbedError, Leg, configuration

ATTEMPTS = 4


def prove(program, tmp_path, changes, *arguments):
    """Exit code, output and folder of a proof; again where the machine disturbed robot or daemon."""
    for attempt in range(ATTEMPTS):
        folder = tmp_path / f"attempt-{attempt}"
        try:
            with Leg(program, folder, lambda folder: configuration(folder, changes)) as leg:
                leg.start()
                mark = leg.mark()
                command = [BINARIES / "torquectl", "prove", folder / "robot.toml", *arguments]
                done = subprocess.run(command, capture_output=True, text=True, timeout=120)
                result = leg.judge(mark, 0)
                leg.require(done.returncode == 0 or "joint `" in done.stderr, done.stderr)
                # A proof moves nothing further than it says, whatever is wrong.
                leg.require(result.degrees < 0.6, str(result))
                return done, folder
        except DisturbedError as error:
            print(f"attempt {attempt + 1}: {error}")
    pytest.skip("the machine paused daemon, robot or client each time")


def check(folder):
    command = [BINARIES / "torquectl", "check", folder / "robot.toml"]
    done = subprocess.run(command, capture_output=True, text=True)
    return done.stdout + done.stderr


def test_sound_joints_are_proven_and_counted_until_their_tables_change(robot_program, tmp_path):
    done, folder = prove(robot_program, tmp_path, {}, "--json")
    assert done.returncode == 0, done.stderr
    joints = json.loads(done.stdout)["joints"]
    assert list(joints) == sorted(JOINTS)
    for joint in joints.values():
        assert 0.4 < joint["by_link_side_encoder"] / joint["asked"] < 1.6, joint
    assert "shows the torque" in [joint["current"] for joint in joints.values()]
    assert (folder / "proven.toml").exists()
    assert "not proven since" not in check(folder)
    config = folder / "robot.toml"
    config.write_text(config.read_text().replace("torque_limit_Nm = 150.0", "torque_limit_Nm = 149.0"))
    assert "joints knee are not proven since their tables have changed" in check(folder)


def test_a_current_of_the_other_direction_is_named(robot_program, tmp_path):
    changes = {'current = { signal = "KNEE.current" }': 'current = { signal = "KNEE.current", direction = -1 }'}
    done, folder = prove(robot_program, tmp_path, changes, "knee")
    assert done.returncode == 1 and "joint `knee` carries" in done.stderr, done.stdout + done.stderr
    assert "the current's direction" in done.stderr
    assert not (folder / "proven.toml").exists()


def test_a_joint_that_the_robot_does_not_have_is_refused(tmp_path):
    folder = tmp_path / "folder"
    folder.mkdir()
    config = configuration(folder)
    command = [BINARIES / "torquectl", "prove", config, "elbow"]
    done = subprocess.run(command, capture_output=True, text=True)
    assert done.returncode == 2 and "hip" in done.stderr and "elbow" in done.stderr
    shutil.rmtree(folder)
