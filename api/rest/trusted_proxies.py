"""Proxies in front of the service: the caller's address and scheme, as reported by proxies that the settings trust.

A proxy that ends TLS calls the service by plain HTTP from its own address. A page of the service would then look like a
foreign one, and all callers would look alike in the record. The proxy reports the original request in X-Forwarded-Proto
and X-Forwarded-For. Anybody can write these headers, so they count only from the addresses that the settings name.
"""

import ipaddress
from collections.abc import Iterable

from starlette.datastructures import Headers
from starlette.types import ASGIApp, Receive, Scope, Send


class TrustedProxies:
    """The addresses and networks of proxies whose headers count."""

    def __init__(self, names: Iterable[str]) -> None:
        """Raises ValueError for a name that is neither an address nor a network."""
        self._networks = [ipaddress.ip_network(name, strict=False) for name in names]

    def caller(self, peer: str, headers: Headers, own_scheme: str) -> tuple[str, str]:
        """Returns the caller's address and the scheme of its request, for a connection by `own_scheme`."""
        if not self._trusts(peer):
            return peer, own_scheme
        scheme = headers.get("x-forwarded-proto", own_scheme).strip().lower()
        passed = [name.strip() for name in ",".join(headers.getlist("x-forwarded-for")).split(",") if name.strip()]
        untrusted = [name for name in passed if not self._trusts(name)]
        return (untrusted[-1][:100] if untrusted else peer), ("https" if scheme == "https" else "http")

    def _trusts(self, name: str) -> bool:
        try:
            address = ipaddress.ip_address(name)
        except ValueError:
            return False
        return any(address in network for network in self._networks)


class ForwardedCaller:
    """ASGI middleware that replaces the address and scheme of a trusted proxy by those of its caller."""

    def __init__(self, app: ASGIApp, proxies: TrustedProxies) -> None:
        self._app = app
        self._proxies = proxies

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Handles one request."""
        if scope["type"] == "http" and scope.get("client"):
            host, scheme = self._proxies.caller(scope["client"][0], Headers(scope=scope), scope["scheme"])
            scope = {**scope, "client": (host, scope["client"][1]), "scheme": scheme}
        await self._app(scope, receive, send)
