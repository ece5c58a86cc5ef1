#!/usr/bin/env python3
"""Writes docs/equations.md: where the code implements which equation of which source.

usage: docs/make_equations.py [--check]

Reads the marks `//= TAG NUMBER: equation` above the lines that implement them, in the product
code of crates/. A mark may go on in further lines `//=     ...`. With --check nothing is
written; exit code 1 if docs/equations.md is not what would be written. A mark of another form
or with an unknown tag is an error (exit code 2): file, line, what is allowed.
"""

import re
import sys
import textwrap
from itertools import groupby
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
PAGE = ROOT / "docs" / "equations.md"
SOURCES = {
    "Z": "H. Zhang, S. Ahmad, G. Liu: Torque Estimation for Robotic Joint With Harmonic Drive "
    "Transmission Based on Position Measurements, IEEE T-RO 2015",
    "S": "Y. Song, H. Huang, F. Liu, F. Xi, D. Zhou, B. Li: Torque Estimation for Robotic Joint With "
    "Harmonic Reducer Based on Deformation Calibration",
    "G": "A Novel Virtual Torque Sensor for Rescue Robots with Harmonic Drives",
    "U": "Zhu: torque of a harmonic drive by an unscented Kalman filter",
    "D": "A. Del Prete, N. Mansard, O. E. Ramos, O. Stasse, F. Nori: Implementing Torque Control "
    "with High-Ratio Gear Boxes and without Joint-Torque Sensors, 2015",
    "F": "R. Featherstone: Rigid Body Dynamics Algorithms, Springer 2008",
    "L": "A. De Luca, R. Mattone: Sensorless robot collision detection and hybrid force/motion control, "
    "ICRA 2005",
    "T": "torqued's own: what a sigma covers, docs/joint-file.md",
    "H": "M. A. Krasnosel'skii, A. V. Pokrovskii: Systems with Hysteresis, Springer 1989",
}
MARK = re.compile(r"^\s*//= (?P<tag>[A-Z][A-Za-z]*?) ?(?P<number>[0-9][^:]*|[A-Z][a-z][^:]*)?: (?P<text>.+)$")
MORE = re.compile(r"^\s*//= {2,}(?P<text>\S.*)$")
ANY = re.compile(r"^\s*//=")


def marks(path):
    """(tag, number, equation, line) of each mark of a file."""
    found = []
    for line, text in enumerate(path.read_text().splitlines(), start=1):
        if not ANY.match(text):
            continue
        if (more := MORE.match(text)) and found:
            found[-1][2] += " " + more["text"].strip()
        elif (mark := MARK.match(text)) and mark["tag"] in SOURCES:
            found.append([mark["tag"], (mark["number"] or "").strip(), mark["text"].strip(), line])
        else:
            print(
                f"{path.relative_to(ROOT)}:{line}: {text.strip()}; allowed: //= TAG NUMBER: equation, "
                f"TAG one of {' '.join(SOURCES)}, or a further line //=     ...",
                file=sys.stderr,
            )
            sys.exit(2)
    return found


def natural(number):
    """Sorts 9 before 10."""
    return [(not part.isdigit(), int(part) if part.isdigit() else 0, part)
            for part in re.findall(r"\d+|\D+", number)]  # fmt: skip


def page():
    rows = {tag: [] for tag in SOURCES}
    files = sorted((ROOT / "crates").glob("*/src/**/*.rs"))
    for path in files:
        for tag, number, equation, line in marks(path):
            rows[tag].append((natural(number), number, equation, path.relative_to(ROOT).as_posix(), line))
    text = [
        "# Equations",
        "",
        "Which code implements which equation, by `docs/make_equations.py` from the marks in the code (`//= Z20: ...`). Where",
        "a line departs from print, the reason stands beside it.",
    ]
    for tag, source in SOURCES.items():
        if not rows[tag]:
            continue
        text += ["", f"## {tag}", "", source, ""]
        for (_, number), places in groupby(sorted(rows[tag]), key=lambda row: row[:2]):
            places = dict.fromkeys((file, line) for *_, file, line in places)
            links = ", ".join(f"[{file.removeprefix('crates/')}:{line}](../{file}#L{line})" for file, line in places)
            item = f"- {number}: {links}" if number else f"- {links}"
            text.append(textwrap.fill(item, 120, subsequent_indent="  ", break_long_words=False, break_on_hyphens=False))
    return "\n".join(text) + "\n"


def main():
    arguments = sys.argv[1:]
    if arguments not in ([], ["--check"]):
        print(__doc__)
        sys.exit(0 if arguments in (["-h"], ["--help"]) else 2)
    wanted = page()
    if not arguments:
        PAGE.write_text(wanted)
    elif not PAGE.exists() or PAGE.read_text() != wanted:
        print("docs/equations.md differs from the marks in the code: run docs/make_equations.py", file=sys.stderr)
        sys.exit(1)


main()
