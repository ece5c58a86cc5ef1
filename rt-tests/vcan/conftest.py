"""The leg's config, shared by the tests, which are clients themselves."""

import sys
from pathlib import Path

import pytest
from processes import CLIENT, LEG, derived_config

sys.path.insert(0, str(CLIENT))

# User-Mode Linux needs some 2 ms where a real kernel needs 0.1 ms, and QEMU's clock leaps while
# it reads files: limits so wide that no test depends on the clock. rt-tests/timing tests 1 kHz.
SLOW = {
    "rate_hz = 1000.0": "rate_hz = 200.0",
    "gather_deadline_us = 750.0": "gather_deadline_us = 4500.0",
    "stale_after_ms = 20.0": "stale_after_ms = 200.0",
    "reference_timeout_ms = 40.0": "reference_timeout_ms = 500.0",
    "[safety]": "[safety]\npublisher_timeout_ms = 10000.0",
}


@pytest.fixture(scope="session")
def leg_changes():
    """Changes of the leg's config for this kernel."""
    processor = Path("/proc/cpuinfo").read_text()
    virtual = any(name in processor for name in ("User Mode Linux", "QEMU TCG"))
    return SLOW if virtual else {}


@pytest.fixture(scope="session")
def leg(tmp_path_factory, leg_changes):
    """The leg's config, for this kernel."""
    return derived_config(tmp_path_factory.mktemp("leg"), leg_changes) if leg_changes else LEG
