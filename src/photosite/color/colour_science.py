"""Import of the colour-science package: deferred to first use, and without its side effect on NumPy's printing."""

from __future__ import annotations

from typing import Any

import numpy as np


def colour_science() -> Any:
    """Return the `colour` package.

    Importing it takes about a second, so that happens when a CIE table is first needed. The import switches NumPy to
    legacy printing; this function restores the print options.

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
