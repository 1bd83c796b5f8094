"""Hashes of shipped files, and the report on known vulnerabilities."""

import hashlib
import re
import shutil
from pathlib import Path
from typing import Any

import pytest

from common.io.weights import MANIFEST
from people4d.errors import ModelError
from scripts.audit import summary
from scripts.sbom import models
from tests import ROOT

LOCKS = sorted(ROOT.glob("requirements*.lock"))
GOOD = {"name": "numpy", "version": "2.0", "vulns": []}
BAD = {"name": "old", "version": "1.0", "vulns": [{"id": "PYSEC-1"}, {"id": "GHSA-2"}]}
SKIPPED = {"name": "other", "skip_reason": "not found"}


@pytest.mark.parametrize("lock", LOCKS, ids=lambda lock: lock.name)
def test_every_pinned_package_has_hashes(lock: Path) -> None:
    entries = re.split(r"\n(?=\S)", lock.read_text("utf-8").strip())
    assert len(entries) > 10
    for entry in entries:
        assert re.match(r"[\w.-]+(\[[\w,-]+\])?==\S+", entry), entry
        assert re.search(r"--hash=sha256:[0-9a-f]{64}", entry), entry


def test_bill_of_materials_holds_all_weights_with_their_hashes() -> None:
    found = {c["name"]: c["hashes"][0]["content"] for c in models(MANIFEST)}
    files = sorted(MANIFEST.parent.glob("*.onnx"))
    assert sorted(found.values()) == sorted(
        hashlib.sha256(file.read_bytes()).hexdigest() for file in files
    )


def test_bill_of_materials_is_not_made_of_altered_weights(tmp_path: Path) -> None:
    manifest = Path(shutil.copy(MANIFEST, tmp_path))
    (tmp_path / "movenet-multipose.onnx").write_bytes(b"altered")
    with pytest.raises(ModelError, match="expected sha256"):
        models(manifest)


@pytest.mark.parametrize(
    ("report", "status", "text"),
    [
        ({"dependencies": [GOOD]}, 0, "1 of 1 packages compared"),
        ({"dependencies": [GOOD, BAD]}, 1, "old 1.0: PYSEC-1, GHSA-2"),
        ({"dependencies": [GOOD, SKIPPED]}, 2, "not run for 1"),
        ({"dependencies": []}, 2, "not run"),
        ({"dependencies": [BAD, SKIPPED]}, 1, "not run for 1"),
        (None, 2, "not run"),
    ],
)
def test_audit_passes_only_if_every_package_was_compared(
    report: dict[str, Any] | None, status: int, text: str
) -> None:
    got, written = summary("a.lock", report)
    assert got == status
    assert text in written
