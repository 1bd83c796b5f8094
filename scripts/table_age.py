"""Names benchmark tables that are older than the code that they measure.

Run `python -m scripts.table_age`; `make check` does. A table names the commit of its run. It is
older if code in its paths has changed since, except comments and docstrings.
"""

import ast
import re
import subprocess
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
COMMIT = re.compile(r"^Made by .*commit ([0-9a-f]{7,40})(-dirty)?,", re.MULTILINE)
COMMON = ("people4d", "common/geometry", "common/inference", "common/runtime", "common/transport")
TRACKING = (*COMMON, "services/detector", "services/reid", "services/tracker")
PATHS = {  # paths that a table depends on in addition to its benchmark, by name of the table
    "odometry": (*COMMON, "services/visual_odometry"),
    "prediction": (*COMMON, "services/predictor", "services/tracker"),
    "trackers": (*COMMON, "services/tracker", "services/presets"),
    "gait": (*COMMON, "services/gait", "evaluation/gait"),
    "gait_bodies": (*COMMON, "services/gait", "evaluation/gait"),
    "gait_real": (*TRACKING, "services/gait", "evaluation/gait"),
    "fuzz": (*COMMON, "common/io", "services/camera"),
}


def main() -> None:
    """Print the tables and what changed."""
    for table in sorted((ROOT / "benchmarks").glob("*.md")):
        if table.stem != "README":
            reason = age(table)
            if reason:
                print(f"older than its code: benchmarks/{table.name} ({reason})")


def age(table: Path) -> str:
    """Return the reason why a table is older than its code, empty if it is not."""
    match = COMMIT.search(table.read_text("utf-8"))
    if match is None:
        return "names no commit"
    commit, is_dirty = match.groups()
    if git("cat-file", "-e", commit) is None:
        return f"commit {commit} is not known here"
    changed = sorted(changed_files(commit, paths(table.stem)))
    if not changed:
        return "made with uncommitted changes" if is_dirty else ""
    return f"{len(changed)} files since {commit}: {', '.join(changed[:3])}"


def paths(name: str) -> tuple[str, ...]:
    """Return the paths that a table depends on."""
    return (*PATHS.get(name, TRACKING), f"benchmarks/{name}.py")


def changed_files(commit: str, paths: tuple[str, ...]) -> Iterator[str]:
    """Yield files of Python whose code differs between a commit and the working tree."""
    listing = git("diff", "--name-only", commit, "--", *paths) or ""
    for file in listing.split():
        if file.endswith(".py"):
            now = ROOT / file
            before = git("show", f"{commit}:{file}")
            if not now.exists() or code(before or "") != code(now.read_text("utf-8")):
                yield file


def code(text: str) -> str:
    """Return the syntax tree of a file without its docstrings, as text."""
    tree = ast.parse(text)
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
