"""A recorded run, read by other people's MCAP and ROS 2 decoders: they find what torquectl exports."""

import csv
import os
import subprocess
import sys
from pathlib import Path

import duckdb
import numpy as np
import pytest
from mcap.reader import make_reader
from mcap_ros2.reader import read_ros2_messages
from processes import BINARIES, LEG, ROOT

pytestmark = pytest.mark.real_time

SECONDS = 3
CYCLES = 1000 * SECONDS
TORQUECTL = os.environ.get("TORQUECTL", BINARIES / "torquectl")


def recorded(folder, seconds, *options):
    path = folder / "run.mcap"
    environment = os.environ | {"TORQUED_RUN_DIR": str(folder), "XDG_STATE_HOME": str(folder / "state")}
    command = [BINARIES / "torqued", "run", LEG, "--simulate", "--seconds", str(seconds), "--record", path]
    subprocess.run([*command, *options], cwd=ROOT, env=environment, check=True)
    return path


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    return recorded(tmp_path_factory.mktemp("recording"), SECONDS)


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


def test_a_table_in_parquet_is_that_in_csv(run, tmp_path):
    """Read by DuckDB: names, types, values to the last bit, and references that are not there."""
    fields = ["--fields", "sequence,flags,q,tau_hat,events,reference.mode"]
    csv_file, parquet = tmp_path / "run.csv", tmp_path / "run.parquet"
    for path in (csv_file, parquet):
        subprocess.run([TORQUECTL, "export", run, "-o", path, *fields], check=True, capture_output=True)
    table = duckdb.sql(f"SELECT * FROM '{parquet}'")
    with open(csv_file, newline="") as file:
        titles, *rows = csv.reader(file)
    assert table.columns == titles
    kinds = dict(zip(table.columns, map(str, table.types)))
    assert (kinds["time [s]"], kinds["sequence"], kinds["reference.mode"]) == ("DOUBLE", "UBIGINT", "UINTEGER")
    found = table.fetchall()
    assert len(found) == len(rows) > 0.5 * CYCLES
    for ours, theirs in zip(rows, found):
        assert theirs[0] == pytest.approx(float(ours[0]), abs=1e-9)
        expected = [float(cell) if cell else None for cell in ours[1:]]
        np.testing.assert_array_equal(np.array(theirs[1:], float), np.array(expected, float))
    assert {row[titles.index("reference.mode")] for row in found} == {None}, "no client commands"
    about = dict(duckdb.sql(f"SELECT key, value FROM parquet_kv_metadata('{parquet}')").fetchall())
    assert about[b"robot"] == b"leg"


def test_frames_alone_are_replayed_bit_by_bit_and_exported_as_all(tmp_path):
    path = recorded(tmp_path, 2, "--content", "frames")
    done = subprocess.run([TORQUECTL, "replay", path], capture_output=True, text=True)
    assert (done.returncode, done.stderr) == (0, "") and "bit-exact" in done.stdout
    fields = ["--fields", "tau_hat,sequence"]
    table = subprocess.run([TORQUECTL, "export", path, *fields], check=True, capture_output=True, text=True)
    assert table.stderr == ""
    titles, *rows = csv.reader(table.stdout.splitlines())
    torque = titles.index("estimated.joints[knee].tau_hat.tau [N·m]")
    assert len(rows) > 1000 and any(float(row[torque]) != 0.0 for row in rows)
    # For other people's tools ten messages a second, with what the loop had computed.
    messages = [m.ros_msg for m in read_ros2_messages(path, topics=["/joint_states"])]
    assert len(messages) == pytest.approx(len(rows) / 100, abs=2)
    knee = messages[-1].name.index("knee")
    efforts = {float(row[torque]) for row in rows}
    assert all(message.effort[knee] in efforts for message in messages)


def test_torques_at_a_rate_are_read_and_not_replayed(tmp_path):
    path = recorded(tmp_path, 2, "--content", "torques", "--rate", "100")
    command = [TORQUECTL, "export", path, "--fields", "sequence,tau_encoder"]
    table = subprocess.run(command, check=True, capture_output=True, text=True).stdout
    titles, *rows = csv.reader(table.splitlines())
    sequences = [int(row[titles.index("sequence")]) for row in rows]
    assert 100 <= len(sequences) <= 200 and all(number % 10 == 0 for number in sequences)
    subprocess.run([TORQUECTL, "info", path], check=True, capture_output=True)
    for refused in (["replay", path], ["calibrate", path, "-o", tmp_path / "calibrated"]):
        done = subprocess.run([TORQUECTL, *refused], capture_output=True, text=True)
        assert done.returncode == 2 and "torques alone" in done.stderr, done.stderr
    command = [BINARIES / "torqued", "run", LEG, "--simulate", "--record", tmp_path / "x.mcap", "--rate", "100"]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True)
    assert done.returncode == 2 and "content torques" in done.stderr


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
