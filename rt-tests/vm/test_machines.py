"""The machines that lend a vcan: on any processor, and one in the other's place."""

import os
import subprocess
from pathlib import Path

VM = Path(__file__).resolve().parent


def run(*command, **environment):
    return subprocess.run(
        [str(part) for part in command],
        env=os.environ | environment,
        text=True,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        check=False,
    )


def test_register_sets_of_full_and_of_shorter_length_are_taken(tmp_path, capsys):
    program = tmp_path / "xstate_shim_test"
    sources = [VM / "xstate_shim.c", VM / "xstate_shim_test.c"]
    built = run("gcc", "-Wall", "-Wextra", "-Werror", *sources, "-o", program, "-ldl")
    assert built.returncode == 0, built.stdout
    done = run(program)
    assert done.returncode == 0, done.stdout
    with capsys.disabled():
        print(f"\n{done.stdout.strip()}")


def test_without_user_mode_linux_the_other_machine_runs_the_command(tmp_path):
    """A linux.uml that dies at its start, in front of the real one."""
    broken = tmp_path / "linux.uml"
    broken.write_text("#!/bin/sh\necho 'Kernel panic: no such register' >&2\nexit 134\n")
    broken.chmod(0o755)
    command = (VM / "vcan.sh", "--buses", "1", "--", "ip", "-brief", "link", "show", "vcan0")
    done = run(*command, PATH=f"{tmp_path}:{os.environ['PATH']}")
    assert done.returncode == 0, done.stdout
    assert "vcan0" in done.stdout
    native = "CAN_RAW" in Path("/proc/net/protocols").read_text()
    assert native or "does not start on this machine" in done.stdout
    assert native or "no such register" in done.stdout
