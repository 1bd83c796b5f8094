"""Credentials that prove the role of a process: a folder of certificates or passwords.

`people4d keys` writes such a folder for each host. With certificates it holds `ca.pem`, and
`ROLE.pem` and `ROLE.key` for each role; with passwords `ROLE.password` for each role, and
`passwords`, the list of a router.
"""

from pathlib import Path
from typing import Any

from people4d.errors import ConfigError

AUTHORITY = "ca.pem"
PASSWORDS = "passwords"
OPERATOR = "operator"  # role of the command line


def settings(folder: Path, mode: str, role: str = "") -> dict[str, Any]:
    """Return the credentials of a role as parts of a Zenoh configuration.

    Args:
        folder: Folder of certificates or passwords.
        mode: "router", "peer", "client" or "area".
        role: Role to prove; empty: the only one in the folder, else the operator.

    Returns:
        Values by path in the configuration.

    Raises:
        ConfigError: The folder lacks a file.
    """
    suffix = ".pem" if uses_certificates(folder) else ".password"
    role = role or _only_role(folder, suffix)
    if not (folder / f"{role}{suffix}").is_file():
        raise ConfigError(
            f"{folder} holds neither {role}.pem with {AUTHORITY} nor {role}.password",
            f"Does PEOPLE4D_KEYS name the folder of this host, with the role {role} "
            "(people4d keys)?",
        )
    if suffix == ".pem":
        return {"transport/link/tls": _certificates(folder, role)}
    return {"transport/auth/usrpwd": _password(folder, role, mode)}


def uses_certificates(folder: Path) -> bool:
    """Check that a folder holds certificates, which require encrypted links."""
    return (folder / AUTHORITY).is_file()


def _only_role(folder: Path, suffix: str) -> str:
    names = sorted(file.stem for file in folder.glob(f"*{suffix}") if file.name != AUTHORITY)
    return names[0] if len(names) == 1 else OPERATOR


def _certificates(folder: Path, role: str) -> dict[str, Any]:
    certificate, key = (str((folder / f"{role}{end}").absolute()) for end in (".pem", ".key"))
    return {
        "root_ca_certificate": str((folder / AUTHORITY).absolute()),
        "enable_mtls": True,
        "connect_certificate": certificate,
        "connect_private_key": key,
        "listen_certificate": certificate,
        "listen_private_key": key,
        "verify_name_on_connect": True,
        "close_link_on_expiration": True,
    }


def _password(folder: Path, role: str, mode: str) -> dict[str, Any]:
    own = (folder / f"{role}.password").read_text(encoding="utf-8").strip()
    if mode == "client":
        return {"user": role, "password": own}
    others = folder / PASSWORDS
    if not others.is_file():
        raise ConfigError(
            f"{folder} does not hold {PASSWORDS}, the passwords that a {mode} checks",
            "Services that run on another host than the router need PEOPLE4D_MODE=client.",
        )
    return {"user": role, "password": own, "dictionary_file": str(others.absolute())}
