#!/usr/bin/env python3
"""Calibrates the shipped robots with a user's commands and judges them on another motion.

    cargo build --release -p torqued -p torquectl
    python3 benches/calibration/run.py --out docs/results/calibration.md

Each robot is copied into a folder of its own. `torqued demo --record` records the daemon's loop on the
simulated robot, `torquectl calibrate` reads nothing but these recordings, `commit` adopts the
result, and `torqued demo` compares the torque from encoders with the true one in the demo's motion,
before and after. Needs Python alone.
"""

import argparse
import csv
import io
import json
import shutil
import subprocess
import sys
import tempfile
import time
import tomllib
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
# Recordings of each robot: motion, seconds, options of `torqued demo`.
RECORDINGS = {
    "test-joint": [("hanging", 100, [])],
    "leg": [("hanging", 120, [])],
    "humanoid": [
        ("hanging", 70, ["--harness", "chest_pitch_link"]),
        ("standing", 60, []),
    ],
}
# The leg's contact set allows its foot to be touched.
OPTIONS = {"leg": ["--untouched"]}
# Robots and seeds of the page: a humanoid takes ten minutes of a core.
DEFAULT = ["test-joint:1,2,3", "leg:1,2", "humanoid:2,3"]
JUDGED_S = 20
ARM = ("shoulder", "elbow", "wrist", "head")
AIM = {"leg and trunk": 2.0, "arm and head": 4.0}


LISTED = 4
MISSED = """## Joints that miss an aim

The {} of {} with the greatest error after; [all joints](calibration.csv). Fused: the error of `tau_hat`, to which no aim
applies."""


def run(arguments, folder, codes=(0,)):
    """Runs a command; gives what it prints."""
    done = subprocess.run(arguments, cwd=folder, capture_output=True, text=True)
    if done.returncode not in codes:
        sys.exit(f"{' '.join(map(str, arguments))}\n{done.stdout}{done.stderr}")
    return done.stdout


def demo(binaries, folder, name, robot, seed, seconds, *more):
    """Errors of every joint's torques in a motion of the simulated robot, kept in the file NAME.json."""
    kept = folder / f"{name}.json"
    if not kept.exists():
        config = f"config/{robot}/robot.toml"
        command = [binaries / "torqued", "demo", "--robot", config, "--seed", str(seed), "--fast", "--json"]
        text = run([*command, "--seconds", str(seconds), *more], folder, (0, 1))
        if not text:
            sys.exit(f"{robot}, {name}: no report; is the disk full?")
        kept.write_text(text)
    return json.loads(kept.read_text())


def calibrate(binaries, robot, seed, folder):
    """Records, calibrates, commits; the joints' figures before and after, and the time taken."""
    config = f"config/{robot}/robot.toml"
    if not (folder / config).exists():
        for part in (f"config/{robot}", f"robot-models/{robot}"):
            shutil.copytree(ROOT / part, folder / part)
        # Gears have a past, which the torsion does not show.
        sim = folder / f"config/{robot}/sim.toml"
        sim.write_text(sim.read_text().replace("[start]", "[start]\ngear_past = true"))
    # Of the humanoid, whose demo balances, the motion is one whose loads do not depend on that.
    judged = ["--motion", "config/humanoid/bow.toml"] if robot == "humanoid" else []
    before = demo(binaries, folder, "before", robot, seed, JUDGED_S, *judged)
    runs = []
    for motion, seconds, options in RECORDINGS[robot]:
        name = f"{motion}.mcap"
        path = f"config/{robot}/calibration/{motion}.toml"
        more = ["--motion", path, "--record", name, *options]
        report = demo(binaries, folder, motion, robot, seed, seconds, *more)
        if report["fault"]:
            sys.exit(f"{robot}, {motion}: fault {report['fault']}")
        runs.append(name)
    if not (folder / "calibrated").exists():
        began = time.monotonic()
        command = [binaries / "torquectl", "calibrate", *runs, "-o", "calibrated", "--report", "report.html"]
        command += OPTIONS.get(robot, [])
        run(command, folder, (0, 1))
        (folder / "took").write_text(str(time.monotonic() - began))
        run([binaries / "torquectl", "calibrate", "commit", config, "calibrated"], folder)
    after = demo(binaries, folder, "after", robot, seed, JUDGED_S, *judged)
    made = tomllib.loads((folder / "calibrated/calibration.toml").read_text())
    return {"before": before, "after": after, "made": made, "took_s": float((folder / "took").read_text())}


def per_cent(joint, torque="encoder"):
    return 100 * joint[torque]["rms"] / joint["largest_torque"]


def group(name):
    return "arm and head" if any(part in name for part in ARM) else "leg and trunk"


COLUMNS = ("robot", "joint", "largest torque, N·m", "before, %", "after, %", "after, error / sigma", "held out, %",
           "fused, %", "undetermined")  # fmt: skip


