"""Extension modules of SciPy without the packages that hold them, which import much else."""

from __future__ import annotations

import sys
from functools import lru_cache
from importlib import import_module
from importlib.machinery import PathFinder
from importlib.util import module_from_spec
from pathlib import Path
from types import ModuleType


@lru_cache
def extension_module(name: str) -> ModuleType:
    """Import and return an extension module; its package is imported only where the module is not in its folder.

    Examples
    --------
    >>> extension_module("scipy.optimize._zeros").__name__
    'scipy.optimize._zeros'
    """
    import scipy

    folder = Path(scipy.__path__[0], *name.split(".")[1:-1])
    if name not in sys.modules and (spec := PathFinder.find_spec(name, [str(folder)])) is not None:
        module = module_from_spec(spec)
        assert spec.loader is not None
        spec.loader.exec_module(module)
        sys.modules[name] = module
    return import_module(name)
