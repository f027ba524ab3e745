"""The guard lets nobody in who must not: every route and both sockets, asked by everybody who could ask."""

import asyncio
import re
from functools import cache
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("fastapi", reason="the web process needs fastapi: servobus[server]")

from starlette.types import Message

from servobus.server.web.app import WebApplication
from servobus.server.web.auth import Role
from servobus.server.web.config import WebConfig
from servobus.server.web.headers import with_nonces
from servobus.server.web.rules import RULES, rule_for
from unit.server.web.rig import BASE, START, Rig, error_of, rig

HOST, COOKIE = "127.0.0.1:7380", "servobus_7380"
OPEN = {("GET", "/api/v1/health"), ("POST", "/api/v1/session")}
ANYBODY = {("POST", "/api/v1/stop"), ("POST", "/api/v1/buses/{bus}/stop"), ("DELETE", "/api/v1/session")}
ADMINS = ("/api/v1/tokens", "/api/v1/links", "/api/v1/sessions")
"""What a viewer may do beside reading, and what administrators alone may, as the issue and its sheet of rules say."""
SOCKETS = ("/api/v1/live", "/_nicegui_ws/socket.io/")


@cache
def routes() -> list[tuple[str, str]]:
    """List all routes of the API: method and path."""
    paths = WebApplication(WebConfig()).api.openapi()["paths"]
    return [(method.upper(), path) for path, item in paths.items() for method in item]


def filled(path: str) -> str:
    return re.sub(r"\{\w+\}", "x", path)


async def socket(made: Rig, path: str, headers: dict[str, str]) -> int:
    """Try to open a socket; give 101 if it was opened, else the status of the refusal."""
    sent: list[Message] = []
    queue: asyncio.Queue[Message] = asyncio.Queue()
    await queue.put({"type": "websocket.connect"})
    await queue.put({"type": "websocket.disconnect", "code": 1000})

    async def send(message: Message) -> None:
        sent.append(message)

    scope: dict[str, Any] = {
        "type": "websocket",
        "path": path,
        "raw_path": path.encode(),
        "query_string": b"",
        "root_path": "",
        "scheme": "ws",
        "headers": [(name.encode(), value.encode()) for name, value in headers.items()],
        "client": ("127.0.0.1", 1),
        "server": ("127.0.0.1", 7380),
        "subprotocols": [],
        "extensions": {"websocket.http.response": {}},
        "state": {},
    }
    await made.web.asgi(scope, queue.get, send)
    first = sent[0]
    return 101 if first["type"] == "websocket.accept" else int(first.get("status", 403))


def test_the_walk_finds_all_routes() -> None:
    assert len(routes()) > 40
    assert {*OPEN, *ANYBODY} <= set(routes())


def test_F27_every_route_refuses_who_has_not_logged_in() -> None:
    async def main() -> None:
        async with rig() as made:
            for headers in ({}, {"authorization": "Bearer wrong"}, {"authorization": "Basic eDp4"}):
                async with made.client(None, **headers) as client:
                    made.authority._lock_out._wrong.clear()
                    for number, (method, path) in enumerate(routes()):
                        if (method, path) in OPEN:
                            continue
                        answer = await client.request(method, filled(path))
                        expected = {401, 429} if headers and number >= 10 else {401}
                        assert answer.status_code in expected, (method, path)
                        error_of(answer)
            for path in SOCKETS:
                assert await socket(made, path, {"host": HOST, "origin": BASE}) == 401
                assert await socket(made, path, {"host": HOST}) == 401
                assert await socket(made, path, {"host": HOST, "authorization": "Bearer wrong"}) in (401, 429)

    asyncio.run(main())


def test_F27_every_route_refuses_another_host() -> None:
    async def main() -> None:
        async with rig() as made, made.client() as client:
            for host in ("evil.example:7380", "127.0.0.1:7381", "127.0.0.1", "", "127.0.0.1:7380.evil.example"):
                for method, path in routes():
                    answer = await client.request(method, filled(path), headers={"host": host})
                    assert answer.status_code == 421, (method, path, host)
                assert error_of(answer)["type"] == "WrongHost"
            bearer = f"Bearer {made.tokens[Role.ADMIN]}"
            for path in SOCKETS:
                assert await socket(made, path, {"host": "evil.example", "authorization": bearer}) == 421
                assert await socket(made, path, {"authorization": bearer}) == 421

    asyncio.run(main())


