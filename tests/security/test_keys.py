"""Certificates and passwords as people4d keys makes them."""

import os
import stat
from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest
from cryptography import x509
from cryptography.x509.oid import ExtendedKeyUsageOID, NameOID
from typer.testing import CliRunner

from deploy import keys
from deploy.cli import app
from people4d.errors import ConfigError

HOSTS = {"nuc": ["router", "camera"], "planner": ["planner"]}
NOW = datetime.now(UTC)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    keys.write_certificates(tmp_path / "keys", HOSTS, ["192.168.1.7", "nuc.local"], days=10)
    return tmp_path / "keys"


def certificate(file: Path) -> x509.Certificate:
    return x509.load_pem_x509_certificate(file.read_bytes())


def problems(folder: Path, now: datetime = NOW) -> dict[str, str]:
    return {found.role: found.problem for found in keys.check(folder, now)}


def run(*arguments: str) -> tuple[int, str, str]:
    result = CliRunner().invoke(app, ["keys", *arguments], env={"COLUMNS": "200"})
    return result.exit_code, result.stdout, result.stderr


def test_each_host_gets_its_roles_but_not_the_key_of_the_authority(folder: Path) -> None:
    files = {str(f.relative_to(folder)) for f in folder.rglob("*") if f.is_file()}
    assert files == {
        *("ca.key", "ca.pem", "nuc/ca.pem", "planner/ca.pem"),
        *("nuc/router.key", "nuc/router.pem", "nuc/camera.key", "nuc/camera.pem"),
        *("planner/planner.key", "planner/planner.pem"),
    }


def test_only_the_owner_reads_private_keys(folder: Path) -> None:
    before = os.umask(0)  # the most permissive mask
    try:
        keys.write_certificates(folder, HOSTS, [], days=10)
        keys.write_passwords(folder, HOSTS)
    finally:
        os.umask(before)
    secret = [f for f in folder.rglob("*") if f.is_file() and f.suffix != ".pem"]
    assert len(secret) == 1 + 3 + 3 + 1  # authority, keys, passwords, the router's list
    for file in secret:
        assert stat.S_IMODE(file.stat().st_mode) == 0o600, file
    for subfolder in (folder / "nuc", folder / "planner"):
        assert stat.S_IMODE(subfolder.stat().st_mode) == 0o700


def test_certificates_hold_role_uses_and_addresses(folder: Path) -> None:
    for host, roles in HOSTS.items():
        for role in roles:
            found = certificate(folder / host / f"{role}.pem")
            (name,) = found.subject.get_attributes_for_oid(NameOID.COMMON_NAME)
            assert name.value == role
            uses = found.extensions.get_extension_for_class(x509.ExtendedKeyUsage).value
            # Others connect to the router and, on their host, to services; never to the planner.
            assert (ExtendedKeyUsageOID.SERVER_AUTH in uses) == (role != "planner")
            names = found.extensions.get_extension_for_class(x509.SubjectAlternativeName).value
            alternatives = {str(name.value) for name in names}
            own = {"192.168.1.7", "nuc.local"} if role == "router" else set()
            assert alternatives == {"localhost", "127.0.0.1", "::1"} | own


def test_expired_certificates_are_reported(folder: Path) -> None:
    assert problems(folder) == {"router": "", "camera": "", "planner": ""}
    assert set(problems(folder, NOW + timedelta(days=11)).values()) == {"ended"}
    early = problems(folder, NOW - timedelta(hours=2))
    assert set(early.values()) == {"not good yet; is the clock right?"}


def test_faults_of_files_are_reported(folder: Path, tmp_path: Path) -> None:
    nuc = folder / "nuc"
    (nuc / "camera.key").chmod(0o644)
    assert problems(folder)["camera"] == "camera.key can be read by others: chmod 600"
    (nuc / "camera.key").write_bytes((nuc / "router.key").read_bytes())
    assert problems(folder)["camera"] == "camera.key belongs to another certificate"
    (nuc / "camera.key").unlink()
    assert "No such file" in problems(folder)["camera"]
    (nuc / "camera.pem").write_text("nonsense")
    assert problems(folder)["camera"].startswith("not a certificate")
    keys.write_certificates(tmp_path / "other", {"nuc": ["router"]}, [], days=1)
    (nuc / "ca.pem").write_bytes((tmp_path / "other" / "ca.pem").read_bytes())
    assert problems(folder)["router"] == "not signed by ca.pem beside it"


def test_renewing_keeps_the_authority_so_that_hosts_can_follow_one_by_one(folder: Path) -> None:
    before = certificate(folder / "nuc" / "camera.pem")
    authority = (folder / "ca.pem").read_bytes()
    keys.write_certificates(folder, {"nuc": ["camera"]}, [], days=20)
    after = certificate(folder / "nuc" / "camera.pem")
    assert after.not_valid_after_utc > before.not_valid_after_utc
    assert after.serial_number != before.serial_number
    assert (folder / "ca.pem").read_bytes() == authority
    assert problems(folder) == {"router": "", "camera": "", "planner": ""}


def test_only_the_routers_host_has_all_passwords(tmp_path: Path) -> None:
    keys.write_passwords(tmp_path, HOSTS)
    lines = (tmp_path / "nuc" / "passwords").read_text().splitlines()
    known = dict(line.split(":") for line in lines)
    assert known["planner"] == (tmp_path / "planner" / "planner.password").read_text().strip()
    assert len(set(known.values())) == len(known)
    assert all(len(password) >= 32 for password in known.values())
    assert not (tmp_path / "planner" / "passwords").exists()


def test_an_unknown_role_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"host nuc: unknown role 'cook'\. Roles are router"):
        keys.write_certificates(tmp_path, {"nuc": ["cook"]}, [], days=1)
    assert not list(tmp_path.iterdir())


def test_command_makes_the_keys_of_the_documented_hosts(tmp_path: Path) -> None:
    folder = tmp_path / "keys"
    status, output, _ = run(str(folder), "--router", "10.0.0.1")
    assert status == 0
    assert {line.split()[0] for line in output.splitlines()} == {
        *("host", "nuc", "tracker", "planner")
    }
    assert "(364 days)" in output
    status, _, error = run(str(folder), "--router", "10.0.0.1")
    assert (status, "holds keys already" in error) == (1, True)
    assert run(str(folder), "--router", "10.0.0.1", "--renew", "--days", "3")[0] == 0
    status, output, _ = run(str(folder / "planner"), "--check")
    assert (status, "ends soon" in output) == (0, True)
    (folder / "planner" / "planner.key").unlink()
    status, _, error = run(str(folder), "--check")
    assert (status, "1 of 19 keys" in error) == (1, True)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ([], "no address of the router is given"),
        (["--check"], "holds no keys"),
        (["--host", "nuc"], "host 'nuc' is incomplete"),
        (["--host", "../nuc=router"], "is incomplete"),
    ],
)
def test_command_reports_missing_arguments(
    tmp_path: Path, arguments: list[str], message: str
) -> None:
    status, _, error = run(str(tmp_path / "keys"), *arguments)
    assert status == 1
    assert message in error
