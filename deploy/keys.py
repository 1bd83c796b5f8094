"""A small certificate authority, and the credentials of each host.

A root key, which never leaves the folder, signs one certificate for each role. The name in a
certificate is the role, which determines access rules. Only processes that accept connections have
server certificates, and only the router has one for the names of its host.
"""

import ipaddress
import os
import secrets
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from pathlib import Path

from cryptography import x509
from cryptography.exceptions import InvalidSignature
from cryptography.hazmat.primitives import hashes, serialization
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.x509.oid import ExtendedKeyUsageOID, NameOID

from common.transport.access import CLIENT_ROLES, ROUTER, roles
from people4d.credentials import AUTHORITY, PASSWORDS
from people4d.errors import ConfigError

AUTHORITY_KEY = "ca.key"
AUTHORITY_DAYS = 3650
LOCAL = ("localhost", "127.0.0.1", "::1")
SLACK = timedelta(hours=1)  # maximum difference between the clocks of hosts
SECRET, PUBLIC = 0o600, 0o644
PASSWORD_BYTES = 24

Hosts = Mapping[str, Sequence[str]]


@dataclass(frozen=True)
class Pair:
    """A certificate and its private key."""

    certificate: x509.Certificate
    key: ec.EllipticCurvePrivateKey


@dataclass(frozen=True)
class CredentialCheck:
    """State of one certificate or password."""

    file: Path  # the file
    role: str  # role proven by the file
    ends: datetime | None  # end of validity; None for a password
    problem: str  # fault; empty if there is none


def write_certificates(folder: Path, hosts: Hosts, addresses: Sequence[str], days: int) -> None:
    """Write an authority and a folder of certificates for each host.

    An existing authority in the folder signs the new certificates. ConfigError if a role is
    unknown, or the authority in the folder cannot be read.

    Args:
        folder: Folder of the authority.
        hosts: Roles of each host by its name.
        addresses: Names and addresses by which other hosts reach the router.
        days: Validity of the certificates.
    """
    _check(hosts)
    authority = _read_authority(folder) or _new_authority(folder)
    for host, its_roles in hosts.items():
        (folder / host).mkdir(mode=0o700, parents=True, exist_ok=True)
        _write(folder / host / AUTHORITY, _pem(authority.certificate), PUBLIC)
        for role in its_roles:
            pair = _signed(role, authority, addresses, days)
            _write(folder / host / f"{role}.key", _private(pair.key), SECRET)
            _write(folder / host / f"{role}.pem", _pem(pair.certificate), PUBLIC)


def write_passwords(folder: Path, hosts: Hosts) -> None:
    """Write the passwords of each host, and their list for the router; or ConfigError."""
    _check(hosts)
    known = {role: secrets.token_urlsafe(PASSWORD_BYTES) for role in roles()}
    for host, its_roles in hosts.items():
        (folder / host).mkdir(mode=0o700, parents=True, exist_ok=True)
        for role in its_roles:
            _write(folder / host / f"{role}.password", f"{known[role]}\n".encode(), SECRET)
        if ROUTER in its_roles:
            lines = "".join(f"{role}:{password}\n" for role, password in known.items())
            _write(folder / host / PASSWORDS, lines.encode(), SECRET)


def check(folder: Path, now: datetime) -> list[CredentialCheck]:
    """Check that all credentials below a folder are valid at a time."""
    certificates = sorted(f for f in folder.rglob("*.pem") if f.name != AUTHORITY)
    passwords = sorted(folder.rglob("*.password"))
    return [
        *(_check_certificate(file, now) for file in certificates),
        *(CredentialCheck(file, file.stem, None, _open_to_others(file)) for file in passwords),
    ]


def _check(hosts: Hosts) -> None:
    for host, its_roles in hosts.items():
        for role in set(its_roles) - set(roles()):
            raise ConfigError(
                f"host {host}: unknown role {role!r}", f"Roles are {', '.join(roles())}."
            )


def _read_authority(folder: Path) -> Pair | None:
    key_file, file = folder / AUTHORITY_KEY, folder / AUTHORITY
    if not key_file.exists():
        return None
    try:
        certificate = x509.load_pem_x509_certificate(file.read_bytes())
        key = serialization.load_pem_private_key(key_file.read_bytes(), None)
    except (OSError, ValueError) as error:
        raise ConfigError(
            f"the authority in {folder} cannot be read: {error}", "Make a new folder."
        ) from error
    if not isinstance(key, ec.EllipticCurvePrivateKey):
        raise ConfigError(f"{key_file}: expected an elliptic curve key", "Make a new folder.")
    return Pair(certificate, key)


