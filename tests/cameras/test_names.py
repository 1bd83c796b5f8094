"""Names of SDKs in the plug-ins, checked in the installed SDKs without hardware."""

import ast
import importlib
import inspect
from collections.abc import Iterator
from typing import Any

import pytest

from cameras.oak import Oak
from cameras.orbbec import Orbbec
from cameras.realsense import RealSense
from cameras.sdk import SdkCamera
from tests.cameras.soft_realsense import import_sdk

MODULE_NAMES = ("dai", "ob", "rs")  # names under which a plug-in uses its SDK


def chains(tree: ast.AST) -> Iterator[list[str]]:
    """Yield the names of each chain of attributes, the variable first."""
    for node in ast.walk(tree):
        names = []
        while isinstance(node, ast.Attribute):
            names.append(node.attr)
            node = node.value
        if names and isinstance(node, ast.Name):
            yield [node.id, *reversed(names)]


def called(tree: ast.AST) -> set[str]:
    """Return the names of all methods and attributes."""
    return {node.attr for node in ast.walk(tree) if isinstance(node, ast.Attribute)}


def attributes(module: Any) -> set[str]:
    """Return the names of the attributes of all classes of an SDK, also of the nested ones."""
    classes, found = [module], set[str]()
    for one in classes:
        found.update(dir(one))
        nested = [getattr(one, name) for name in dir(one) if not name.startswith("_")]
        inner = [n for n in nested if inspect.isclass(n) or inspect.ismodule(n)]
        classes += [n for n in inner if n not in classes and module.__name__ in str(n)]
    return found


@pytest.mark.filterwarnings("ignore")  # depthai has deprecated names
@pytest.mark.parametrize("camera", [RealSense, Orbbec, Oak])
def test_every_name_of_an_sdk_exists(camera: type[SdkCamera]) -> None:
    if camera is RealSense:
        import_sdk()
    module = pytest.importorskip(camera.module, reason=f"{camera.module} is not installed")
    source = inspect.getsource(importlib.import_module(camera.__module__))
    tree = ast.parse(source)
    for variable, *names in chains(tree):
        found = module
        for name in names if variable in MODULE_NAMES else ():
            assert hasattr(found, name), f"{camera.module} has no {'.'.join(names)}"
            found = getattr(found, name)
    own = called(tree) - attributes(module)
    # Names of numpy, of the standard library and of ours
    ours = set(dir(camera)) | {"options", "info", "fps"}
    known = {"float32", "uint16", "uint8", "frombuffer", "array", "asarray", "reshape", "copy"}
    known |= {"compile", "IGNORECASE", "time_ns"}
    assert {name for name in own - ours - known if not name.startswith("_")} == set()
