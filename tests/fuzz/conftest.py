"""The fuzzing's modules stand beside its tests, and are found there as run.py finds them."""

from __future__ import annotations

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))
