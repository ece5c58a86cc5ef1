"""What is shipped: licences that allow it, and files that are whole."""

import collections
import json
import re
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
sys.path.insert(0, str(ROOT / "packaging"))

import licences  # noqa: E402


@pytest.mark.parametrize(
    ("expression", "allowed"),
    [
        ("MIT OR Apache-2.0", True),
        ("MIT/Apache-2.0", True),
        ("(MIT OR Apache-2.0) AND Unicode-3.0", True),
        ("Apache-2.0 WITH LLVM-exception OR Apache-2.0 OR MIT", True),
        ("GPL-3.0-only", False),
        ("GPL-3.0-only OR MIT", True),
        ("MIT AND GPL-3.0-only", False),
        ("(MIT OR GPL-2.0-only) AND AGPL-3.0-only", False),
        ("", False),
    ],
)
def test_licences_are_judged_by_their_expression(expression, allowed):
    assert licences.is_allowed(expression) == allowed


@pytest.mark.parametrize("programs", ["torqued torquectl", "torqued-c"])
def test_every_crate_that_is_shipped_may_be_and_has_its_text(programs):
    command = [sys.executable, ROOT / "packaging" / "licences.py", programs]
    text = subprocess.run(command, cwd=ROOT, check=True, capture_output=True, text=True).stdout
    assert "  iceoryx2 0.10" in text and "Permission is hereby granted" in text and "Apache License" in text


def locked():
    """Every package of the workspace's lock, those of other systems and of tests among them."""
    command = ["cargo", "metadata", "--locked", "--offline", "--format-version", "1"]
    text = subprocess.run(command, cwd=ROOT, check=True, capture_output=True, text=True).stdout
    return json.loads(text)["packages"]


def test_all_dependencies_are_as_deny_toml_allows():
    """As `cargo deny --offline check licenses bans sources`, without its installation."""
    deny = tomllib.loads((ROOT / "deny.toml").read_text())
    packages = locked()
    theirs = [package for package in packages if package["source"]]
    allowed = {f"registry+{url}" for url in deny["sources"]["allow-registry"]}
    assert {package["source"] for package in theirs} <= allowed
    refused = [package["id"] for package in packages if not licences.is_allowed(package["license"] or "")]
    assert not refused
    versions = collections.defaultdict(set)
    for package in packages:
        versions[package["name"]].add(package["version"])

    def numbers(version):
        return [int(number) for number in re.findall(r"\d+", version.split("+")[0])]

    # All but the newest; one that is no longer there is no exception any more.
    older = {f"{name}@{one}" for name, of in versions.items() for one in sorted(of, key=numbers)[:-1]}
    assert older == {skipped["crate"] for skipped in deny["bans"]["skip"]}


def test_no_dependency_takes_any_version():
    tracked = ["git", "ls-files", "*Cargo.toml"]
    manifests = subprocess.run(tracked, cwd=ROOT, check=True, capture_output=True, text=True).stdout.split()
    assert len(manifests) > 30
    for manifest in manifests:
        text = (ROOT / manifest).read_text()
        assert not re.search(r'=\s*"\*"|version\s*=\s*"\*"', text), manifest
