"""Ask for known security advisories of the installed packages: `python tests/audit.py`, or make audit.

The exit status is 0 without advisories, 1 with some, and 2 if no package could be looked up, with the reason: a check
that cannot run has not passed.
"""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Sequence
from typing import Any

COMMAND = (
    sys.executable,
    "-m",
    "pip_audit",
    "--local",
    "--skip-editable",
    "--format",
    "json",
    "--progress-spinner=off",
)


def verdict(packages: Sequence[dict[str, Any]]) -> tuple[int, list[str]]:
    """Return the exit status and the lines to print, from pip-audit's list of packages.

    >>> verdict([{"name": "a", "version": "1", "vulns": [{"id": "CVE-1", "fix_versions": ["2"]}]}])
    (1, ['a 1: CVE-1, fixed in 2', '1 packages looked up, 1 with advisories'])
    >>> verdict([{"name": "a", "skip_reason": "not found"}])
    (2, ['no package could be looked up: not found'])
    """
    asked = [package for package in packages if "skip_reason" not in package]
    if not asked:
        reason = packages[0]["skip_reason"] if packages else "there are none"
        return 2, [f"no package could be looked up: {reason}"]
    lines = [
        f"{package['name']} {package['version']}: {found['id']}, fixed in {', '.join(found['fix_versions']) or 'none'}"
        for package in asked
        for found in package["vulns"]
    ]
    affected = sum(bool(package["vulns"]) for package in asked)
    skipped = f", {len(packages) - len(asked)} not found" if len(asked) < len(packages) else ""
    return int(affected > 0), [*lines, f"{len(asked)} packages looked up, {affected} with advisories{skipped}"]


def main() -> int:
    """Run the command."""
    done = subprocess.run(COMMAND, capture_output=True, text=True, check=False)
    try:
        packages = json.loads(done.stdout)["dependencies"]
    except (ValueError, KeyError):
        lines = done.stderr.strip().splitlines()
        print(f"no package could be looked up: {lines[-1] if lines else 'pip-audit printed nothing'}")
        return 2
    status, lines = verdict(packages)
    print("\n".join(lines))
    return status


if __name__ == "__main__":
    sys.exit(main())
