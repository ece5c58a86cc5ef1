"""A tare of the running leg: by a client, kept across a restart of the daemon, shown by torquectl."""

import json
import re
import subprocess
from pathlib import Path

import pytest
import torqued
from processes import BINARIES, STATE, Process, daemon, derived_config, simulator

CONTACTS = """
[[contacts]]
name = "standing"
touch = [{ link = "base_link", type = "full_wrench" }, { link = "ankle_ft", type = "full_wrench" }]
[[contacts]]
name = "in_the_air"
touch = [{ link = "base_link", type = "full_wrench" }, { link = "ankle_ft", type = "none" }]
"""


@pytest.fixture
def hanging(tmp_path, leg_changes):
    """The leg with contact sets, and an F/T sensor that needs a tare."""
    line = 'unknown_wrench_link = "base_link"\n'
    config = derived_config(tmp_path, leg_changes | {line: ""})
    config.write_text(config.read_text() + CONTACTS)
    sim = config.parent / "sim.toml"
    text = sim.read_text()
    assert "bias_N = 0.05" in text
    sim.write_text(text.replace("bias_N = 0.05", "bias_N = 8"))
    return config


def state_file():
    return Path(STATE.name) / "torqued" / "leg" / "ft_offsets.toml"


def torquectl(*arguments):
    command = [BINARIES / "torquectl", *arguments, "--robot", "leg", "--json"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60)
    return done.returncode, done.stdout, done.stderr


def settle(client):
    """Waits until the filters are full."""
    for record in client.records(10.0):
        if record.cycle.sequence > 300:
            return


def force(client, seconds=0.5):
    """The sensor's force as the loop has it, the mean of some time: the leg sways a little."""
    client.latest()
    count = round(seconds * client.description.rate_hz)
    sums = [0.0] * 3
    for _, record in zip(range(count), client.records(10.0)):
        for axis in range(3):
            sums[axis] += record.cycle.measured.ft[0].wrench_hat.force[axis] / count
    return sums


def test_a_tare_holds_and_is_kept(hanging):
    with simulator(hanging):
        with daemon(hanging) as process:
            client = torqued.Client("leg", timeout_s=10.0)
            settle(client)
            before = force(client)
            assert client.contact_set_names == ["standing", "in_the_air"]
            with pytest.raises(torqued.RefusedError, match="every part of the robot has a contact"):
                client.tare("standing")
            sensor = client.tare("in_the_air").ft[0]
            assert sensor.known == 0b111111
            offset = list(sensor.offset.force)
            assert max(map(abs, offset)) > 1.0
            code, shown, _ = torquectl("tare", "--show")
            assert code == 0
            assert json.loads(shown)["ft"][0]["offset"]["force_N"] == offset
            # The loop has adopted it a quarter of a second later.
            client.latest()
            rate = client.description.rate_hz
            for _, record in zip(range(int(0.5 * rate)), client.records(10.0)):
                pass
            assert list(record.cycle.measured.ft[0].offset.force) == offset
            after = force(client)
            for axis in range(3):
                assert abs(before[axis] - after[axis] - offset[axis]) < 0.5
            client.choose_contact_set("in_the_air")
            code, shown, _ = torquectl("contacts")
            assert (code, json.loads(shown)["contacts"]) == (0, "in_the_air")
            assert process.terminate()["fault"] == 0
        assert "no tare" in process.output()
        with daemon(hanging) as process:
            client = torqued.Client("leg", timeout_s=10.0)
            assert list(client.next_record(10.0).cycle.measured.ft[0].offset.force) == offset
            assert re.search(r"F/T offsets of 20\S+Z \(.* old\), contacts in_the_air", process.output())
            code, _, error = torquectl("tare", "--contacts", "moon")
            assert code == 2 and "standing, in_the_air" in error
            assert torquectl("tare", "--forget")[0] == 0
            assert not state_file().exists()
            process.terminate()


def test_a_damaged_file_keeps_the_daemon_from_starting(hanging):
    state_file().parent.mkdir(parents=True, exist_ok=True)
    state_file().write_text("format = 1\nrobot = \"leg\"\ndate = ")
    try:
        process = Process(BINARIES / "torqued", "run", hanging)
        assert process.wait() == 2
        assert f"{state_file()}:3: " in process.output() and "remove it" in process.output()
    finally:
        state_file().unlink()
