"""Access: decides from Host, origin and token whether a page answers a request."""

import hmac
import ipaddress
import re
import secrets
import socket
from collections.abc import Iterable
from contextlib import suppress
from typing import Any
from urllib.parse import parse_qs, urlsplit

from .. import checks

LOCAL = ("127.0.0.1", "localhost", "::1")
"""Host names of this machine itself."""
EVERYWHERE = ("0.0.0.0", "::", "")
"""Host names for all addresses of this machine."""


class Access:
    """The rule for who may open a page.

    With each request a browser sends the name of the server (Host), and for a request by another page that page's
    origin (Origin). Any page can make a browser send requests to this machine, but only with its own origin;
    and with a different Host only if the name resolves to this machine (DNS rebinding).

    `host` is the address of the page: unless only this machine can reach it, requests need a token. `allow_origin`
    are other origins whose pages may control this page, such as a proxy: scheme, host and port. ValueError is
    raised if an origin is invalid.
    """

    def __init__(self, host: str, allow_origin: Iterable[str] = ()) -> None:
        self.origins = tuple(_origin(one) for one in allow_origin)
        self._any_address = host in EVERYWHERE
        names = {socket.gethostname(), socket.getfqdn()} if self._any_address else {host}
        names |= {*LOCAL, *(str(urlsplit(one).hostname) for one in self.origins)}
        self._names = {name.lower() for name in names}
        address = _address(host)
        is_local = host == "localhost" or (address is not None and address.is_loopback)
        self.token = None if is_local else secrets.token_urlsafe(32)
        self._cookie = f"msdwarp-{secrets.token_hex(4)}"  # browsers store cookies by host, regardless of the port

    def refusal(self, path: str, headers: Any) -> str | None:
        """Return why a request with this path and these headers is refused; None if it is allowed."""
        hosts, origins = headers.get_all("Host"), headers.get_all("Origin")
        host = hosts[0].lower() if len(hosts) == 1 else ""
        if not self._is_own(host):
            return f"this page is not served under the name {host[:100]!r}; see --allow-origin"
        own = (f"http://{host}", *self.origins)
        if any(one.lower() not in own for one in origins) or (headers.get_all("Upgrade") and len(origins) != 1):
            return "pages of other origins may not control this one; see --allow-origin"
        if self.token is not None and not self._has_token(self.token, path, headers):
            return "this page needs the token of the address that msdwarp printed"
        return None

    def _is_own(self, host: str) -> bool:
        """Return whether a Host names this page, with any port, since ports may be forwarded."""
        try:
            name = urlsplit(f"//{host}").hostname or ""
        except ValueError:
            return False
        # An address needs no DNS, so rebinding cannot change it.
        return name in self._names or (self._any_address and _address(name) is not None)

    def _has_token(self, token: str, path: str, headers: Any) -> bool:
        """Return whether a request has the token, in the request's address or as a cookie."""
        cookies = [one.strip().partition("=") for line in headers.get_all("Cookie") for one in line.split(";")]
        given = [value for name, _, value in cookies if name == self._cookie]
        given += parse_qs(urlsplit(path).query).get("token", [])
        return any(hmac.compare_digest(one.encode("utf-8", "surrogateescape"), token.encode()) for one in given)

    @property
    def response_headers(self) -> dict[str, str]:
        """Headers of each response: browsers must not reveal the token, nor show the page inside another page."""
        frames = " ".join(("frame-ancestors 'self'", *self.origins))
        headers = {"Content-Security-Policy": frames, "Referrer-Policy": "no-referrer"}
        if self.token is not None:
            headers["Set-Cookie"] = f"{self._cookie}={self.token}; Path=/; HttpOnly; SameSite=Strict"
        return headers


def _origin(given: Any) -> str:
    """Return an origin in the form that browsers use; raise ValueError if it is invalid."""
    if not isinstance(given, str) or not re.fullmatch(r"https?://([\w.-]+|\[[0-9a-fA-F:.]+\])(:\d{1,5})?", given):
        raise ValueError(
            f"allow_origin is {checks.repr_short(given)}; it must be scheme, host and port, such as https://lab.example:8443"
        )
    return given.lower()


def _address(name: str) -> ipaddress.IPv4Address | ipaddress.IPv6Address | None:
    """Return a name as an IP address; None if the name is not an address."""
    with suppress(ValueError):
        return ipaddress.ip_address(name)