def test_F27_every_route_refuses_another_origin() -> None:
    async def main() -> None:
        async with rig() as made, made.client() as client:
            foreign = [
                {"origin": "http://evil.example"},
                {
                    "origin": "http://127.0.0.1:8000"
                },  # cookies do not tell ports apart: another program of this computer
                {"origin": "https://127.0.0.1:7380"},
                {"origin": "null"},
                {"sec-fetch-site": "cross-site"},
                {"sec-fetch-site": "same-site"},
            ]
            for headers in foreign:
                for method, path in routes():
                    answer = await client.request(method, filled(path), headers=headers)
                    assert answer.status_code == 403, (method, path, headers)
                assert error_of(answer)["type"] == "WrongOrigin"
                bearer = {"authorization": f"Bearer {made.tokens[Role.ADMIN]}"}
                for path in SOCKETS:
                    assert await socket(made, path, {"host": HOST, **bearer, **headers}) == 403

    asyncio.run(main())


def test_F27_a_cookie_alone_does_not_say_which_page_has_sent_a_request() -> None:
    async def main() -> None:
        async with rig() as made:
            secret, _ = await made.authority.exchange(START, "127.0.0.1")
            cookie = {"cookie": f"{COOKIE}={secret}"}
            async with made.client(None, **cookie) as client:
                assert (await client.get("/api/v1/buses")).status_code == 200
                assert (await client.post("/api/v1/buses/bench/resume")).status_code == 403
                assert (await client.post("/api/v1/buses/bench/resume", headers={"origin": BASE})).status_code == 200
                forged = {"content-type": "application/x-www-form-urlencoded", "sec-fetch-site": "same-site"}
                for origin in ("http://127.0.0.1:8000", "http://localhost:7380", "null"):
                    answer = await client.post("/api/v1/stop", content="a=b", headers={**forged, "origin": origin})
                    assert answer.status_code == 403
                link = {"sec-fetch-site": "cross-site", "sec-fetch-mode": "navigate", "sec-fetch-dest": "document"}
                assert (await client.get("/", headers=link)).status_code == 404  # let in; no page is mounted here
                framed = {**link, "sec-fetch-dest": "iframe"}
                assert (await client.get("/", headers=framed)).status_code == 403
                assert (await client.get("/api/v1/buses", headers=link)).status_code == 403
            assert await socket(made, "/api/v1/live", {"host": HOST, **cookie}) == 403
            assert await socket(made, "/api/v1/live", {"host": HOST, **cookie, "origin": BASE}) == 101
            assert (
                await socket(made, "/api/v1/live", {"host": HOST, "origin": BASE, "cookie": "servobus_7380=x"}) == 401
            )

    asyncio.run(main())


def test_every_route_asks_for_its_role() -> None:
    async def main() -> None:
        async with rig() as made:
            for role in (Role.VIEWER, Role.OPERATOR):
                async with made.client(role) as client:
                    for method, path in routes():
                        if (method, path) in OPEN:
                            continue
                        for_admins = path.startswith(ADMINS) or (method, path) == ("POST", "/api/v1/buses")
                        for_admins = for_admins or (method, path) == ("DELETE", "/api/v1/buses/{bus}")
                        reads = method == "GET" or (method, path) in ANYBODY
                        allowed = not for_admins and (reads or role is Role.OPERATOR)
                        made.web.asgi._rates._buckets.clear()
                        answer = await client.request(method, filled(path), content=b"")
                        refused = answer.status_code == 403
                        assert refused is not allowed, (role, method, path, answer.status_code)

    asyncio.run(main())


def test_what_is_read_only_moves_for_nobody_and_can_be_stopped() -> None:
    async def main() -> None:
        async with rig(read_only=True) as made, made.client(Role.ADMIN) as client:
            assert (await client.get("/api/v1/buses")).status_code == 200
            answer = await client.post("/api/v1/buses/bench/torque", json={"on": True})
            assert answer.status_code == 403
            assert "read-only" in error_of(answer)["message"]
            assert (await client.post("/api/v1/stop")).status_code == 200

    asyncio.run(main())


