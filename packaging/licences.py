"""The copyright file of a package: our licence, and each crate that its programs contain, with its licence's text."""

import hashlib
import json
import subprocess
import sys
import tomllib
from pathlib import Path

ROOT = Path(__file__).parents[1]
# Licences that let a program be passed on under MIT or Apache-2.0, with their texts.
ALLOWED = set(tomllib.loads((ROOT / "deny.toml").read_text())["licenses"]["allow"])


def metadata():
    """What cargo knows of the workspace, on this machine's kind of processor and system."""
    host = subprocess.run(["rustc", "-vV"], check=True, capture_output=True, text=True).stdout
    triple = next(line.split()[1] for line in host.splitlines() if line.startswith("host:"))
    command = ["cargo", "metadata", "--locked", "--format-version", "1", "--filter-platform", triple]
    return json.loads(subprocess.run(command, check=True, capture_output=True, text=True).stdout)


def contained(data, programs):
    """Packages that are linked into these programs, ours among them."""
    packages = {package["id"]: package for package in data["packages"]}
    nodes = {node["id"]: node for node in data["resolve"]["nodes"]}
    to_visit = [id for id, package in packages.items() if package["name"] in programs]
    found = set(to_visit)
    while to_visit:
        for dependency in nodes[to_visit.pop()]["deps"]:
            linked = any(kind["kind"] is None for kind in dependency["dep_kinds"])
            if linked and dependency["pkg"] not in found:
                found.add(dependency["pkg"])
                to_visit.append(dependency["pkg"])
    return sorted((packages[id] for id in found), key=lambda package: package["name"])


def is_allowed(expression):
    """An SPDX expression that allowed licences satisfy: all of a conjunction, one of a disjunction."""
    expression = expression.replace("/", " OR ").strip()
    while expression.startswith("(") and expression.endswith(")") and ")" not in expression[1:-1]:
        expression = expression[1:-1]
    for operator, join in ((" AND ", all), (" OR ", any)):
        parts = split(expression, operator)
        if len(parts) > 1:
            return join(is_allowed(part) for part in parts)
    return expression.strip("() ") in ALLOWED


def split(expression, operator):
    """The parts between operators outside of parentheses."""
    parts, depth, start = [], 0, 0
    for place, letter in enumerate(expression):
        depth += (letter == "(") - (letter == ")")
        if depth == 0 and expression.startswith(operator, place):
            parts.append(expression[start:place])
            start = place + len(operator)
    return [*parts, expression[start:]]


def licence_files(package):
    """Paths of a package's licence texts."""
    folder = Path(package["manifest_path"]).parent
    names = ("LICEN", "COPYING", "COPYRIGHT", "NOTICE", "UNLICENSE")
    return sorted(path for path in folder.iterdir() if path.is_file() and path.name.upper().startswith(names))


def main():
    programs = sys.argv[1].split()
    if not programs:
        sys.exit("usage: licences.py 'PACKAGE...'")
    packages = [package for package in contained(metadata(), programs) if package["source"]]
    strangers = [package["id"] for package in packages if not package["source"].startswith("registry+")]
    if strangers:
        sys.exit("crates that are of no registry, and so can change unseen:\n" + "\n".join(strangers))
    refused = [package for package in packages if not is_allowed(package["license"] or "")]
    if refused:
        lines = [f"{package['name']} {package['version']}: {package['license']}" for package in refused]
        sys.exit("licences that are not allowed (deny.toml):\n" + "\n".join(lines))
    print(f"{' and '.join(programs)}: MIT OR Apache-2.0, at your option (LICENSE-MIT, LICENSE-APACHE).\n")
    print("They contain these crates, each with the texts of its licence below:\n")
    texts = {}
    for package in packages:
        print(f"  {package['name']} {package['version']}: {package['license']}")
        for path in licence_files(package):
            text = path.read_text(encoding="utf-8", errors="replace").strip()
            key = hashlib.sha256(text.encode()).digest()
            texts.setdefault(key, (text, []))[1].append(f"{package['name']} {package['version']}")
    for text, owners in texts.values():
        print(f"\n{'-' * 100}\n{', '.join(owners)}:\n\n{text}")


if __name__ == "__main__":
    main()
