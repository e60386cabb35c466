"""Any JSON sent to the API is answered, never with an internal error, and the server goes on."""

from __future__ import annotations

import json

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

NAMES = st.sampled_from([
    *("state", "scene", "lens", "sensor", "capture", "source", "changes", "options", "view", "regions", "tab", "rows"),
    *("cols", "exposure_s", "seed", "f_number", "illuminant", "read_noise_e", "pixel", "noise", "effects", "cfa"),
    *("telegraph_noise", "bits", "height", "width", "row", "sensors", "wants", "suffix", "kind", "", "x", "channels"),
])  # fmt: skip
LEAVES = st.one_of(
    st.none(), st.booleans(), st.integers(), st.floats(), st.text(max_size=8),
    st.sampled_from(["macbeth", "nikon-d200", "A", "file:x", "upload:x", 10**400, -1, 1e308, "1e999", "\ud800"]),
)  # fmt: skip
JSON = st.recursive(
    LEAVES, lambda inner: st.lists(inner, max_size=3) | st.dictionaries(NAMES, inner, max_size=4), max_leaves=12
)
PATHS = ("/api/view", "/api/form", "/api/code", "/api/comparison/code", "/api/validation/code", "/api/plan/code")

STATE = {"scene": {"source": "uniform"}, "lens": {}, "sensor": {"changes": {"rows": 8, "cols": 8}}, "capture": {}}


def text_of(content: object) -> bytes:
    return json.dumps(content).encode("utf-8", "surrogatepass")


@settings(max_examples=80, deadline=None, derandomize=True, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(path=st.sampled_from(PATHS), content=JSON)
def test_any_json_is_answered(client, path: str, content: object) -> None:
    answer = client.post(path, content=text_of(content), headers={"Content-Type": "application/json"})
    assert answer.status_code < 500, answer.text


@settings(
    max_examples=120, deadline=None, derandomize=True, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
@given(
    part=st.sampled_from(["scene", "lens", "sensor", "capture", "changes", "options"]),
    name=NAMES | st.text(max_size=6),
    value=JSON,
)
def test_any_value_of_a_state_is_answered(client, part: str, name: str, value: object) -> None:
    state = json.loads(json.dumps(STATE))
    if part in ("changes", "options"):
        state["sensor" if part == "changes" else "scene"].setdefault(part, {})[name] = value
    else:
        state[part][name] = value
    content = text_of({"state": state, "view": {"height": 16, "width": 16}})
    answer = client.post("/api/view", content=content, headers={"Content-Type": "application/json"})
    assert answer.status_code < 500, answer.text


@pytest.mark.parametrize(
    "content", [b"", b"{", b"[" * 100_000, b"\xff\xfe", b"null", b'{"state": NaN}', b'"' + b"a" * 99_999 + b'"']
)
def test_malformed_bodies_are_refused(client, content: bytes) -> None:
    for path in ("/api/view", "/api/form"):
        answer = client.post(path, content=content, headers={"Content-Type": "application/json"})
        assert 400 <= answer.status_code < 500
        assert answer.json()["error"]
    assert client.get("/api/server").status_code == 200


def test_unknown_paths_methods_and_jobs_are_refused(client) -> None:
    for method, path in (
        ("GET", "/api/jobs/x"),
        ("DELETE", "/api/jobs/" + "y" * 3000),
        ("PUT", "/api/view"),
        ("GET", "/..%2f..%2fetc/passwd"),
        ("GET", "/static/app.css"),
    ):
        assert 400 <= client.request(method, path).status_code < 500, path


@pytest.mark.parametrize("depth", [300, 5000])
@pytest.mark.parametrize("path", PATHS)
def test_deeply_nested_changes_are_a_bad_request(client, path: str, depth: int) -> None:
    nested = b'{"a":' * depth + b"1" + b"}" * depth
    sensor = b'{"changes": {"pixel": ' + nested + b"}}"
    part = b'"sensor": ' + sensor
    body = {"view": b'{"state": {%s}}', "comparison": b'{"cameras": [{%s}]}'}
    content = next((form for key, form in body.items() if key in path), b"{%s}") % part
    answer = client.post(path, content=content, headers={"Content-Type": "application/json"})
    assert answer.status_code == 400
    assert answer.json()["error"]
