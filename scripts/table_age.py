"""Names benchmark tables that are older than the code that they measure.

Run `python -m scripts.table_age`; `make check` does. A table names its command and the commit of
its run. It is older if code that the command imports or starts differs since, comments and
docstrings left out, or data of that code.
"""

import ast
import re
import subprocess
import tomllib
from collections.abc import Collection, Iterator
from functools import cache
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
MADE = re.compile(
    r"^Made by `python -m (?P<module>[\w.]+)(?P<name> \w+)?.*?` on "
    r"(?:.*, commit (?P<commit>[0-9a-f]{7,40})(?P<dirty>-dirty)?,)?",
    re.MULTILINE,
)
STARTS = "STARTS"  # Constant of a module: names of modules that it starts or looks up
# Data that a module reads
DATA = {
    "common/io/weights.py": "models",
    "services/presets/__init__.py": "services/presets/*.toml",
    "benchmarks/lib/system/live_camera.py": "deploy/demo/crossing.mcap",
    "evaluation/annotations/marks.py": "benchmarks/real_people_marks",
    "deploy/compose.py": "deploy/compose.yaml",
}
LAYOUT = {"benchmarks/lib/table.py": ("write",)}  # functions that change no figure
DATA_TYPES = (".toml", ".onnx", ".mcap", ".json", ".yaml")


def main() -> None:
    """Print the tables and what changed."""
    for table in tables():
        reason = age(table)
        if reason:
            print(f"older than its code: benchmarks/{table.name} ({reason})")


def tables() -> list[Path]:
    """Return the files of all tables."""
    files = sorted((ROOT / "benchmarks").glob("*.md"))
    return [file for file in files if file.stem != "README"]


def age(table: Path) -> str:
    """Return the reason why a table is older than its code, empty if it is not."""
    made = MADE.search(table.read_text("utf-8"))
    commit = made and made["commit"]
    if not made or not commit:
        return "names no commit"
    if git("cat-file", "-e", commit) is None:
        return f"commit {commit} is not known here"
    module, name = made["module"], (made["name"] or "").strip()
    start = f"{module}.{name}" if module == "benchmarks" else f"{module}.__main__"
    changed = sorted(changed_files(commit, paths(start)))
    if not changed:
        return "made with uncommitted changes" if made["dirty"] else ""
    return f"{len(changed)} files since {commit}: {', '.join(changed[:3])}"


def paths(start: str) -> list[str]:
    """Return the files of a module, of all that it imports or starts, and of their data."""
    found, waiting = set[str](), [start]
    while waiting:
        file = file_of(waiting.pop())
        if file and str(file.relative_to(ROOT)) not in found:
            found.add(str(file.relative_to(ROOT)))
            waiting += (name for name in needed(file) if not name.startswith("scripts"))
    return [*sorted(found), *(path for file, path in DATA.items() if file in found)]


def file_of(module: str) -> Path | None:
    """Return the file of a module or package of the repository."""
    path = ROOT.joinpath(*module.split("."))
    return next((p for p in (path.with_suffix(".py"), path / "__init__.py") if p.is_file()), None)


@cache
def needed(file: Path) -> list[str]:
    """Return the names that a file imports, wherever it does, and the processes that it starts."""
    found = list[str]()
    for node in ast.walk(ast.parse(file.read_text("utf-8"))):
        if isinstance(node, ast.Import):
            found += (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module:
            found += (node.module, *(f"{node.module}.{alias.name}" for alias in node.names))
        elif isinstance(node, ast.Assign) and ast.unparse(node.targets[0]) == STARTS:
            found += ast.literal_eval(node.value)
    return found


def changed_files(commit: str, paths: list[str]) -> Iterator[str]:
    """Yield files whose behaviour differs between a commit and the working tree."""
    listing = git("diff", "--name-only", commit, "--", *paths) or ""
    for file in listing.split():
        now = ROOT / file
        if file.endswith(".py"):
            before = git("show", f"{commit}:{file}")
            layout = LAYOUT.get(file, ())
            if not now.exists() or code(before or "", layout) != code(
                now.read_text("utf-8"), layout
            ):
                yield file
        elif file.endswith(".toml") and now.exists():
            before = git("show", f"{commit}:{file}")
            if tomllib.loads(before or "") != tomllib.loads(now.read_text("utf-8")):
                yield file
        elif file.endswith(DATA_TYPES):
            yield file


def code(text: str, layout: Collection[str]) -> str:
    """Return the syntax tree of a file without docstrings and functions of layout, as text."""
    tree = ast.parse(text)
    tree.body = [node for node in tree.body if getattr(node, "name", "") not in layout]
    for node in ast.walk(tree):
        if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef) and ast.get_docstring(
            node
        ):
            node.body = node.body[1:]
    return ast.dump(tree)


def git(*arguments: str) -> str | None:
    """Return the output of a command of git, None if it fails."""
    done = subprocess.run(
        ["git", "-C", str(ROOT), *arguments], capture_output=True, text=True, check=False
    )
    return done.stdout if done.returncode == 0 else None


if __name__ == "__main__":
    main()
