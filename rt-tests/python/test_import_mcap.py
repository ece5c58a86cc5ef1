"""`torquectl import` of recordings that other people's code has written: ROS 2 messages in CDR, in MCAP and SQLite."""

import csv
import math
import os
import sqlite3
import subprocess

import pytest
from mcap.reader import make_reader
from mcap_ros2.writer import Writer
from processes import BINARIES

TORQUECTL = os.environ.get("TORQUECTL", BINARIES / "torquectl")
HEADER = """std_msgs/Header header
{fields}
================================================================================
MSG: std_msgs/Header
builtin_interfaces/Time stamp
string frame_id
================================================================================
MSG: builtin_interfaces/Time
int32 sec
uint32 nanosec
"""
VECTOR = """================================================================================
MSG: geometry_msgs/Vector3
float64 x
float64 y
float64 z
"""
JOINT_STATE = HEADER.format(
    fields="string[] name\nfloat64[] position\nfloat64[] velocity\nfloat64[] effort"
)
WRENCH = (
    HEADER.format(fields="geometry_msgs/Wrench wrench")
    + "================================================================================\n"
    + "MSG: geometry_msgs/Wrench\nVector3 force\nVector3 torque\n"
    + VECTOR
)
MAP = """sample_rate_hz = 500
max_gap_ms = 30
[[joint]]
name = "elbow"
gear_ratio = 100
theta = { column = "/motors:elbow.position", unit = "rad" }
q = { column = "/joints:elbow.position", unit = "rad" }
i = { column = "/motors:elbow.effort", unit = "A" }
tau_sensor = { column = "/wrist:tz", unit = "Nm", sign = -1 }
"""


def header(t):
    return {"stamp": {"sec": int(t), "nanosec": round(t % 1 * 1e9)}, "frame_id": "wrist"}


def angle(t):
    return 0.7 + 0.3 * math.sin(2 * t)


@pytest.fixture
def log(tmp_path):
    """Two seconds: joints at 200 Hz, motors at 500 Hz and 3 ms off, the wrench at 100 Hz."""
    path = tmp_path / "run.mcap"
    messages = []
    for k in range(400):
        t = 100 + k / 200
        state = {"name": ["hand", "elbow"], "position": [0.0, angle(t)], "velocity": [], "effort": []}
        messages.append((t, "/joints", {"header": header(t)} | state))
    for k in range(1000):
        t = 100.003 + k / 500
        state = {"name": ["elbow"], "position": [100 * angle(t)], "velocity": [0.0], "effort": [t - 100]}
        messages.append((t, "/motors", {"header": header(t)} | state))
    for k in range(200):
        t = 100 + k / 100
        force = {"x": 1.0, "y": 2.0, "z": 3.0}
        wrench = {"force": force, "torque": {"x": 0.0, "y": 0.0, "z": 100 - t}}
        messages.append((t, "/wrist", {"header": header(t), "wrench": wrench}))
        messages.append((t, "/chatter", {"data": "hello"}))
    with path.open("wb") as file:
        writer = Writer(file)
        schemas = {
            "/joints": writer.register_msgdef("sensor_msgs/msg/JointState", JOINT_STATE),
            "/wrist": writer.register_msgdef("geometry_msgs/msg/WrenchStamped", WRENCH),
            "/chatter": writer.register_msgdef("std_msgs/msg/String", "string data"),
        }
        schemas["/motors"] = schemas["/joints"]
        for t, topic, message in sorted(messages, key=lambda m: m[0]):
            # Recorded later than it was taken.
            writer.write_message(topic, schemas[topic], message, log_time=round((t + 0.02) * 1e9))
        writer.finish()
    return path


def imported(log, tmp_path, text=MAP):
    (tmp_path / "map.toml").write_text(text)
    command = [TORQUECTL, "import", tmp_path / "map.toml", log, "-o", tmp_path / "out"]
    return subprocess.run(command, capture_output=True, text=True)


def test_topics_of_several_rates_become_one_log(log, tmp_path):
    run = imported(log, tmp_path)
    assert run.returncode == 0 and run.stderr == "", run.stderr
    with (tmp_path / "out/run.elbow.csv").open() as file:
        rows = [{key: float(x) for key, x in row.items()} for row in csv.DictReader(file)]
    assert len(rows) > 900
    for row in rows:
        t = 100.003 + row["t"]  # from where all topics have begun
        assert row["q"] == pytest.approx(angle(t), abs=1e-5)
        assert row["theta"] == pytest.approx(100 * angle(t), abs=1e-3)
        assert row["i"] == pytest.approx(t - 100, abs=1e-6)
        assert row["tau_sensor"] == pytest.approx(t - 100, abs=1e-6)