def test_what_no_rule_names_is_refused() -> None:
    assert rule_for("TRACE", "/api/v1/buses") is None
    assert rule_for("OPTIONS", "/api/v1/buses") is None
    assert rule_for("POST", "/somewhere") is None
    assert rule_for("WEBSOCKET", "/somewhere") is None
    assert rule_for("WEBSOCKET", "/api/v1/live2") is None
    assert rule_for("GET", "/api/v2/buses") is None
    assert [rule for rule in RULES if rule.role is None] == [
        rule_for("GET", "/api/v1/health"),
        rule_for("POST", "/api/v1/session"),
    ]

    async def main() -> None:
        async with rig() as made, made.client() as client:
            for method in ("OPTIONS", "TRACE", "PROPFIND"):
                assert (await client.request(method, "/api/v1/buses")).status_code == 405
            assert await socket(made, "/x", {"host": HOST, "authorization": f"Bearer {made.tokens[Role.ADMIN]}"}) != 101

    asyncio.run(main())


def test_headers_of_every_answer() -> None:
    async def main() -> None:
        async with rig() as made, made.client() as client:
            answers = [
                await client.get("/api/v1/buses", headers={"origin": BASE}),
                await client.get("/api/v1/none"),
                await client.get("/api/v1/buses", headers={"host": "evil"}),
                await client.get("/", headers={"accept": "text/html", "authorization": ""}),
            ]
            for answer in answers:
                headers = answer.headers
                assert headers["x-content-type-options"] == "nosniff"
                assert headers["referrer-policy"] == "no-referrer"
                assert headers["cache-control"] == "no-store"
                assert "default-src 'none'" in headers["content-security-policy"]
                assert "frame-ancestors 'none'" in headers["content-security-policy"]
                assert not [name for name in headers if name.startswith("access-control")]
                assert len(headers.get_list("content-security-policy")) == 1

    asyncio.run(main())


@pytest.mark.parametrize(
    ("path", "most"),
    [("/api/v1/buses/bench/scan", 64 << 10), ("/api/v1/buses/bench/servos/dynamixel:1@57600/restore", 1 << 20)],
)
def test_F27_a_long_body_is_not_read_to_its_end(path: str, most: int) -> None:
    async def main() -> None:
        async with rig() as made, made.client() as client:
            given = 0

            async def body() -> Any:
                nonlocal given
                for _ in range(10 * 1024):  # 10 MB in all, of an unknown length
                    given += 1024
                    yield bytes(1024)

            answer = await client.post(path, content=body(), headers={"content-type": "application/json"})
            assert answer.status_code == 413
            assert error_of(answer)["type"] == "TooLarge"
            assert answer.headers["connection"] == "close"

            told = await client.post(path, content=b"", headers={"content-length": f"{10 << 20}"})
            assert told.status_code == 413
            assert (await client.post(path, content=bytes(most + 1))).status_code == 413
            assert (await client.post(path, content=b" " * most)).status_code == 422

    asyncio.run(main())


def test_F27_a_long_message_of_a_socket_ends_it() -> None:
    async def main() -> None:
        async with rig() as made:
            sent: list[Message] = []
            queue: asyncio.Queue[Message] = asyncio.Queue()
            for message in (
                {"type": "websocket.connect"},
                {"type": "websocket.receive", "text": " " * (64 * 1024 + 1)},
            ):
                await queue.put(message)

            async def send(message: Message) -> None:
                sent.append(message)

            bearer = f"Bearer {made.tokens[Role.VIEWER]}"
            headers = [(b"host", HOST.encode()), (b"authorization", bearer.encode())]
            scope = {
                "type": "websocket", "path": "/api/v1/live", "query_string": b"", "headers": headers, "scheme": "ws",
                "client": ("127.0.0.1", 1), "server": ("127.0.0.1", 7380), "subprotocols": [], "state": {},
            }  # fmt: skip
            await made.web.asgi(scope, queue.get, send)
            assert sent[-1]["type"] == "websocket.close"
            assert sent[-1]["code"] == 1009

    asyncio.run(main())


