"""The door to colour-science: imported when first used, and kept from changing how NumPy prints."""

from __future__ import annotations

from typing import Any

import numpy as np


def colour_science() -> Any:
    """The `colour` package.

    Its import switches NumPy's printing to a legacy mode for the whole process and takes about a second;
    here the first is undone and the second happens only when a CIE table is needed.

    Examples
    --------
    >>> float(colour_science().SDS_ILLUMINANTS["A"].shape.interval)
    5.0
    """
    options = np.get_printoptions()
    try:
        import colour
    finally:
        np.set_printoptions(**options)
    return colour
