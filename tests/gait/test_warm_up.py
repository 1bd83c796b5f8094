"""The warm-up compiles every kernel."""

import inspect
import pkgutil
from collections.abc import Iterator
from importlib import import_module
from types import FunctionType, ModuleType

from numba.core.dispatcher import Dispatcher

import services.gait
from services.gait.build import warm_up
from services.gait.config import CascadeConfig, DepthLayerConfig, GaitConfig


def modules() -> list[ModuleType]:
    found = pkgutil.walk_packages(services.gait.__path__, "services.gait.")
    return [import_module(module.name) for module in found if "__main__" not in module.name]


def plain(module: ModuleType) -> Iterator[FunctionType]:
    """Yield the functions and methods of a module that are not compiled."""
    yield from (f for _, f in inspect.getmembers(module, inspect.isfunction))
    for _, kind in inspect.getmembers(module, inspect.isclass):
        yield from (f for _, f in inspect.getmembers(kind, inspect.isfunction))


def test_every_called_kernel_is_compiled_by_the_warm_up() -> None:
    for feature in ("combined", "spin"):
        depth = DepthLayerConfig(feature=feature)
        warm_up(GaitConfig(cascade=CascadeConfig(depth=depth)))
    called, ready = set(), set()
    for module in modules():
        names = {name for function in plain(module) for name in function.__code__.co_names}
        for name, member in inspect.getmembers(module):
            if isinstance(member, Dispatcher) and name in names:
                called.add(name)
                if member.signatures:
                    ready.add(name)
    assert len(called) > 10
    assert called - ready == set()