def test_too_many_commands_a_second() -> None:
    async def main() -> None:
        async with rig(buses={}) as made, made.client(Role.OPERATOR) as client:
            made.authority.now = lambda: 1000.0  # time stands still
            answers = [await client.delete("/api/v1/jobs/x") for _ in range(51)]
            statuses = [answer.status_code for answer in answers]
            assert statuses[:50] == [404] * 50
            refused = answers[50]
            assert refused.status_code == 429
            assert error_of(refused)["type"] == "TooMany"
            assert int(refused.headers["retry-after"]) >= 1
            async with made.client(Role.VIEWER) as other:  # each login has its own
                assert (await other.get("/api/v1/buses")).status_code == 200
            assert all([(await client.post("/api/v1/stop")).status_code == 200 for _ in range(60)])

    asyncio.run(main())


def test_headers_of_others_are_believed_by_nobody() -> None:
    async def main() -> None:
        async with rig() as made, made.client(None) as client:
            answer = await client.get(
                "/api/v1/buses", headers={"x-forwarded-for": "127.0.0.1", "x-forwarded-host": HOST}
            )
            assert answer.status_code == 401
            assert (
                await client.get("/api/v1/buses", headers={"host": "evil", "x-forwarded-host": HOST})
            ).status_code == 421

    asyncio.run(main())


def test_no_secret_stands_in_an_answer_or_a_text() -> None:
    async def main() -> None:
        async with rig(password="scrypt:1:1:1:x:secrethash") as made:
            secrets = [*made.tokens.values(), START, "secrethash"]
            async with made.client() as client:
                answers = [await client.get(filled(path)) for method, path in routes() if method == "GET"]
            async with made.client(None) as client:
                answers.append(await client.get(f"/?token={START}", headers={"accept": "text/html"}))
                answers.append(await client.post("/api/v1/session", json={"token": 5, "password": "topsecret"}))
            said = " ".join(answer.text for answer in answers)
            said += f"{made.web.config!r} {made.authority!r} {made.authority.tokens()}"
            assert not [one for one in [*secrets, "topsecret"] if one in said]

    asyncio.run(main())


def test_scripts_of_a_page_get_the_nonce_of_its_policy_and_nothing_else_is_touched() -> None:
    page = b'<head><link rel="modulepreload" href="a.js"><link rel="stylesheet" href="b.css"></head><script>1</script>'
    marked = (
        b'<head><link nonce="N" rel="modulepreload" href="a.js"><link rel="stylesheet" href="b.css"></head>'
        b'<script nonce="N">1</script>'
    )

    async def sent(headers: list[tuple[bytes, bytes]]) -> list[Message]:
        messages: list[Message] = []

        async def send(message: Message) -> None:
            messages.append(message)

        outer = with_nonces(send, "N")
        await outer({"type": "http.response.start", "status": 200, "headers": headers})
        await outer({"type": "http.response.body", "body": page[:20], "more_body": True})
        await outer({"type": "http.response.body", "body": page[20:]})
        return messages

    start, body = asyncio.run(sent([(b"X-NiceGUI-Content", b"page"), (b"content-length", b"1")]))
    assert body["body"] == marked
    assert start["headers"][-1] == (b"content-length", b"%d" % len(marked))
    _, *parts = asyncio.run(sent([(b"content-type", b"text/html")]))
    assert b"".join(part["body"] for part in parts) == page


def test_names_of_the_server_with_their_port() -> None:
    config = WebConfig()
    for host in ("127.0.0.1:7380", "localhost:7380", "[::1]:7380"):
        assert config.goes_by(host, 7380)
    for host in ("127.0.0.1", "127.0.0.1:80", "192.168.0.2:7380", "evil.example:7380", "", ":7380", "[::1]", "::1"):
        assert not config.goes_by(host, 7380)
    assert config.goes_by("127.0.0.1", 80)
    lan = WebConfig(host="0.0.0.0", exposed=True, names=("robot.local",))
    for host in ("192.168.0.2:7380", "[fe80::1]:7380", "robot.local:7380"):
        assert lan.goes_by(host, 7380)
    assert not lan.goes_by("evil.example:7380", 7380)  # a name can be made to lead here
    assert WebConfig(host="0.0.0.0", certificate=Path("c"), key=Path("k"), password="x").goes_by("10.0.0.1", 443)
