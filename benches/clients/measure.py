"""Latency and rate of each client, beside a simulated leg at 1 kHz: the table of docs/clients.md.

    cargo build --release --workspace --bins --examples && .venv/bin/python benches/clients/measure.py [--seconds 10]

Latency is a round trip: from the sending of a reference to the first record of a cycle that followed it. It holds one
wait for the next cycle (0.5 ms in the mean), the cycle, and the client's own polling; the loop is not involved
otherwise. What has no commander is asked for its rate alone. Each client runs by itself, one after the other.
"""

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

ROOT = Path(__file__).parents[2]
TORQUED = ROOT / "config/leg/robot.toml"


def compiled(binaries, folder):
    """The C++ example, against the library of these binaries."""
    subprocess.run([ROOT / "client/c/install.sh", folder, binaries / "libtorqued_c.so"], check=True, stdout=sys.stderr)
    program, include, library = folder / "round_trip", folder / "include", folder / "lib"
    source = ROOT / "client/c/examples/06_round_trip.cpp"
    command = ["c++", "-O2", "-std=c++17", source, "-I", include, "-L", library, "-ltorqued", f"-Wl,-rpath,{library}"]
    subprocess.run([*command, "-o", program], check=True)
    return program


def round_trip(command, environment):
    done = subprocess.run(command, env=environment, check=True, capture_output=True, text=True)
    return json.loads(done.stdout.splitlines()[-1])


def lines_per_second(command, environment, seconds):
    """Records of a program that prints one in a line; the first second is left out."""
    with subprocess.Popen(command, env=environment, stdout=subprocess.PIPE, text=True) as program:
        begin = time.monotonic() + 1.0
        sequences, end = [], begin + seconds
        for line in program.stdout:
            now = time.monotonic()
            if now > end:
                break
            if now > begin:
                sequences.append(json.loads(line)["sequence"])
        program.terminate()
    spanned = sequences[-1] - sequences[0] + 1
    return {"records_per_s": len(sequences) / seconds, "lost": spanned - len(sequences)}


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seconds", type=float, default=10.0, help="of each client")
    parser.add_argument("--binaries", type=Path, default=ROOT / "target/release")
    parser.add_argument("--json", action="store_true")
    asked = parser.parse_args()
    binaries, seconds = asked.binaries.absolute(), str(asked.seconds)
    with tempfile.TemporaryDirectory() as folder:
        folder = Path(folder)
        environment = os.environ | {
            "TORQUED_RUN_DIR": str(folder / "run"),
            "XDG_STATE_HOME": str(folder / "state"),
            "PYTHONPATH": str(ROOT / "client/python"),
        }
        program = compiled(binaries, folder)
        daemon = subprocess.Popen(
            [binaries / "torqued", "run", TORQUED, "--simulate"], cwd=ROOT, env=environment, stderr=subprocess.DEVNULL
        )
        try:
            time.sleep(2.0)
            python = ROOT / "client/python/examples/02_round_trip.py"
            watch = [binaries / "torquectl", "watch", "--json", "--rate", "1000"]
            found = {
                "Rust": round_trip([binaries / "examples/04_round_trip", "leg", seconds], environment),
                "C, C++": round_trip([program, "leg", seconds], environment),
                "Python": round_trip([sys.executable, python, "leg", seconds], environment),
                "torquectl watch --json": lines_per_second(watch, environment, asked.seconds),
            }
        finally:
            daemon.terminate()
            daemon.wait()
    if asked.json:
        print(json.dumps(found))
        return
    print("| client | records a second | lost | round trip p50, p99, max, ms |\n| --- | --- | --- | --- |")
    for name, of in found.items():
        trip = ", ".join(f"{of[key]:.2f}" for key in ("p50_ms", "p99_ms", "max_ms")) if "p50_ms" in of else "-"
        print(f"| {name} | {of['records_per_s']:.0f} | {of['lost']} | {trip} |")


if __name__ == "__main__":
    main()
