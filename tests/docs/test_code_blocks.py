"""Every code block and command of README.md and docs: run, or marked as not run with a reason."""

import itertools
import json
import os
import re
import shutil
import subprocess
import sys
import threading
import tomllib
from collections.abc import Iterator
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import Any, get_type_hints

import pytest
import typer
import typer.main
import yaml
from typer.core import TyperGroup
from typer.exceptions import TyperException

from common.config import load
from common.io.recording import RecordingWriter, open_recording
from deploy.cli import app
from evaluation.methods import read_method
from lab.catalogue import load_scenario
from people4d.codec import encode
from people4d.messages import CompressedRgbdFrame
from services.camera.calibration import read_calibration
from tests import DEMO, ROOT
from tests.contract.examples import BY_NAME
from tests.docs.pages import Block, Command, blocks, commands
from tests.network import Network

INCOMPLETE = {"MissingParameter", "NoArgsIsHelpError", "BadOptionUsage"}
LANGUAGES = {"python", "javascript", "json", "toml", "yaml", "sh", "text"}
ENDPOINT = re.compile(r"tcp/[\d.]+:7447")
TIMEOUT_S = 60
TARGETS = set(re.findall(r"^(\w+):", (ROOT / "Makefile").read_text("utf-8"), re.MULTILINE))
SERVICES = [folder.parent.name for folder in (ROOT / "services").glob("*/build.py")]
WITH_SETTINGS = {"up", "demo", "evaluate", "gait"}  # commands whose --set begins with a service


def named(items: list[Any]) -> list[Any]:
    return [pytest.param(item, id=item.name) for item in items]


def test_every_block_has_a_known_language() -> None:
    unknown = [block.name for block in blocks() if block.language not in LANGUAGES]
    assert not unknown


@pytest.fixture(scope="module")
def publishing(network: Network) -> Iterator[str]:
    """Endpoint of a router that forwards tracks and gait."""
    bus, stop = network.open("robot"), threading.Event()

    def publish() -> None:
        while not stop.wait(0.02):
            bus.publish(BY_NAME["Tracks"])
            bus.publish(BY_NAME["Gait"])
            bus.publish(BY_NAME["Predictions"])
            bus.publish(BY_NAME["Skeletons"])

    thread = threading.Thread(target=publish)
    thread.start()
    yield network.endpoint
    stop.set()
    thread.join()


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Working folder with the files that the pages assume: the demo, and a user's recording."""
    folder = tmp_path_factory.mktemp("docs")
    (folder / "deploy").symlink_to(ROOT / "deploy")
    images = 0
    with RecordingWriter(folder / "my.mcap") as writer:
        for log_time_ns, message in open_recording(DEMO).messages():
            images += isinstance(message, CompressedRgbdFrame)
            if images > 3:
                break
            writer.write(message, log_time_ns)
    return folder


PYTHON = [block for block in blocks("python") if not block.reason]
CONSUMERS = [block for block in PYTHON if ENDPOINT.search(block.code)]  # which end with a system


def program(block: Block) -> str:
    """Return a block, preceded by the earlier blocks of its page."""
    earlier = [b for b in PYTHON if b.page == block.page and b.line < block.line]
    return "\n".join(f"{b.setup}\n{b.code}" for b in [*earlier, block])


