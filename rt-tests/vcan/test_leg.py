"""The leg: torqued and torqued-sim as two processes on two buses, a Python client as a third."""

import math
from types import SimpleNamespace

import pytest
from processes import LEG, PYTHON, Process, daemon, kernel_frames, simulator

SECONDS = 10
INTERFACES = ("vcan0", "vcan1")


@pytest.fixture(scope="module")
def run():
    """What each of them reports of ten seconds, and what the kernel counted on the buses."""
    before = kernel_frames(*INTERFACES)
    with simulator() as sim, daemon(LEG, "--seconds", SECONDS) as torqued:
        with Process(PYTHON, "rt-tests/vcan/read_torques.py", "leg", 1000) as client:
            seen = client.report()
        report = torqued.report()
        robot = sim.terminate()
    return SimpleNamespace(
        torqued=report, sim=robot, client=seen, kernel=kernel_frames(*INTERFACES) - before
    )


def test_ran_at_a_thousand_cycles_a_second(run):
    assert run.torqued["cycles"] + run.torqued["skipped_cycles"] == SECONDS * 1000
    # This kernel is not for timing (docs/testing.md), but it must not crawl either.
    assert run.torqued["cycles"] > SECONDS * 500


def test_not_one_frame_is_lost(run):
    assert run.torqued["frames_received"] == run.sim["frames_sent"]
    assert run.sim["frames_received"] == run.torqued["frames_sent"]
    assert run.kernel == run.torqued["frames_sent"] + run.sim["frames_sent"]
    # 2 SYNC and 2 command frames a cycle; 6 joint states and 2 F/T frames in answer.
    assert run.torqued["frames_sent"] == 4 * run.torqued["cycles"]
    assert run.torqued["frames_received"] == 8 * run.torqued["cycles"]


def test_not_one_frame_is_undecoded(run):
    for event in ("frame_unknown_id", "frame_wrong_length", "receive_overflow", "send_failed"):
        assert event not in run.torqued["events"]
    assert run.sim["frames_unknown"] == run.sim["frames_undecoded"] == run.sim["frames_lost"] == 0


def test_python_client_read_every_joints_torque(run):
    assert run.client["records"] == 1000
    assert len(run.client["joints"]) == 6
    for name, joint in run.client["joints"].items():
        for source in ("tau_encoder", "tau_whole_body"):
            assert joint[source]["valid"] == 1000, (name, source)
            assert math.isfinite(joint[source]["mean"]), (name, source)
