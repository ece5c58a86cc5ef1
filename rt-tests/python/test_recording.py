"""A recorded run, read by other people's MCAP and ROS 2 decoders: they find what torquectl exports."""

import csv
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from mcap.reader import make_reader
from mcap_ros2.reader import read_ros2_messages
from processes import BINARIES, LEG, ROOT

pytestmark = pytest.mark.real_time

SECONDS = 3
CYCLES = 1000 * SECONDS
TORQUECTL = os.environ.get("TORQUECTL", BINARIES / "torquectl")


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    folder = tmp_path_factory.mktemp("recording")
    path = folder / "run.mcap"
    environment = os.environ | {"TORQUED_RUN_DIR": str(folder), "XDG_STATE_HOME": str(folder / "state")}
    command = [BINARIES / "torqued", "run", LEG, "--simulate", "--seconds", str(SECONDS), "--record", path]
    subprocess.run(command, cwd=ROOT, env=environment, check=True)
    return path


def test_a_recording_that_is_there_is_left_alone(run):
    before = run.stat()
    command = [BINARIES / "torqued", "run", LEG, "--simulate", "--seconds", "1", "--record", run]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True)
    assert done.returncode == 2
    assert f"--record {run}: there is such a file" in done.stderr
    after = run.stat()
    assert (after.st_size, after.st_mtime_ns) == (before.st_size, before.st_mtime_ns)


@pytest.fixture(scope="module")
def exported(run):
    path = run.with_suffix(".csv")
    fields = "q,dq,tau_hat,wrench,stamp_ns"
    subprocess.run([TORQUECTL, "export", run, "-o", path, "--fields", fields], check=True)
    with open(path, newline="") as file:
        rows = csv.reader(file)
        titles = next(rows)
        columns = np.array([[float(cell) for cell in row] for row in rows]).T
    return dict(zip(titles, columns))


def test_every_message_is_indexed(run):
    with open(run, "rb") as file:
        summary = make_reader(file).get_summary()
    counts = {summary.channels[c].topic: n for c, n in summary.statistics.channel_message_counts.items()}
    cycles = counts["/torqued/cycle"]
    # Cycles that a busy machine left out are not there at all.
    assert 0.5 * CYCLES < cycles <= CYCLES
    assert set(counts.values()) == {cycles}
    attachments = summary.attachment_indexes
    assert [Path(a.name).name for a in attachments][0] == "robot.toml"
    assert {Path(a.name).suffix for a in attachments} >= {".toml", ".urdf", ".dbc"}


def test_joint_states_are_the_exported_ones(run, exported):
    messages = [m.ros_msg for m in read_ros2_messages(run, topics=["/joint_states"])]
    names = messages[0].name
    assert names == ["hip_yaw", "hip_roll", "hip_pitch", "knee", "ankle_pitch", "ankle_roll"]
    for j, name in enumerate(names):
        for ours, theirs in [
            (f"measured.joints[{name}].q [rad]", "position"),
            (f"measured.joints[{name}].dq [rad/s]", "velocity"),
            (f"estimated.joints[{name}].tau_hat.tau [N·m]", "effort"),
        ]:
            decoded = [getattr(message, theirs)[j] for message in messages]
            np.testing.assert_array_equal(decoded, exported[ours])
    stamps = np.array([m.header.stamp.sec * 10**9 + m.header.stamp.nanosec for m in messages])
    np.testing.assert_array_equal(np.diff(stamps), np.diff(exported["stamp_ns [ns]"]))


def test_wrenches_and_imu_are_decoded(run, exported):
    titles = [t for t in exported if t.startswith("measured.ft[") and ".wrench.force[2]" in t]
    assert titles
    for title in titles:
        sensor = title.split("[")[1].split("]")[0]
        messages = [m.ros_msg for m in read_ros2_messages(run, topics=[f"/wrench/{sensor}"])]
        assert messages[0].header.frame_id == sensor
        np.testing.assert_array_equal([m.wrench.force.z for m in messages], exported[title])
    imu = [m.ros_msg for m in read_ros2_messages(run, topics=["/imu"])]
    assert all(m.orientation_covariance[0] == -1 for m in imu)
    assert len(imu) == len(exported["time [s]"])


def test_the_example_plots_torque_against_reference(run, tmp_path):
    example = ROOT / "client/python/examples/plot_recording.py"
    picture = tmp_path / "knee.svg"
    command = [sys.executable, example, run, "--joint", "knee", "-o", picture]
    environment = os.environ | {"TORQUECTL": str(TORQUECTL)}
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=True)
    assert done.stdout.startswith("knee: ") and "N·m" in done.stdout
    drawn = picture.read_text()
    # Two curves and a band above, one curve below.
    assert drawn.count("<path") > 3 and "torque against reference" in drawn
