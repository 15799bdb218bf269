"""Proxies and own addresses: whose headers count, and by which names the service may be called."""

from collections.abc import Callable
from contextlib import AbstractContextManager
from pathlib import Path
from typing import Any

import httpx
import pytest
from starlette.datastructures import Headers

from acquisition.models.errors import RigError
from api.rest import keys, settings
from api.rest.keys import Role
from api.rest.trusted_proxies import TrustedProxies

PROXY = "127.0.4.9"


def through_proxy(url: str, path: str, **headers: str) -> httpx.Response:
    """A POST as a TLS proxy at PROXY sends it for a page of https://lab.example."""
    sent = {"Host": "lab.example", "Origin": "https://lab.example", "X-Forwarded-Proto": "https", **headers}
    with httpx.Client(transport=httpx.HTTPTransport(local_address=PROXY), trust_env=False) as http:
        return http.post(f"{url}{path}", headers=sent, timeout=60)


def test_page_behind_trusted_tls_proxy_may_call_and_is_named(
    start: Callable[..., AbstractContextManager[Any]],
) -> None:
    with start(allowed_hosts=("lab.example",), trusted_proxies=(PROXY,)) as service:
        made = through_proxy(service.url, "/v1/tickets")
        stopped = through_proxy(service.url, "/v1/rig/stop", **{"X-Forwarded-For": "1.2.3.4, 192.0.2.7"})
        other_page = through_proxy(service.url, "/v1/tickets", Origin="http://lab.example")
        fault = service.client.safety().faults[0].detail

    assert (made.status_code, stopped.status_code) == (201, 202)
    assert other_page.json()["code"] == "request.foreign"
    assert "operator@192.0.2.7" in fault


def test_headers_of_proxy_that_is_not_trusted_do_not_count(
    start: Callable[..., AbstractContextManager[Any]],
) -> None:
    with start(allowed_hosts=("lab.example",)) as service:
        refused = through_proxy(service.url, "/v1/rig/stop")

    assert (refused.status_code, refused.json()["code"]) == (403, "request.foreign")
    assert "LIGHTPOSE_TRUSTED_PROXIES" in refused.json()["detail"]


def test_service_on_all_addresses_is_called_by_its_own(
    tmp_path: Path, cell_file: Path, serving: Callable[..., AbstractContextManager[Any]]
) -> None:
    secret = keys.add(keys.path_in(tmp_path / "data"), "somebody", Role.VIEWER)
    chosen = settings.read(cell=cell_file, data=tmp_path / "data", host="0.0.0.0", port=0)  # noqa: S104 - with keys
    with serving(chosen) as service:
        port = service.url.rpartition(":")[2]
        bearer = {"Authorization": f"Bearer {secret}"}
        stopped = httpx.post(f"http://127.0.4.2:{port}/v1/rig/stop", headers=bearer, trust_env=False)
        foreign = httpx.get(f"http://127.0.4.2:{port}/v1/rig", headers={**bearer, "Host": "192.0.2.1"}, trust_env=False)

    assert stopped.status_code == 202
    assert foreign.json()["code"] == "request.foreign"
    assert "LIGHTPOSE_ALLOWED_HOSTS" in foreign.json()["detail"]


def test_trusted_proxies_nearest_untrusted_address_is_the_caller() -> None:
    proxies = TrustedProxies(("10.0.0.0/8", "::1"))
    forwarded = Headers({"x-forwarded-for": "6.6.6.6, 192.0.2.7, 10.0.0.3", "x-forwarded-proto": "https"})
    assert proxies.caller("10.0.0.2", forwarded, "http") == ("192.0.2.7", "https")
    assert proxies.caller("192.0.2.9", forwarded, "https") == ("192.0.2.9", "https")
    assert proxies.caller("::1", Headers({}), "http") == ("::1", "http")


def test_settings_bad_proxy_is_refused(tmp_path: Path) -> None:
    with pytest.raises(RigError, match="LIGHTPOSE_TRUSTED_PROXIES"):
        settings.read(cell=tmp_path, trusted_proxies=("the proxy",))
