"""Tests of UDP buses need a network of their own, which rt-tests/udp/run.sh makes."""

import os
import sys

import pytest
import results
from processes import CLIENT, ROOT

sys.path.insert(0, str(CLIENT))


def pytest_sessionfinish():
    if page := os.environ.get("TORQUED_RESULTS"):
        results.write(ROOT / page)


def pytest_collection_modifyitems(items):
    network = os.environ.get("TORQUED_OWN_NETWORK", "no: run rt-tests/udp/run.sh")
    if network != "yes":
        for item in items:
            item.add_marker(pytest.mark.skip(reason=f"network of its own: {network}"))
