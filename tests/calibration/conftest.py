"""Fixtures of the calibration tests."""

import importlib.util
import sys
from pathlib import Path

import pytest

from photosite.engine.threads import threads_for


@pytest.fixture(autouse=True, scope="module")
def one_thread():
    """Run the kernels in one thread: for small frames, threads cost more processor time than they save."""
    with threads_for(1):
        yield


@pytest.fixture(scope="session")
def virtual():
    """The module `virtual.py` beside this file; test files do not import each other."""
    spec = importlib.util.spec_from_file_location("virtual_frames", Path(__file__).with_name("virtual.py"))
    module = importlib.util.module_from_spec(spec)
    sys.modules["virtual_frames"] = module  # dataclasses look up their module there
    spec.loader.exec_module(module)
    return module
