"""Check the conventions of the code base: words, docstrings, names of classes, hooks.

    python -m scripts.conventions            # every breach, exit code 1 if there is one
    python -m scripts.conventions --counts   # files and lines a folder, settings, words, breaches

Forbidden words are listed in scripts/words.toml.
"""

import argparse
import ast
import re
import subprocess
import sys
import tokenize
import tomllib
from collections import Counter, defaultdict
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from itertools import chain
from pathlib import Path

from benchmarks.__main__ import GROUPS
from deploy.cli import COMMANDS
from deploy.settings import all_settings

ROOT = Path(__file__).resolve().parents[1]
WORDS = Path(__file__).with_name("words.toml")
BY_NAME = ("getattr", "hasattr", "setattr", "vars", "globals", "locals")
PACKAGES = ("people4d", "common", "services", "cameras", "lab", "evaluation", "deploy")
PYTHON = (*PACKAGES, "tests", "benchmarks", "scripts")
RUNTIME = ("common/runtime", "common/transport")
QUESTIONS = re.compile(r"(Who|Whose|Whether|What|Which|How|Where|When|Why)\b")
PARTS = re.compile(r"[A-Z]+(?=[A-Z][a-z])|[A-Z]?[a-z]+|[A-Z]+")


@dataclass(frozen=True)
class Breach:
    """A place in the code base that breaks a rule.

    Args:
        rule: Name of the rule.
        file: Path below the root of the repository.
        line: Line number, from 1.
        text: Description of the breach.
    """

    rule: str
    file: str
    line: int
    text: str

    def __str__(self) -> str:
        return f"{self.file}:{self.line}: {self.rule}: {self.text}"


def read_words() -> tuple[dict[str, str], dict[str, str]]:
    """Read the forbidden words.

    Returns:
        Words forbidden in names, and words forbidden everywhere, each with its replacement.
    """
    tables = tomllib.loads(WORDS.read_text("utf-8"))
    return tables["names"] | tables["everywhere"], tables["everywhere"]


def check_names(file: str, text: str, words: Mapping[str, str]) -> Iterator[Breach]:
    """Yield identifiers, defined in a Python file, that hold a forbidden word."""
    for node in ast.walk(ast.parse(text)):
        for name, line in _defined(node):
            for part in PARTS.findall(name):
                if part.lower() in words:
                    use = words[part.lower()]
                    yield Breach("word in a name", file, line, f"{name}: use {use}")


def check_prose(file: str, text: str, words: Mapping[str, str]) -> Iterator[Breach]:
    """Yield forbidden words in comments and strings of a Python file, or in all of a page."""
    pattern = re.compile(rf"\b({'|'.join(map(re.escape, words))})\b", re.IGNORECASE)
    lines = _comments(text) if file.endswith(".py") else enumerate(text.splitlines(), 1)
    for number, line in lines:
        for match in pattern.finditer(line):
            use = words[match[0].lower()]
            yield Breach("word", file, number, f"{match[0]}: use {use}")


def check_docstrings(file: str, text: str) -> Iterator[Breach]:
    """Yield docstrings that begin with a question word in place of their subject."""
    tree = ast.parse(text)
    kinds = (ast.Module, ast.ClassDef, ast.FunctionDef, ast.AsyncFunctionDef)
    for node in ast.walk(tree):
        if isinstance(node, kinds):
            docstring = ast.get_docstring(node) or ""
            if QUESTIONS.match(docstring):
                line = getattr(node, "lineno", 1)
                yield Breach("docstring", file, line, docstring.splitlines()[0])


def check_classes(files: Mapping[str, str]) -> Iterator[Breach]:
    """Yield public classes whose name another class has."""
    found: defaultdict[str, list[tuple[str, int]]] = defaultdict(list)
    for file, text in files.items():
        for node in ast.parse(text).body:
            if isinstance(node, ast.ClassDef) and not node.name.startswith("_"):
                found[node.name].append((file, node.lineno))
    for name, definitions in found.items():
        for file, line in definitions[1:]:
            yield Breach("class name twice", file, line, f"{name}, see {definitions[0][0]}")


def check_hooks(file: str, text: str) -> Iterator[Breach]:
    """Yield look-ups of attributes by name, which the type checker does not see."""
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.Name) and node.id in BY_NAME:
            yield Breach("attribute by name", file, node.lineno, node.id)


