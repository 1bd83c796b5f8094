"""Address of the page, and the tokens of its roles."""

import hmac
import ipaddress
import secrets
from pathlib import Path

import msgspec

from common.io.files import write_private

ADDRESS_FILE = "dashboard.json"  # name of a file in the state folder
TOKEN_FILE = "dashboard_tokens.json"
TOKEN_BYTES = 24


class Tokens(msgspec.Struct, frozen=True):
    """Tokens of the roles; a role with an empty token needs none."""

    operator: str = ""
    planner: str = ""

    def role_of(self, token: str) -> str:
        """Return the role of a token, in constant time; empty if it has no role."""
        given = token.encode()
        operator = hmac.compare_digest(given, self.operator.encode())
        planner = hmac.compare_digest(given, self.planner.encode())
        if not token:
            return ""
        return "operator" if operator else "planner" if planner else ""


class PageAddress(msgspec.Struct, frozen=True):
    """Address of the page, read by people4d up and people4d open."""

    url: str  # address without a token
    tokens: Tokens = Tokens()

    @property
    def login(self) -> str:
        """Address with the operator's token."""
        return f"{self.url}?token={self.tokens.operator}" if self.tokens.operator else self.url


def is_local(host: str) -> bool:
    """Check that an address is reachable only from this machine."""
    if host == "localhost":
        return True
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return False


def read_tokens(host: str, given: Tokens, folder: Path | None) -> Tokens:
    """Return the configured, stored or generated tokens.

    On loopback addresses only configured tokens are used.

    Args:
        host: Address of the page.
        given: Tokens of the configuration.
        folder: Folder of stored tokens, or None.
    """
    if is_local(host):
        return given if given.operator else Tokens()
    file = folder / TOKEN_FILE if folder else None
    stored = Tokens()
    if file and file.is_file():
        try:
            stored = msgspec.json.decode(file.read_bytes(), type=Tokens)
        except (OSError, msgspec.DecodeError):
            stored = Tokens()
    tokens = Tokens(
        given.operator or stored.operator or secrets.token_urlsafe(TOKEN_BYTES),
        given.planner or stored.planner or secrets.token_urlsafe(TOKEN_BYTES),
    )
    if file:
        write_private(file, msgspec.json.encode(tokens))
    return tokens
