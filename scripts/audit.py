"""Compare all pinned packages with the known vulnerabilities, by pip-audit: `make audit`.

Advisories come from PyPI, or from $ADVISORIES, the address of a copy of OSV's interface, for
machines without internet. Exit codes: 0 if every package was compared and none is vulnerable, 1 if
one is, 2 ("not run") if packages could not be compared.
"""

import json
import os
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[1]
TIMEOUT_S = 15  # [s] timeout of one request
LONGEST_S = 600


def audit(lock: Path) -> dict[str, Any] | None:
    """Return pip-audit's report on a lock file; None if it failed."""
    command = [sys.executable, "-m", "pip_audit", "--require-hashes", "--disable-pip"]
    command += ["-r", str(lock), "--format", "json", "--timeout", str(TIMEOUT_S)]
    if copy := os.environ.get("ADVISORIES"):
        command += ["--vulnerability-service", "osv", "--osv-url", copy]
    try:
        done = subprocess.run(
            command, capture_output=True, check=False, text=True, timeout=LONGEST_S
        )
        report: dict[str, Any] = json.loads(done.stdout)
    except (subprocess.TimeoutExpired, ValueError):
        return None
    return report


def summary(lock: str, report: dict[str, Any] | None) -> tuple[int, str]:
    """Return exit status and text of a report; skipped packages are not audited."""
    if report is None:
        return 2, f"{lock}: not run, no advisories can be reached (see ADVISORIES)"
    found = report["dependencies"]
    skipped = [package["name"] for package in found if "skip_reason" in package]
    bad = [
        f"{package['name']} {package['version']}: {', '.join(v['id'] for v in package['vulns'])}"
        for package in found
        if package.get("vulns")
    ]
    lines = [f"{lock}: {len(found) - len(skipped)} of {len(found)} packages compared", *bad]
    if skipped or not found:
        lines.append(f"not run for {len(skipped)} packages without advisories")
    status = 1 if bad else 2 if skipped or not found else 0
    return status, "\n  ".join(lines)


def main(locks: Sequence[Path]) -> int:
    """Audit lock files; return the exit status."""
    statuses = []
    for lock in locks:
        status, text = summary(lock.name, audit(lock))
        statuses.append(status)
        print(text, flush=True)
    return 1 if 1 in statuses else max(statuses)


if __name__ == "__main__":
    sys.exit(main(sorted(ROOT.glob("requirements*.lock"))))