def breaches() -> Iterator[Breach]:
    """Yield every breach of the conventions."""
    names, everywhere = read_words()
    python = {file: (ROOT / file).read_text("utf-8") for file in _files(PYTHON, "*.py")}
    for file, text in python.items():
        yield from check_names(file, text, names)
        yield from check_prose(file, text, everywhere)
        yield from check_docstrings(file, text)
        if file.startswith(RUNTIME):
            yield from check_hooks(file, text)
    yield from check_classes({f: t for f, t in python.items() if f.startswith(PACKAGES)})
    pages = [file.name for file in ROOT.glob("*.md")]
    for file in (*sorted(pages), *_files(("docs",), "*.md")):
        yield from check_prose(file, (ROOT / file).read_text("utf-8"), everywhere)


def numeric_constants(text: str) -> int:
    """Count the upper-case names of a module whose value holds a number."""
    count = 0
    for node in ast.parse(text).body:
        if isinstance(node, ast.Assign | ast.AnnAssign) and node.value:
            values = [n.value for n in ast.walk(node.value) if isinstance(n, ast.Constant)]
            if any(type(value) in (int, float) for value in values):
                names = (name for part in ast.walk(node) for name, _ in _defined(part))
                count += sum(map(str.isupper, names))
    return count


def print_counts(found: list[Breach]) -> None:
    """Print files and lines of every folder, sizes of the product, and the breaches by rule."""
    lines = Counter[str]()
    files = Counter[str]()
    constants = 0
    for file in _files(PYTHON, "*.py"):
        text = (ROOT / file).read_text("utf-8")
        folder = (
            "/".join(Path(file).parts[:2]) if file.startswith("services") else file.split("/")[0]
        )
        lines[folder] += len(text.splitlines())
        files[folder] += 1
        constants += numeric_constants(text) if file.startswith(PACKAGES) else 0
    for folder in sorted(lines):
        print(f"{folder:<28} {files[folder]:>4} files {lines[folder]:>6} lines")
    product = sum(n for folder, n in lines.items() if folder.split("/")[0] in PACKAGES)
    print(f"{'product':<28} {'':>4}       {product:>6} lines")
    settings = {(s.record, s.name.rpartition(".")[2]) for s in chain(*all_settings().values())}
    pages = subprocess.check_output(["git", "ls-files", "*.md"], cwd=ROOT, text=True).split()
    sizes = {
        "settings": len(settings),
        "numeric constants of product": constants,
        "commands of people4d": len(COMMANDS),
        "benchmarks": sum(map(len, GROUPS.values())),
        "words of Markdown": sum(len((ROOT / page).read_text("utf-8").split()) for page in pages),
    }
    for name, size in sizes.items():
        print(f"{name:<28} {size:>6}")
    rules = Counter(breach.rule for breach in found)
    for rule in ("word in a name", "word", "docstring", "class name twice", "attribute by name"):
        print(f"{rule:<28} {rules[rule]:>4}")


def main() -> int:
    """Print breaches, or counts; return 1 if there is a breach."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--counts", action="store_true", help="files, lines, breaches by rule")
    counts = parser.parse_args().counts
    found = list(breaches())
    if counts:
        print_counts(found)
    else:
        print("\n".join(map(str, found)) or "Conventions hold.")
    return 1 if found else 0


def _defined(node: ast.AST) -> Iterator[tuple[str, int]]:
    """Yield names that a node of the syntax tree defines, each with its line."""
    if isinstance(node, ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef):
        yield node.name, node.lineno
    elif isinstance(node, ast.arg):
        yield node.arg, node.lineno
    elif isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store):
        yield node.id, node.lineno
    elif isinstance(node, ast.Attribute) and isinstance(node.ctx, ast.Store):
        yield node.attr, node.lineno


def _comments(text: str) -> Iterator[tuple[int, str]]:
    """Yield each line of the comments and strings of Python code, with its number."""
    source = iter(text.splitlines(keepends=True))
    for token in tokenize.generate_tokens(lambda: next(source, "")):
        if token.type in (tokenize.COMMENT, tokenize.STRING):
            yield from enumerate(token.string.splitlines(), token.start[0])


def _files(folders: tuple[str, ...], pattern: str) -> list[str]:
    found = (file for folder in folders for file in (ROOT / folder).rglob(pattern))
    return sorted(str(file.relative_to(ROOT)) for file in found)


if __name__ == "__main__":
    sys.exit(main())
