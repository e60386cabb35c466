"""The generator of virtual frames, as a fixture: test files import nothing from each other."""

import importlib.util
from pathlib import Path

import pytest


@pytest.fixture(scope="session")
def virtual():
    """The module `virtual.py` beside this file."""
    spec = importlib.util.spec_from_file_location("virtual_frames", Path(__file__).with_name("virtual.py"))
    module = importlib.util.module_from_spec(spec)
    import sys

    sys.modules["virtual_frames"] = module  # dataclasses look their module up there
    spec.loader.exec_module(module)
    return module