@pytest.mark.slow
@pytest.mark.parametrize("block", named([b for b in PYTHON if b not in CONSUMERS]))
def test_python_block_runs(
    block: Block, folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(folder)
    exec(compile(program(block), block.name, "exec"), {"__name__": "block"})
    assert bool(capsys.readouterr().out) == ("print(" in block.code)


@pytest.mark.processes
@pytest.mark.network
@pytest.mark.parametrize("block", named(CONSUMERS))
def test_python_block_receives(block: Block, folder: Path, publishing: str) -> None:
    with subprocess.Popen(
        [sys.executable, "-uc", ENDPOINT.sub(publishing, program(block))],
        cwd=folder,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    ) as process:
        timer = threading.Timer(TIMEOUT_S, process.kill)
        timer.start()
        try:
            assert process.stdout
            assert process.stderr
            assert process.stdout.readline(), process.stderr.read()
        finally:
            timer.cancel()
            process.kill()


@pytest.mark.processes
@pytest.mark.parametrize("block", named([b for b in blocks("javascript") if "decode" in b.code]))
def test_javascript_block_decodes_tracks(block: Block, tmp_path: Path) -> None:
    node = shutil.which("node")
    if not node:
        pytest.skip("node is not installed")
    package = tmp_path / "node_modules" / "@msgpack" / "msgpack"
    package.mkdir(parents=True)
    shutil.copy(Path(__file__).with_name("msgpack.mjs"), package / "index.mjs")
    (package / "package.json").write_text('{"name": "@msgpack/msgpack", "exports": "./index.mjs"}')
    (tmp_path / "tracks.bin").write_bytes(encode(BY_NAME["Tracks"]))
    program = f"""{block.code}
import {{ readFileSync }} from "node:fs";
const track = decode(readFileSync("tracks.bin")).tracks[0];
console.log(track.id, array(track.position_m).values.join());
"""
    (tmp_path / "program.mjs").write_text(program)
    done = subprocess.run(
        [node, "program.mjs"], cwd=tmp_path, capture_output=True, text=True, check=False
    )
    assert done.stdout == "7 1,2,3\n", done.stderr


@pytest.mark.parametrize("block", named(blocks("toml")))
def test_settings_of_toml_block_exist(block: Block, tmp_path: Path) -> None:
    file = tmp_path / "block.toml"
    file.write_text(block.code, "utf-8")
    values = tomllib.loads(block.code)
    if "extends" in values:
        read_method(str(file))
    elif "people" in values:
        load_scenario(str(file))
    elif "colour" in values:
        read_calibration(file)
    else:
        assert values.keys() <= set(SERVICES)
        for service in values:
            load(config_type(service), service, file, environment={})


def test_yaml_blocks_parse() -> None:
    for block in blocks("yaml"):
        assert yaml.safe_load(block.code), block.name


def test_json_blocks_parse() -> None:
    for block in blocks("json"):
        assert json.loads(block.code), block.name


@pytest.mark.parametrize("command", named([c for c in commands() if c.program == "people4d"]))
def test_people4d_command_parses(command: Command) -> None:
    parse(command)
    settings = list(settings_of(command.arguments))
    if command.arguments[:1] == ("run",) and command.complete:
        check_settings(command.arguments[1], settings)
    elif command.arguments[0] in WITH_SETTINGS:
        for setting in settings:
            service, _, rest = setting.partition(".")
            if service in SERVICES:
                check_settings(service, [rest])


@pytest.mark.parametrize("command", named([c for c in commands() if c.program == "python -m"]))
def test_module_of_command_exists(command: Command) -> None:
    module, *arguments = command.arguments
    if module == "services.SERVICE":
        return
    assert find_spec(module)
    if module.startswith("services."):
        check_settings(module.partition(".")[2], list(settings_of(arguments)))


@pytest.mark.parametrize("command", named([c for c in commands() if c.program == "make"]))
def test_target_of_make_exists(command: Command) -> None:
    assert command.arguments[0] in TARGETS


def parse(command: Command) -> None:
    """Parse a command by the parser of the command line, without running it."""
    arguments = [a for a in command.arguments if a not in ("COMMAND", "SERVICE")]
    if not arguments or arguments[0].startswith("--"):
        return  # options of people4d alone, which act while they are parsed
    context = typer.main.get_command(app).make_context("people4d", arguments)
    while isinstance(context.command, TyperGroup):
        remaining = [*context._protected_args, *context.args]
        if not remaining:
            return  # a group that acts by itself
        name, found, rest = context.command.resolve_command(context, remaining)
        assert found
        try:
            context = found.make_context(name, rest, parent=context)
        except typer.Exit:
            return  # --help
        except TyperException as error:
            # A mention in the text may leave out what a command requires.
            if command.complete or type(error).__name__ not in INCOMPLETE:
                raise
            return


def settings_of(arguments: tuple[str, ...] | list[str]) -> Iterator[str]:
    """Yield the settings given by --set."""
    for flag, value in itertools.pairwise(arguments):
        if flag == "--set":
            yield value


def config_type(service: str) -> Any:
    """Return the type of the configuration of a service."""
    return get_type_hints(import_module(f"services.{service}.build").build)["config"]


def check_settings(service: str, settings: list[str]) -> None:
    """Check that settings of a service exist and have a possible value."""
    if settings:
        load(config_type(service), service, overrides=settings, environment={})