# As rosbag2_storage_sqlite3 makes them (sqlite_storage.cpp, schema version 4).
TABLES = """CREATE TABLE schema(schema_version INTEGER PRIMARY KEY, ros_distro TEXT NOT NULL);
CREATE TABLE metadata(id INTEGER PRIMARY KEY, metadata_version INTEGER NOT NULL, metadata TEXT NOT NULL);
CREATE TABLE topics(id INTEGER PRIMARY KEY, name TEXT NOT NULL, type TEXT NOT NULL, serialization_format TEXT NOT NULL,
  offered_qos_profiles TEXT NOT NULL, type_description_hash TEXT NOT NULL);
CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER NOT NULL, timestamp INTEGER NOT NULL, data BLOB NOT NULL);
CREATE INDEX timestamp_idx ON messages (timestamp ASC);
INSERT INTO schema VALUES (4, 'jazzy');"""


def as_sqlite(log):
    """The messages of an MCAP file as rosbag2 stores them in SQLite, the last ones first."""
    path = log.with_name("bag_0.db3")
    database = sqlite3.connect(path)
    database.executescript(TABLES)
    topics = {}
    with log.open("rb") as file:
        messages = list(make_reader(file).iter_messages())
    for schema, channel, message in reversed(messages):
        if channel.topic not in topics:
            topics[channel.topic] = len(topics) + 1
            row = (topics[channel.topic], channel.topic, schema.name, channel.message_encoding, "", "")
            database.execute("INSERT INTO topics VALUES (?, ?, ?, ?, ?, ?)", row)
        row = (topics[channel.topic], message.log_time, message.data)
        database.execute("INSERT INTO messages(topic_id, timestamp, data) VALUES (?, ?, ?)", row)
    database.commit()
    database.close()
    return path


def test_a_recording_in_sqlite_is_read_like_one_in_mcap(log, tmp_path):
    run = imported(as_sqlite(log), tmp_path)
    assert run.returncode == 0 and run.stderr == "", run.stderr
    assert imported(log, tmp_path).returncode == 0
    out = tmp_path / "out"
    assert (out / "bag_0.elbow.csv").read_bytes() == (out / "run.elbow.csv").read_bytes()


def test_sqlite_that_is_no_recording_is_named(log, tmp_path):
    other = tmp_path / "other.db3"
    database = sqlite3.connect(other)
    database.execute("CREATE TABLE notes(text TEXT)")
    database.commit()
    run = imported(other, tmp_path)
    assert run.returncode == 2 and "no such table: topics" in run.stderr and "`messages`" in run.stderr
    bag = as_sqlite(log)
    bag.write_bytes(bag.read_bytes()[:9000])
    run = imported(bag, tmp_path)
    assert run.returncode == 2 and "is SQLite, but no recording" in run.stderr


def test_gaps_that_leave_little_are_named(log, tmp_path):
    run = imported(log, tmp_path, MAP.replace("max_gap_ms = 30", "max_gap_ms = 9"))
    assert run.returncode == 0 and "gaps longer than max_gap_ms" in run.stderr


def test_a_file_that_ends_too_early_is_read_to_there(log, tmp_path):
    data = log.read_bytes()
    log.write_bytes(data[: len(data) // 2])
    run = imported(log, tmp_path)
    # Its chunk may be lost as a whole: then nothing is written.
    assert "ends too early" in run.stderr or "has no signal" in run.stderr
    assert (tmp_path / "out").exists() == (run.returncode == 0)


def test_what_is_not_there_is_named(log, tmp_path):
    run = imported(log, tmp_path, MAP.replace("/joints:elbow", "/joints:knee"))
    assert run.returncode == 2 and "/joints:knee.position" in run.stderr
    assert "/joints:elbow.position" in run.stderr
    text = tmp_path / "other.mcap"
    text.write_text("t,q\n0,1\n")
    run = imported(text, tmp_path)
    assert run.returncode == 2 and "is not an MCAP file" in run.stderr
