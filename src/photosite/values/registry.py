"""Registries that fill themselves: every file of a folder registers what it defines under one name."""

from __future__ import annotations

import pkgutil
from importlib import import_module
from typing import Any


def registered(package: str, name: str) -> dict[str, Any]:
    """Return what each module of a package defines under a name, by the name of the module.

    Modules without it are left out.

    Examples
    --------
    >>> sorted(registered("photosite.color", "CIE_1931"))  # no module there defines it
    []
    """
    folder = import_module(package)
    modules = {entry.name: import_module(f"{package}.{entry.name}") for entry in pkgutil.iter_modules(folder.__path__)}
    return {key: getattr(module, name) for key, module in modules.items() if hasattr(module, name)}
