"""Nobody waits for the compiler: what is compiled is ready after the warm-up."""

import inspect
import pkgutil
from collections.abc import Iterator
from importlib import import_module
from types import FunctionType, ModuleType

from numba.core.dispatcher import Dispatcher

import services.gait
from services.gait.config import GaitConfig
from services.gait.warm_up import warm_up


def modules() -> list[ModuleType]:
    names = [module.name for module in pkgutil.iter_modules(services.gait.__path__)]
    return [import_module(f"services.gait.{name}") for name in names if name != "__main__"]


def plain(module: ModuleType) -> Iterator[FunctionType]:
    """Yield the functions and methods of a module that are not compiled."""
    yield from (f for _, f in inspect.getmembers(module, inspect.isfunction))
    for _, kind in inspect.getmembers(module, inspect.isclass):
        yield from (f for _, f in inspect.getmembers(kind, inspect.isfunction))


def test_all_that_is_called_is_compiled_before_the_first_frame() -> None:
    warm_up(GaitConfig())
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
