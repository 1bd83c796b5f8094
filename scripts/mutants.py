"""Share of mutants that the quick tests kill: one changed operator in one function at a time.

A mutant changes a comparison, a sign, or `and` and `or`. Mutants are drawn by a seed from AREAS.
Each one runs, in a forked process, the quick tests of its area that call its function:
`python -m scripts.mutants --count 150 --seed 56` prints the share killed and the survivors.
"""

import argparse
import ast
import gc
import os
import random
import sys
from collections import defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import CodeType, FrameType, FunctionType

import pytest
from _pytest.runner import runtestprotocol

AREAS = {  # folder of the product: folder of its tests
    "services/tracker": "tests/tracker",
    "services/detector": "tests/detector",
    "services/predictor": "tests/predictor",
    "common/runtime": "tests/common",
    "people4d": "tests/people4d",
}
QUICK = "not processes and not network and not render and not slow"
TIMEOUT_S = 20  # maximum time of one test [s]
COMPARISONS: dict[type[ast.cmpop], type[ast.cmpop]] = {
    ast.Lt: ast.LtE,
    ast.LtE: ast.Lt,
    ast.Gt: ast.GtE,
    ast.GtE: ast.Gt,
    ast.Eq: ast.NotEq,
    ast.NotEq: ast.Eq,
}
SIGNS: dict[type[ast.operator], type[ast.operator]] = {ast.Add: ast.Sub, ast.Sub: ast.Add}
KILLED, SURVIVED = 1, 0  # exit status of the process of a mutant
Function = tuple[str, str]  # absolute path of the file, qualified name


@dataclass(frozen=True)
class Mutant:
    """One changed operator."""

    path: str
    name: str  # qualified name of the function
    line: int
    index: int  # index of the operator in its file

    @property
    def function(self) -> Function:
        """File and qualified name of the function."""
        return str(Path(self.path).absolute()), self.name

    def code(self) -> CodeType:
        """Return the code of the changed function."""
        tree = ast.parse(Path(self.path).read_text())
        change(list(operators(tree))[self.index][0])
        codes = [compile(tree, self.function[0], "exec")]
        while codes:
            code = codes.pop()
            if code.co_qualname == self.name and code.co_firstlineno <= self.line:
                return code
            codes += [inner for inner in code.co_consts if isinstance(inner, CodeType)]
        raise LookupError(f"no code of {self.name} in {self.path}")


def operators(
    tree: ast.AST, name: str = "", *, inside: bool = False
) -> Iterator[tuple[ast.expr, str]]:
    """Yield each operator of a function that can change, with the function's qualified name."""
    for child in ast.iter_child_nodes(tree):
        if isinstance(child, ast.FunctionDef):
            own = ast.Module(body=child.body, type_ignores=[])  # without defaults and annotations
            prefix = f"{name}.<locals>." if inside else f"{name}." if name else ""
            yield from operators(own, prefix + child.name, inside=True)
        elif isinstance(child, ast.ClassDef):
            yield from operators(child, f"{name}.{child.name}" if name else child.name)
        elif not isinstance(
            child, ast.Lambda | ast.comprehension | ast.ListComp | ast.GeneratorExp
        ):
            if inside and isinstance(child, ast.expr) and can_change(child):
                yield child, name
            yield from operators(child, name, inside=inside)


def can_change(node: ast.expr) -> bool:
    """True if a mutant of an expression exists."""
    match node:
        case ast.Compare():
            return type(node.ops[0]) in COMPARISONS
        case ast.BinOp():
            return type(node.op) in SIGNS
        case ast.UnaryOp():
            return isinstance(node.op, ast.USub) and not isinstance(node.operand, ast.Constant)
        case _:
            return isinstance(node, ast.BoolOp)


def change(node: ast.expr) -> None:
    """Change the operator of an expression."""
    match node:
        case ast.Compare():
            node.ops[0] = COMPARISONS[type(node.ops[0])]()
        case ast.BinOp():
            node.op = SIGNS[type(node.op)]()
        case ast.UnaryOp():
            node.op = ast.UAdd()
        case ast.BoolOp():
            node.op = ast.Or() if isinstance(node.op, ast.And) else ast.And()


