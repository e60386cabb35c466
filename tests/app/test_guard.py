"""Who is let in, and what every answer carries."""

from __future__ import annotations

import pytest

TOKEN = "the-key-of-the-tests"
BASE = "http://127.0.0.1:8123"
KEY = {"Authorization": f"Bearer {TOKEN}"}


def test_without_the_key_nothing_but_the_way_in_is_served(stranger) -> None:
    for path in (
        "/",
        "/app.css",
        "/main.js",
        "/openapi.json",
        "/api/server",
        "/api/files",
        "/nothing",
        "/?token=wrong",
    ):
        assert stranger.get(path).status_code == 401, path
    assert stranger.post("/api/form", json={}, headers={"Origin": BASE}).status_code == 401


def test_the_link_gives_a_cookie_that_scripts_and_other_sites_cannot_use(stranger) -> None:
    entered = stranger.get(f"/?token={TOKEN}")
    cookie = entered.headers["set-cookie"]
    assert entered.status_code == 200
    assert TOKEN not in cookie
    assert {"HttpOnly", "SameSite=Strict", "Path=/"} <= {part.strip() for part in cookie.split(";")}
    assert stranger.get("/").status_code == 200  # the client keeps the cookie
    assert stranger.get("/api/server").json()["version"]


@pytest.mark.parametrize(
    ("headers", "status"),
    [
        ({"Host": "evil.example:8123"}, 421),  # DNS rebinding
        ({"Host": "127.0.0.1:8124"}, 421),
        ({"Host": "127.0.0.1"}, 421),
        ({"Host": "localhost:8123"}, 200),
        ({"Origin": "http://evil.example"}, 403),
        ({"Origin": "null"}, 403),
        ({"Origin": "https://127.0.0.1:8123"}, 403),
        ({"Origin": BASE}, 200),
        ({"Sec-Fetch-Site": "cross-site"}, 403),
        ({"Sec-Fetch-Site": "same-site"}, 403),
        ({"Sec-Fetch-Site": "same-origin"}, 200),
        ({"Authorization": "Bearer wrong"}, 401),
        ({"Authorization": "Basic " + TOKEN}, 401),
    ],
)
def test_host_origin_and_key_are_checked(stranger, headers: dict[str, str], status: int) -> None:
    assert stranger.get("/api/server", headers=KEY | headers).status_code == status


def test_a_cookie_alone_does_not_let_another_page_change_anything(stranger) -> None:
    stranger.get(f"/?token={TOKEN}")
    assert stranger.post("/api/form", json={}).status_code == 403  # no Origin, no key
    assert stranger.post("/api/form", json={}, headers={"Origin": "http://evil.example"}).status_code == 403
    assert stranger.post("/api/form", json={}, headers={"Origin": BASE}).status_code == 200


def test_a_link_on_another_page_opens_the_page_and_nothing_else(stranger) -> None:
    outside = {"Sec-Fetch-Site": "cross-site", "Sec-Fetch-Mode": "navigate"}
    assert stranger.get(f"/?token={TOKEN}", headers=outside).status_code == 200
    assert stranger.get("/api/server", headers=KEY | outside).status_code == 403


@pytest.mark.parametrize("path", ["/", "/app.css", "/main.js", "/api/server", "/api/nothing", "/openapi.json"])
def test_every_answer_carries_the_security_headers(client, path: str) -> None:
    headers = client.get(path).headers
    policy = headers["content-security-policy"]
    assert "default-src 'none'" in policy
    assert "unsafe" not in policy
    assert "http" not in policy
    assert headers["x-content-type-options"] == "nosniff"
    assert headers["referrer-policy"] == "no-referrer"
    assert headers["cross-origin-resource-policy"] == "same-origin"


def test_requests_larger_than_the_limit_are_refused(client) -> None:
    assert client.post("/api/form", content=b" " * ((1 << 20) + 1)).status_code == 413

    def chunks():
        for _ in range(40):
            yield b" " * (1 << 16)

    assert client.post("/api/form", content=chunks()).status_code == 413  # without Content-Length
    assert client.post("/api/form", content=b"{}", headers={"Content-Length": "-3"}).status_code in (400, 413)


def test_the_page_loads_nothing_from_elsewhere_and_has_no_inline_script_or_style(client) -> None:
    import re

    text = client.get("/").text
    assert not re.search(r"""(?:src|href)=["'](?:https?:)?//""", text)
    assert not re.search(r"<style|style=|\son\w+=|<script(?![^>]*src=)", text)
    for name in re.findall(r'(?:src|href)="(/[\w.-]+)"', text):
        assert client.get(name).status_code == 200, name


def test_the_api_is_described(client) -> None:
    paths = client.get("/openapi.json").json()["paths"]
    described = [operation.get("summary") for methods in paths.values() for operation in methods.values()]
    assert {"/api/view", "/api/frames", "/api/jobs/{job_id}", "/api/uploads", "/api/comparison"} <= set(paths)
    assert all(described)
