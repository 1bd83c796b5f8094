"""Write the bill of materials (CycloneDX) of shipped packages and model weights: `make sbom`.

Packages and their hashes come from requirements.lock, weights from models.toml. A wrong checksum is
an error. The same sources give the same bytes.
"""

import argparse
import json
import subprocess
import sys
from pathlib import Path
from typing import Any

from common.io.weights import MANIFEST, load_manifest, verify

ROOT = Path(__file__).resolve().parents[1]
LOCK = ROOT / "requirements.lock"


def models(manifest: Path) -> list[dict[str, Any]]:
    """Return the components of the weights of a manifest; ModelError if one is altered."""
    components = []
    for model in load_manifest(manifest).values():
        path = manifest.parent / model.file
        if not path.is_file():
            continue
        verify(path, model.sha256)
        components.append(
            {
                "bom-ref": f"model:{model.name}",
                "type": "machine-learning-model",
                "name": model.name,
                "description": model.kind,
                "licenses": [{"license": {"name": model.licence}}],
                "hashes": [{"alg": "SHA-256", "content": model.sha256}],
            }
        )
    return components


def packages() -> dict[str, Any]:
    """Return the bill of materials of the packages."""
    command = [sys.executable, "-m", "cyclonedx_py", "requirements", str(LOCK)]
    command += ["--pyproject", str(ROOT / "pyproject.toml"), "--mc-type", "application"]
    command += ["--output-reproducible", "--of", "JSON", "-o", "-"]
    made = subprocess.run(command, check=True, capture_output=True, text=True)
    bill: dict[str, Any] = json.loads(made.stdout)
    return bill


def main() -> None:
    """Write the file."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("file", type=Path)
    file = parser.parse_args().file
    bill = packages()
    bill["components"] += models(MANIFEST)
    file.parent.mkdir(parents=True, exist_ok=True)
    file.write_text(json.dumps(bill, indent=2) + "\n", encoding="utf-8")
    print(f"{file}: {len(bill['components'])} components")


if __name__ == "__main__":
    main()
