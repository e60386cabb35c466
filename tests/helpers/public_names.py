"""The public names of photosite, as the stubs list them."""

from __future__ import annotations

import inspect
import operator

import photosite


def public_names() -> set[str]:
    """Return the names, those of a group as `group.name`."""
    members = {name: getattr(photosite, name) for name in photosite.__all__}
    groups = {name: group for name, group in members.items() if inspect.ismodule(group)}
    inside = {f"{name}.{inner}" for name, group in groups.items() for inner in group.__all__}
    return members.keys() - groups | inside


def public_doctests() -> set[str]:
    """Return the names that pytest gives to the examples of the public names."""
    objects = (operator.attrgetter(name)(photosite) for name in public_names())
    return {f"{each.__module__}.{each.__qualname__}" for each in objects if hasattr(each, "__qualname__")}
