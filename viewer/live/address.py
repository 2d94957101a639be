"""Where poses go: an address as it is typed, without asking a name server."""

from __future__ import annotations

from dataclasses import dataclass
from ipaddress import ip_address

from runtime.errors import UsageError

DEFAULT_HOST, DEFAULT_PORT = "127.0.0.1", 9763
_FORM = "Write an IP address and a port, such as 127.0.0.1:9763."


@dataclass(frozen=True)
class Address:
    """An IP address and a UDP port."""

    host: str = DEFAULT_HOST
    port: int = DEFAULT_PORT

    @property
    def loopback(self) -> bool:
        """Whether what is sent there stays on this computer."""
        return ip_address(self.host).is_loopback

    def __str__(self) -> str:
        return f"[{self.host}]:{self.port}" if ":" in self.host else f"{self.host}:{self.port}"


def parse_address(text: str, port_number: int = DEFAULT_PORT, flag: str = "--live-link") -> Address:
    """The address of "HOST:PORT", "HOST", "PORT", ":PORT" or ""; HOST is an IP address or localhost.

    `port_number` is that of a text without one, `flag` the argument that it came from. UsageError.
    """
    text = text.strip()
    if text.isdigit():
        host, port = "", text
    elif text.startswith("["):
        host, _, rest = text[1:].partition("]")
        port = rest.removeprefix(":")
    else:
        host, _, port = text.partition(":")
    host = DEFAULT_HOST if host in ("", "localhost") else host
    try:
        address = Address(str(ip_address(host)), int(port) if port else port_number)
    except ValueError:
        raise UsageError(f"{flag} {text[:60]}: not an address.", _FORM) from None
    if not 1 <= address.port <= 65535:
        raise UsageError(f"{flag} {text[:60]}: expected a port of 1 to 65535.", _FORM)
    return address
