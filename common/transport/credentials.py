"""What a process proves who it is with: a folder of certificates or passwords.

`people4d keys` writes such a folder for each host. In it are, of certificates: `ca.pem` and for
each role `ROLE.pem` and `ROLE.key`; of passwords: `ROLE.password`, and `passwords`, from which a
router or peer knows those of the others.
"""

from pathlib import Path
from typing import Any

from common.transport.access import HERE, PEOPLE, access_control
from people4d.errors import ConfigError

AUTHORITY = "ca.pem"
PASSWORDS = "passwords"
OPERATOR = PEOPLE[-1]


def settings(folder: Path, mode: str, role: str = "", here: str = "") -> dict[str, Any]:
    """Return the parts of a Zenoh configuration that prove a role and enforce those of others.

    Args:
        folder: Folder of certificates or passwords.
        mode: "router", "peer" or "client".
        role: Whom to prove to be; empty: the only one in the folder, else the operator.
        here: Interfaces on which topics may pass that do not leave the host, with commas between.

    Returns:
        Values by path in the configuration.

    Raises:
        ConfigError: The folder does not hold what is needed.
    """
    suffix = ".pem" if (folder / AUTHORITY).is_file() else ".password"
    role = role or _only_role(folder, suffix)
    if not (folder / f"{role}{suffix}").is_file():
        raise ConfigError(
            f"{folder} holds neither {role}.pem with {AUTHORITY} nor {role}.password",
            f"Does PEOPLE4D_KEYS name the folder of this host, with the role {role} "
            "(people4d keys)?",
        )
    interfaces = [name for name in here.split(",") if name] or list(HERE)
    if suffix == ".pem":
        found = {"transport/link/tls": _certificates(folder, role)}
        # Each end knows the other's role, so peers let only those in to whom they may speak.
        enforced = {"access_control": access_control("cert_common_names", interfaces)}
        return found if mode == "client" else found | enforced
    found = {"transport/auth/usrpwd": _password(folder, role, mode)}
    # Who connects proves a role, who is connected to does not: only the router can enforce them.
    enforced = {"access_control": access_control("usernames", interfaces)}
    return found | enforced if mode == "router" else found


def uses_certificates(folder: Path) -> bool:
    """Return whether a folder holds certificates, so that every link must be encrypted."""
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
    others = folder / PASSWORDS
    known = {"dictionary_file": str(others.absolute())} if mode != "client" else {}
    if known and not others.is_file():
        raise ConfigError(
            f"{folder} does not hold {PASSWORDS}, from which a {mode} knows the others",
            "Services that run on another host than the router need PEOPLE4D_MODE=client.",
        )
    return {"user": role, "password": own, **known}
