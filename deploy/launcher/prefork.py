"""Supervisord that forks services with their modules loaded: `python -m deploy.launcher.prefork`.

Libraries of the services (numpy, OpenCV, scipy, Zenoh, ...) are loaded once and shared, which saves
memory and start time. The fork of supervisord runs the module of `python -m MODULE` if it is
loaded; all other commands are executed. Ends of processes are also detected sooner.
"""

import atexit
import gc
import importlib
import os
import runpy
import shlex
import signal
import sys
import threading
from collections.abc import Mapping, Sequence
from contextlib import suppress
from typing import NoReturn

from setproctitle import getproctitle, setproctitle
from supervisor import supervisord
from supervisor.options import ServerOptions

POLL_S = 0.1  # polling period of processes; 1 s in supervisord [s]
OWN = ("deploy.launcher.watchdog",)
HANDLED = (
    "SIGTERM",
    "SIGINT",
    "SIGQUIT",
    "SIGHUP",
    "SIGCHLD",
    "SIGUSR2",
)  # signals that supervisord handles


class PreforkOptions(ServerOptions):  # type: ignore[misc]  # supervisor has no types
    """Options and system calls of supervisord, with another execve."""

    def __init__(self) -> None:
        super().__init__()
        poll = self.poller.poll
        self.poller.poll = lambda timeout_s: poll(min(timeout_s, POLL_S))

    def realize(self, *arguments: object, **more: object) -> None:
        """Read the configuration, and load the modules of its programs."""
        super().realize(*arguments, **more)
        self._loaded: frozenset[str] = frozenset()
        if os.environ.get("PEOPLE4D_PREFORK") == "off":
            return
        configs = [one for group in self.process_group_configs for one in group.process_configs]
        modules = {module_of(split(shlex.split(config.command))[1]) for config in configs}
        self._loaded = load(sorted(modules - {""}))

    def execve(self, filename: str, argv: Sequence[str], env: Mapping[str, str]) -> None:
        """Run a program in a new fork."""
        variables, command = split(argv)
        if module_of(command) in self._loaded:
            become(command, {**env, **variables})
        super().execve(filename, argv, env)


def split(argv: Sequence[str]) -> tuple[dict[str, str], Sequence[str]]:
    """Split `env NAME=VALUE ... COMMAND` into variables and command."""
    end = next((i for i, word in enumerate(argv) if i and "=" not in word), len(argv))
    return dict(word.split("=", 1) for word in argv[1:end]), argv[end:]


def module_of(command: Sequence[str]) -> str:
    """Return the MODULE of a command `python -m MODULE ...`, empty for any other command."""
    return command[2] if len(command) > 2 and command[:2] == [sys.executable, "-m"] else ""


def load(modules: Sequence[str]) -> frozenset[str]:
    """Import modules as far as possible; return the modules that may run in a fork.

    For a service its module `build` is imported, since `__main__` would run. If an import starts a
    thread, no module may run in a fork, which lacks the thread.
    """
    loaded = set()
    for module in modules:
        with suppress(Exception):  # the process itself logs the reason
            importlib.import_module(module if module in OWN else f"{module}.build")
            loaded.add(module)
    gc.collect()
    gc.freeze()  # the garbage collector of a fork would write to shared memory
    return frozenset(loaded if len(os.listdir("/proc/self/task")) == 1 else ())


def become(command: Sequence[str], variables: Mapping[str, str]) -> NoReturn:
    """Run `python -m MODULE ARGUMENTS` in this fork of supervisord, then exit.

    Args:
        command: Command to run.
        variables: The whole environment.
    """
    for name in HANDLED:
        signal.signal(getattr(signal, name), signal.SIG_DFL)
    signal.signal(signal.SIGINT, signal.default_int_handler)
    os.environ.clear()
    os.environ.update(variables)
    sys.argv = list(command[2:])
    setproctitle(shlex.join(command))
    if command[2] in OWN:
        del sys.modules[command[2]]  # the module runs as __main__
    status = 1
    try:
        runpy.run_module(command[2], run_name="__main__", alter_sys=True)
        status = 0
    except SystemExit as end:
        status = end.code if isinstance(end.code, int) else int(end.code is not None)
        if not isinstance(end.code, int | None):
            print(end.code, file=sys.stderr)
    except BaseException:  # like Python's interpreter
        sys.excepthook(*sys.exc_info())
    finally:
        # Ends like an interpreter, without returning to supervisord's code on the stack.
        with suppress(Exception):
            threading._shutdown()  # type: ignore[attr-defined]  # as multiprocessing does
            atexit._run_exitfuncs()
            sys.stdout.flush()
            sys.stderr.flush()
        os._exit(status)


def main() -> None:
    """Run supervisord."""
    getproctitle()  # locates the title in memory before changes of the environment
    supervisord.ServerOptions = PreforkOptions
    supervisord.main()


if __name__ == "__main__":
    main()
