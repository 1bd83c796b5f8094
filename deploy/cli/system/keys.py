"""Command `people4d keys`."""

import importlib
from collections.abc import Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Annotated, Any

import typer

from common.extras import need
from deploy.cli.terminal import console, plain_table
from people4d.errors import ConfigError, People4dError

# The hosts of docs/launch/hosts.md; with --host others.
HOSTS = (
    "nuc=router,camera,detector,reid,gait,visual_odometry,report,watchdog,operator",
    "tracker=tracker,gt_bridge,predictor,skeleton,target,site,ros2_bridge,watchdog,operator",
    "planner=planner",
)
SOON_DAYS = 30


def keys(
    folder: Annotated[Path, typer.Argument(help="Folder of the keys, for example keys.")],
    router: Annotated[
        list[str],
        typer.Option(
            metavar="ADDRESS", help="Name or address by which other hosts reach the router."
        ),
    ] = [],  # noqa: B006 (typer copies it)
    host: Annotated[
        list[str],
        typer.Option(metavar="HOST=ROLE,...", help="A host and its roles; may be repeated."),
    ] = list(HOSTS),  # noqa: B006
    days: Annotated[int, typer.Option(min=1, help="Validity of the certificates in days.")] = 365,
    passwords: Annotated[
        bool, typer.Option("--passwords", help="Passwords in place of certificates.")
    ] = False,
    check: Annotated[
        bool, typer.Option("--check", help="Only check the keys; exit with 1 if one is invalid.")
    ] = False,
    renew: Annotated[bool, typer.Option("--renew", help="Replace existing keys.")] = False,
) -> None:
    """Make certificates (or passwords) for each role and host, or check them."""
    need("people4d keys", "keys")
    made: Any = importlib.import_module("deploy.keys")  # imported on use: the library is an extra
    if not check:
        hosts = dict(_host(text) for text in host)
        if made.check(folder, datetime.now(UTC)) and not renew:
            raise ConfigError(
                f"{folder} holds keys already", "Look at them with --check, or --renew them."
            )
        if passwords:
            made.write_passwords(folder, hosts)
        elif router or len(hosts) == 1:
            made.write_certificates(folder, hosts, router, days)
        else:
            raise ConfigError(
                "no address of the router is given",
                "Other hosts check that they reach the right one: --router 192.168.1.7",
            )
    _show(folder, made.check(folder, datetime.now(UTC)))


def _host(text: str) -> tuple[str, list[str]]:
    name, _, listed = text.partition("=")
    roles = [role.strip() for role in listed.split(",") if role.strip()]
    if not roles or not name or set(name) & set("/\\") or name.startswith("."):
        raise ConfigError(f"host {text!r} is incomplete", "Write --host NAME=ROLE,ROLE.")
    return name, roles


def _show(folder: Path, checks: Sequence[Any]) -> None:
    if not checks:
        raise ConfigError(f"{folder} holds no keys", "Make them: people4d keys FOLDER --router ...")
    table = plain_table("host", "role", "good until", "state")
    for found in checks:
        days = (found.ends - datetime.now(UTC)).days if found.ends else SOON_DAYS
        until = f"{found.ends:%Y-%m-%d} ({days} days)" if found.ends else "changed"
        state = "[green]ok[/]" if days >= SOON_DAYS else "[yellow]ends soon, --renew[/]"
        if found.problem:
            state = f"[red]{found.problem}[/]"
        table.add_row(found.file.parent.name, found.role, until, state)
    console.print(table)
    bad = sum(bool(found.problem) for found in checks)
    if bad:
        raise People4dError(
            f"{bad} of {len(checks)} keys in {folder} are not good", "Make new ones: --renew"
        )