def draw(count: int, seed: int) -> dict[str, list[Mutant]]:
    """Draw `count` random mutants; return them by area."""
    found = [
        (area, Mutant(str(path), name, node.lineno, k))
        for area in AREAS
        for path in sorted(Path(area).rglob("*.py"))
        for k, (node, name) in enumerate(operators(ast.parse(path.read_text())))
    ]
    drawn: dict[str, list[Mutant]] = defaultdict(list)
    for area, mutant in random.Random(seed).sample(found, count):
        drawn[area].append(mutant)
    return drawn


class Mutation:
    """Plugin of pytest that runs the tests of each mutant in place of all tests once."""

    def __init__(self, area: str, mutants: Sequence[Mutant]) -> None:
        self._area, self._mutants = area, mutants

    def pytest_runtestloop(self, session: pytest.Session) -> bool:
        """Print the mutants that survive."""
        callers, killed = self._callers(session.items), 0
        for mutant in self._mutants:
            items = [item for item in session.items if item.nodeid in callers[mutant.function]]
            status = run_forked(mutant, items)
            killed += status == KILLED
            if status != KILLED:
                reason = "survives" if items else "no quick test calls"
                print(f"{reason} {mutant.path}:{mutant.line} {mutant.name}", file=sys.stderr)
        print(f"{self._area}: {killed} of {len(self._mutants)} killed", file=sys.stderr)
        return True

    def _callers(self, items: Sequence[pytest.Item]) -> dict[Function, set[str]]:
        """Return the tests that call each function."""
        wanted = {mutant.function for mutant in self._mutants}
        read, written = os.pipe()
        if not os.fork():
            silence()
            with os.fdopen(written, "w") as out:
                for item in items:
                    for path, name in called(item, wanted):
                        print(path, name, item.nodeid, sep="\t", file=out)
            os._exit(0)
        os.close(written)
        found: dict[Function, set[str]] = defaultdict(set)
        with os.fdopen(read) as lines:
            for line in lines:
                path, name, node = line.rstrip("\n").split("\t", 2)
                found[path, name].add(node)
        os.wait()
        return found


def called(item: pytest.Item, wanted: set[Function]) -> set[Function]:
    """Run a test and return the wanted functions that it calls."""
    found = set[Function]()

    def profile(frame: FrameType, event: str, _: object) -> None:
        key = frame.f_code.co_filename, frame.f_code.co_qualname
        if event == "call" and key in wanted:
            found.add(key)

    sys.setprofile(profile)
    runtestprotocol(item, log=False)
    sys.setprofile(None)
    return found


def run_forked(mutant: Mutant, items: Sequence[pytest.Item]) -> int:
    """Run tests with a mutant, until the first failure; return SURVIVED, or any other status."""
    child = os.fork()
    if child:
        status = os.waitpid(child, 0)[1]
        return KILLED if status else SURVIVED
    silence()
    code = mutant.code()
    for one in gc.get_objects():
        if isinstance(one, FunctionType):
            key = one.__code__.co_filename, one.__code__.co_qualname
            if key == mutant.function:
                one.__code__ = code
    for item in items:
        if any(report.failed for report in runtestprotocol(item, log=False)):
            os._exit(KILLED)
    os._exit(SURVIVED)


def silence() -> None:
    """Write no output of this process."""
    null = os.open(os.devnull, os.O_WRONLY)
    os.dup2(null, 1)
    os.dup2(null, 2)


def main() -> None:
    """Run the mutants of one area after another."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--count", type=int, default=150)
    parser.add_argument("--seed", type=int, default=56)
    asked = parser.parse_args()
    for area, mutants in draw(asked.count, asked.seed).items():
        if not os.fork():
            options = ["-n0", "-qq", "-s", f"--timeout={TIMEOUT_S}", "-m", QUICK, AREAS[area]]
            pytest.main(options, plugins=[Mutation(area, mutants)])
            os._exit(0)
        os.wait()


if __name__ == "__main__":
    main()
