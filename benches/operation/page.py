"""The page docs/results/operation.md of what measure.py has found."""

import textwrap

from measure import WARM_S, slope

HEAD = """# A daemon at work

`benches/operation/measure.py {asked}` has measured this and written this page, with the simulated leg at 1 kHz. The
programs were {build}; the machine: {machine}.

"""


def page(found):
    parts = {"soak": soak, "kills": kills, "wake": wake}
    texts = [parts[name](found[name]) for name in parts if name in found]
    blocks = (HEAD.format(**found) + "\n".join(texts)).strip().split("\n\n")
    return "\n\n".join(block if block[0] in "#|" else textwrap.fill(block, 120) for block in blocks) + "\n"


def table(head, rows):
    lines = [head, ["---"] + ["---:"] * (len(head) - 1), *rows]
    return "".join(f"| {' | '.join(str(cell) for cell in line)} |\n" for line in lines)


def soak(found):
    points, clients, times = found["memory"], found["clients"], found["times"]
    recording = found["recording"]
    at = [min(points, key=lambda point: abs(point[0] - t)) for t in (0, WARM_S, points[-1][0] / 2, points[-1][0])]
    rows = [[f"{t:.0f}", *(f"{kinds[kind]:.1f}" for kind in ("own", "shared", "files"))] for t, kinds in at]
    warm = [(t / 3600, kinds["own"]) for t, kinds in points if t > WARM_S]
    text = f"""## Soak: {found["seconds"] / 60:.0f} minutes under load

`stress-ng` loads CPU, memory and disk, the daemon records, and seven clients beside it come and go after up to ten seconds; half of
them are killed by SIGKILL.

Resident memory of the daemon, MB: its own, shared memory, and files mapped.

"""
    text += table(["after, s", "own", "shared", "files"], rows)
    growth = slope(warm)
    report, seen = found["report"], clients["records"] + clients["lost"]
    late = times["late_cycles"]
    causes = sorted(times["late_by_cause"].items(), key=lambda cause: -cause[1])
    attributed = sum(count for _, count in causes)
    text += f"""
From the first minute on its own memory grows by {growth:.2f} MB an hour (a line through {len(warm)} points).

{clients["clients"]} clients came, {clients["killed"]} of them were killed, {clients["failed"]} ended by an error. They
read {clients["records"]} records and lost {clients["lost"]} ({1e6 * clients["lost"] / max(seen, 1):.0f} of a million).
The recording of {recording["MB"]:.0f} MB holds {recording["cycles"]} cycles, {recording["lost"]} were lost.

Of {report["cycles"]} cycles {report["late_cycles"]} ended late: a simulated robot waits for a loop that misses a start.
The publisher came too late for {report["records_dropped"]} records. Two seconds before the end {late} cycles were late,
{attributed} of them laid to a cause:

"""
    text += table(["cause", "late cycles"], causes or [["none", 0]])
    return text + f"\nLeft in `/dev/shm` afterwards: {left(found['left'])}.\n"


def left(names):
    """Objects by what they are for. iceoryx2 keeps a counter for each run directory."""
    kept = [name for name in names if name.endswith(".global_mgmt")]
    others = sorted({name.rsplit(".", 1)[-1] for name in names if name not in kept})
    count = len(names) - len(kept)
    text = f"{count} objects ({', '.join(others)})" if count else "nothing"
    return text + (", but the run directory's counter of 16 bytes, which iceoryx2 keeps" if kept else "")


def kills(found):
    holds = sorted(1e3 * x for x in found["holds"])
    points = found["points"]
    step = max(1, len(points) // 4)
    rows = [[killed, f"{kinds['own']:.1f}", f"{kinds['shared']:.1f}", objects] for killed, kinds, objects in points]
    text = f"""## Kills: {found["clients"]} clients and {found["daemons"]} daemons by SIGKILL

Six clients that read and one that commands are killed at a time, while another one watches: a robot takes eight.

"""
    chosen = rows[::step] + ([rows[-1]] if (len(rows) - 1) % step else [])
    text += table(["clients killed", "daemon's own memory, MB", "shared, MB", "objects in /dev/shm"], chosen)
    middle = holds[len(holds) // 2]
    return text + f"""
Two seconds after the last one its own memory is {found["after"]["own"]:.1f} MB. The robot held {middle:.0f} ms after the
kill of its commander in the median of {len(holds)}, {holds[-1]:.0f} ms at most; both contain up to 5 ms of the watching
program. Left by the clients, once the daemon has ended: {left(found["left_by_clients"])}. After the daemons were killed, each
with two clients, and a last one had ended: {left(found["left"])}.
"""


def wake(found):
    text = """## Wake-up beside cyclictest

`cyclictest` (1 kHz, priority 81) and the loop (priority 80) on one core in the same minute, us after the timer's instant.
Those of the loop are of its whole run, some seconds longer.

"""
    rows = []
    for of in found:
        state = "under stress-ng" if of["stressed"] else "no load of ours"
        for name in ("cyclictest", "loop"):
            rows.append([f"{name}, {state}", *(f"{x:.0f}" for x in of[name])])
        ratios = (own / other if other else float("inf") for own, other in zip(of["loop"], of["cyclictest"], strict=True))
        rows.append([f"loop / cyclictest, {state}", *(f"{x:.2f}" for x in ratios)])
    return text + table(["", "p50", "p99", "max"], rows)
