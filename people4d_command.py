"""The command `people4d`, with installed modules before modules of the user.

This module is outside of all packages: a file common.py, services.py or people4d.py in a folder of
PYTHONPATH would otherwise replace a package of the same name.
"""

import importlib
import os
import sys
from pathlib import Path

PLUGINS = "PEOPLE4D_PLUGINS"  # folders of plug-ins, searched last by common.registry


def main() -> None:
    """Run the command line."""
    search_plugins_last()
    importlib.import_module("deploy.cli").main()


def search_plugins_last() -> None:
    """Remove the working directory and PYTHONPATH from the search path, for children, too.

    Their folders become PEOPLE4D_PLUGINS; the folder of this module stays.
    """
    own = Path(__file__).resolve().parent
    folders = [] if sys.flags.safe_path else [os.getcwd()]
    folders += [name for name in os.environ.pop("PYTHONPATH", "").split(os.pathsep) if name]
    user = {Path(name).resolve() for name in folders} - {own}
    if len(user) < len(set(folders)):  # not installed: found through one of these
        os.environ["PYTHONPATH"] = str(own)
    sys.path[:] = [name for name in sys.path if Path(name).resolve() not in user]
    plugins = os.environ.get(PLUGINS, "").split(os.pathsep) + [
        str(Path(n).resolve()) for n in folders
    ]
    os.environ[PLUGINS] = os.pathsep.join(dict.fromkeys(filter(None, plugins)))
    os.environ["PYTHONSAFEPATH"] = "1"
