"""Access: which requests to a page are heard: by the name it was asked for under, its origin and its token."""

import hmac
import ipaddress
import re
import secrets
import socket
from collections.abc import Iterable
from typing import Any
from urllib.parse import parse_qs, urlsplit

from .. import checks

HERE = ("127.0.0.1", "localhost", "::1")
"""Names of this machine that no other has."""
EVERYWHERE = ("0.0.0.0", "::", "")
"""Hosts that stand for all addresses of this machine."""


class Access:
    """Who may open a page.

    A browser sends with each request the name that it was asked for under (Host), and with those of other pages
    where these come from (Origin). Any page can have a browser ask this machine for something, but not under
    another origin than its own; nor under the page's name, unless it has that name lead here (DNS rebinding).

    Parameters
    ----------
    host
        What the page is served at. Unless that is this machine alone, requests need a token.
    allow_origin
        Other origins whose pages may control this one, such as that of a proxy: scheme, host and port.

    Raises
    ------
    ValueError
        If an origin is none.
    """

    def __init__(self, host: str, allow_origin: Iterable[str] = ()) -> None:
        self.origins = tuple(_origin(one) for one in allow_origin)
        self._any_address = host in EVERYWHERE
        names = {socket.gethostname(), socket.getfqdn()} if self._any_address else {host}
        names |= {*HERE, *(str(urlsplit(one).hostname) for one in self.origins)}
        self._names = {name.lower() for name in names}
        self.token = None if _only_here(host) else secrets.token_urlsafe(32)
        self._cookie = f"msdwarp-{secrets.token_hex(4)}"  # a browser keeps cookies by host, whatever the port

    def refusal(self, path: str, headers: Any) -> str | None:
        """Return why a request is refused; None if it is not.

        Parameters
        ----------
        path
            What is asked for.
        headers
            Those of the request; `get_all` returns all that have a name.
        """
        hosts, origins = headers.get_all("Host"), headers.get_all("Origin")
        host = hosts[0].lower() if len(hosts) == 1 else ""
        if not self._is_own(host):
            return f"this page is not served under the name {host[:100]!r}; see --allow-origin"
        own = (f"http://{host}", *self.origins)
        if any(one.lower() not in own for one in origins) or (headers.get_all("Upgrade") and len(origins) != 1):
            return "pages of other origins may not control this one; see --allow-origin"
        if self.token is not None and not any(map(self._is_token, self._tokens(path, headers))):
            return "this page needs the token of the address that msdwarp printed"
        return None

    def _is_own(self, host: str) -> bool:
        """Tell whether a Host names this page; with any port, as it may be forwarded from another one."""
        try:
            name = urlsplit(f"//{host}").hostname or ""
        except ValueError:
            return False
        # No name leads anybody to where an address is.
        return name in self._names or (self._any_address and _address(name) is not None)

    def _tokens(self, path: str, headers: Any) -> list[str]:
        """Return what a request gives as its token: in its address, or from then on as a cookie."""
        cookies = [one.strip().partition("=") for line in headers.get_all("Cookie") for one in line.split(";")]
        kept = [value for name, _, value in cookies if name == self._cookie]
        return kept + parse_qs(urlsplit(path).query).get("token", [])

    def _is_token(self, given: str) -> bool:
        if self.token is None:
            return False
        return hmac.compare_digest(given.encode("utf-8", "surrogateescape"), self.token.encode())

    @property
    def answer(self) -> dict[str, str]:
        """Headers of each answer: browsers keep the token, tell it nobody, and show no frame of it elsewhere."""
        frames = " ".join(("frame-ancestors 'self'", *self.origins))
        said = {"Content-Security-Policy": frames, "Referrer-Policy": "no-referrer"}
        if self.token is not None:
            said["Set-Cookie"] = f"{self._cookie}={self.token}; Path=/; HttpOnly; SameSite=Strict"
        return said


def _origin(given: Any) -> str:
    """Return an origin as browsers write it; raise ValueError if it is none."""
    if not isinstance(given, str) or not re.fullmatch(r"https?://([\w.-]+|\[[0-9a-fA-F:.]+\])(:\d{1,5})?", given):
        raise ValueError(
            f"allow_origin is {checks.repr_short(given)}; it must be scheme, host and port, such as https://lab.example:8443"
        )
    return given.lower()


def _address(name: str) -> Any:
    """Return the address that a name is; None if it is none."""
    try:
        return ipaddress.ip_address(name)
    except ValueError:
        return None


def _only_here(host: str) -> bool:
    address = _address(host)
    return host == "localhost" or (address is not None and address.is_loopback)
