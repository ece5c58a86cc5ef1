"""What is shipped: licences that allow it, and files that are whole."""

import subprocess
import sys
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