def rows(robot, results):
    """A row of figures for each joint of a robot, and whether it meets the aims of RMS and of sigma."""
    seeds = sorted(results)
    lines = []
    for k, joint in enumerate(results[seeds[0]]["after"]["joints"]):
        name = joint["name"]
        of = lambda key: [results[s][key]["joint" if key == "made" else "joints"][k] for s in seeds]
        before, after = [[per_cent(j) for j in of(key)] for key in ("before", "after")]
        ratio = [j["encoder"]["rms_of_sigma"] for j in of("after")]
        fused = [per_cent(j, "delay_compensated") for j in of("after")]
        made = of("made")
        held = [100 * m["held_out_rms_Nm"] / m["largest_Nm"] for m in made if "held_out_rms_Nm" in m]
        open_ = sorted({u for m in made for u in m.get("undetermined", [])})
        why = " ".join(sorted({m["why"] for m in made if "why" in m}))
        aim = AIM[group(name)] if robot == "humanoid" else 2.0
        met = (max(after) <= aim, 0.6 <= min(ratio) and max(ratio) <= 1.6)
        span = lambda xs, f: f"{min(xs):{f}} to {max(xs):{f}}" if len(xs) > 1 else f"{xs[0]:{f}}"
        torque = [j["largest_torque"] for j in of("after")]
        lines.append((met, (
            robot, name, span(torque, ".1f"), span(before, ".1f"), span(after, ".2f"), span(ratio, ".2f"),
            span(held, ".2f") if held else "not calibrated: " + why, span(fused, ".2f"), ", ".join(open_),
        )))  # fmt: skip
    return lines


def misses(lines):
    """The joints that miss an aim by most, as a table with its heading."""
    missed = [row for met, row in lines if not all(met)]
    worst = sorted(missed, key=lambda row: -float(row[COLUMNS.index("after, %")].split()[-1]))[:LISTED]
    table = [COLUMNS, ["---"] * len(COLUMNS), *worst]
    return [MISSED.format(len(worst), len(missed)), "", *(f"| {' | '.join(row)} |" for row in table)]


def as_csv(lines):
    """All joints."""
    text = io.StringIO()
    table = csv.writer(text, lineterminator="\n")
    table.writerow(COLUMNS)
    table.writerows(row for _, row in lines)
    return text.getvalue()


def page(results, command):
    out = [
        "# Calibration from recordings\n",
        f"Written by `{command}`; [what the commands do](../bring-up.md); [what limits the joints that miss an "
        "aim](../calibration.md#what-limits-it). `torquectl calibrate joints` reads recordings of the daemon's own loop "
        "alone, in the motions of `config/ROBOT/calibration`: no torque sensor, no truth, not the kinematic error of "
        "`robot.toml`. References come from F/T sensors, IMU and a model whose masses are 1 % off. Every disturbance of "
        "`sim.toml` is on, and every gear has a drawn past.\n",
        f"Judged on the demo's motion ({JUDGED_S} s; the humanoid on `config/humanoid/bow.toml`) against the true torque: RMS error of the torque from encoders and "
        "current in % of the joint's largest torque, and RMS of error over sigma. Each seed draws other torque constants, "
        "masses, offsets and noise; 1 was looked at while the method was made, 2 of the humanoid for sigma, 3 was not. "
        "Aims: 2 % for legs and trunk, 4 % for arms and head; sigma within 0.6 to 1.6.\n",
    ]
    summary = ["| robot, seeds | joints | within the aim of RMS | sigma within 0.6 to 1.6 | median before, % | median after, % "
               "| calibration took, s (of a busy machine) |", "| --- | --- | --- | --- | --- | --- | --- |"]
    lines = []
    for robot, of_robot in results.items():
        of_joints = rows(robot, of_robot)
        lines += of_joints
        median = lambda key: sorted(per_cent(j) for r in of_robot.values() for j in r[key]["joints"])
        middle = lambda xs: xs[len(xs) // 2]
        summary.append(
            f"| {robot}, {', '.join(map(str, sorted(of_robot)))} | {len(of_joints)} "
            f"| {sum(met[0] for met, _ in of_joints)} | {sum(met[1] for met, _ in of_joints)} "
            f"| {middle(median('before')):.2f} | {middle(median('after')):.2f} "
            f"| {max(r['took_s'] for r in of_robot.values()):.0f} |"
        )
    text = "\n".join(out + summary + [""] + misses(lines)) + "\n"
    return text, as_csv(lines)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--robot", action="append", metavar="NAME[:SEED,...]",
                        help=f"only this one, of these seeds; may be repeated [default: {' '.join(DEFAULT)}]")
    parser.add_argument("--binaries", type=Path, default=ROOT / "target/release", help="folder of torqued and torquectl")
    parser.add_argument("--out", type=Path, help="the page, with a table of all joints as CSV beside it; printed if left out")
    parser.add_argument("--keep", type=Path, help="folder in which every step's files are kept; those that are there are used")
    options = parser.parse_args()
    results = {}
    for named in options.robot or DEFAULT:
        robot, _, seeds = named.partition(":")
        if robot not in RECORDINGS:
            parser.error(f"there is no robot {robot!r}; allowed: {', '.join(RECORDINGS)}")
        results[robot] = {}
        for seed in map(int, (seeds or "1").split(",")):
            with tempfile.TemporaryDirectory() as place:
                folder = (options.keep or Path(place)).resolve() / f"{robot}-{seed}"
                folder.mkdir(parents=True, exist_ok=True)
                results[robot][seed] = calibrate(options.binaries.resolve(), robot, seed, folder)
            print(f"{robot}, seed {seed}: done", file=sys.stderr)
    text, every_joint = page(results, "python3 benches/calibration/run.py --out docs/results/calibration.md")
    if options.out:
        options.out.write_text(text)
        options.out.with_suffix(".csv").write_text(every_joint)
    else:
        print(text)


if __name__ == "__main__":
    main()
