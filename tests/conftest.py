"""Ends each process of a run without Blender's shutdown, which crashes (4.2) or hangs (4.5) after a registration."""

import os
import sys

import pytest


@pytest.hookimpl(trylast=True)
def pytest_sessionfinish(session, exitstatus):
    session.config.exit_status = int(exitstatus)


@pytest.hookimpl(trylast=True)
def pytest_unconfigure(config):
    """All reports are out by now, also those that a worker of pytest-xdist sends to the process that collects them."""
    if "bpy" in sys.modules and hasattr(config, "exit_status"):
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(config.exit_status)