def _new_authority(folder: Path) -> Pair:
    key = ec.generate_private_key(ec.SECP256R1())
    subject = _name(f"people4d {secrets.token_hex(4)}")
    builder = _builder(subject, subject, key, AUTHORITY_DAYS)
    builder = builder.add_extension(x509.BasicConstraints(ca=True, path_length=0), critical=True)
    authority = Pair(builder.sign(key, hashes.SHA256()), key)
    folder.mkdir(mode=0o700, parents=True, exist_ok=True)
    _write(folder / AUTHORITY_KEY, _private(key), SECRET)
    _write(folder / AUTHORITY, _pem(authority.certificate), PUBLIC)
    return authority


def _signed(role: str, authority: Pair, addresses: Sequence[str], days: int) -> Pair:
    key = ec.generate_private_key(ec.SECP256R1())
    names = [*LOCAL, *addresses] if role == ROUTER else LOCAL
    uses = [ExtendedKeyUsageOID.CLIENT_AUTH]
    if role not in CLIENT_ROLES:
        uses.append(ExtendedKeyUsageOID.SERVER_AUTH)
    subject = authority.certificate.subject
    builder = _builder(_name(role), subject, key, days)
    for extension, critical in (
        (x509.BasicConstraints(ca=False, path_length=None), True),
        (x509.SubjectAlternativeName([_general(name) for name in names]), False),
        (x509.ExtendedKeyUsage(uses), False),
    ):
        builder = builder.add_extension(extension, critical)
    return Pair(builder.sign(authority.key, hashes.SHA256()), key)


def _builder(
    subject: x509.Name, issuer: x509.Name, key: ec.EllipticCurvePrivateKey, days: int
) -> x509.CertificateBuilder:
    now = datetime.now(UTC)
    builder = x509.CertificateBuilder().subject_name(subject).issuer_name(issuer)
    builder = builder.public_key(key.public_key()).serial_number(x509.random_serial_number())
    return builder.not_valid_before(now - SLACK).not_valid_after(now + timedelta(days=days))


def _check_certificate(file: Path, now: datetime) -> CredentialCheck:
    try:
        certificate = x509.load_pem_x509_certificate(file.read_bytes())
        names = certificate.subject.get_attributes_for_oid(NameOID.COMMON_NAME)
        role, ends = str(names[0].value), certificate.not_valid_after_utc
    except (OSError, ValueError, IndexError) as error:
        return CredentialCheck(file, file.stem, None, f"not a certificate: {error}")
    return CredentialCheck(file, role, ends, _problem(file, certificate, role, now))


def _problem(file: Path, certificate: x509.Certificate, role: str, now: datetime) -> str:
    key_file = file.with_suffix(".key")
    try:
        authority = x509.load_pem_x509_certificate((file.parent / AUTHORITY).read_bytes())
        key = serialization.load_pem_private_key(key_file.read_bytes(), None)
    except (OSError, ValueError, TypeError) as error:
        return str(error)
    try:
        certificate.verify_directly_issued_by(authority)
    except (InvalidSignature, ValueError, TypeError):
        return f"not signed by {AUTHORITY} beside it"
    if key.public_key() != certificate.public_key():
        return f"{key_file.name} belongs to another certificate"
    if role != file.stem:
        return f"it is of role {role}, but named {file.stem}"
    if now < certificate.not_valid_before_utc:
        return "not good yet; is the clock right?"
    if now >= min(certificate.not_valid_after_utc, authority.not_valid_after_utc):
        return "ended"
    return _open_to_others(key_file)


def _open_to_others(file: Path) -> str:
    return f"{file.name} can be read by others: chmod 600" if file.stat().st_mode & 0o077 else ""


def _write(file: Path, data: bytes, mode: int) -> None:
    """Write a file atomically, with its permissions from its creation on."""
    fresh = file.with_name(f".{file.name}.new")
    fresh.unlink(missing_ok=True)
    with os.fdopen(os.open(fresh, os.O_WRONLY | os.O_CREAT | os.O_EXCL, mode), "wb") as stream:
        stream.write(data)
    fresh.replace(file)


def _pem(certificate: x509.Certificate) -> bytes:
    return certificate.public_bytes(serialization.Encoding.PEM)


def _private(key: ec.EllipticCurvePrivateKey) -> bytes:
    return key.private_bytes(
        serialization.Encoding.PEM, serialization.PrivateFormat.PKCS8, serialization.NoEncryption()
    )


def _name(common_name: str) -> x509.Name:
    return x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, common_name)])


def _general(name: str) -> x509.GeneralName:
    try:
        return x509.IPAddress(ipaddress.ip_address(name))
    except ValueError:
        return x509.DNSName(name)
