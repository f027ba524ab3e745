"""Who gets in: links, cookies, tokens and passwords."""

import asyncio
import stat
from base64 import b64encode
from hashlib import scrypt
from pathlib import Path

import pytest

pytest.importorskip("fastapi", reason="the web process needs fastapi: servobus[server]")

from servobus.errors import UnknownName, UsageError
from servobus.server.web.auth import (
    LOCKED,
    SESSION_TIME,
    TRIES,
    Authority,
    LockOut,
    LoginRefused,
    Role,
    check_password,
    hash_password,
)
from servobus.server.web.config import WebConfig, parse
from unit.server.web.rig import BASE, START, error_of, rig

SALT = b"salt"
CHEAP = (
    f"scrypt:16:1:1:{b64encode(SALT).decode()}:"
    + b64encode(scrypt(b"correct horse", salt=SALT, n=16, r=1, p=1)).decode()
)
"""What is kept of "correct horse", at a cost that no test waits for."""


class Clock:
    def __init__(self) -> None:
        self.time = 1000.0

    def __call__(self) -> float:
        return self.time


def test_the_link_is_exchanged_for_a_cookie_once() -> None:
    async def main() -> None:
        async with rig() as made, made.client(None, accept="text/html") as client:
            page = await client.get(f"/?token={START}")
            assert page.status_code == 401
            assert page.headers["content-type"].startswith("text/html")
            assert START not in page.text
            nonce = page.headers["content-security-policy"].partition("'nonce-")[2].partition("'")[0]
            assert f'<script nonce="{nonce}">' in page.text

            answer = await client.post("/api/v1/session", json={"token": START}, headers={"origin": BASE})
            assert answer.status_code == 200
            cookie = answer.headers["set-cookie"]
            assert cookie.startswith("servobus_7380=")
            assert {"HttpOnly", "SameSite=strict", "Path=/", "Max-Age=43200"} <= set(cookie.split("; "))
            assert "Domain" not in cookie

            async with made.client(None) as other:  # another browser
                again = await other.post("/api/v1/session", json={"token": START}, headers={"origin": BASE})
                assert again.status_code == 401
                assert "used already" in error_of(again)["message"]

    asyncio.run(main())


def test_the_same_link_opened_again_in_the_same_browser_leads_on() -> None:
    async def main() -> None:
        async with rig() as made, made.client(None, accept="text/html") as client:
            await client.post("/api/v1/session", json={"token": START}, headers={"origin": BASE})
            # Typed, or opened by a program: the cookie comes along.
            again = await client.get(f"/?token={START}")
            assert (again.status_code, again.headers["location"]) == (303, "/")
            # From a page elsewhere it does not, and the page that is given then asks by its script.
            answer = await client.post("/api/v1/session", json={"token": START}, headers={"origin": BASE})
            assert answer.status_code == 200
            assert "set-cookie" not in answer.headers
            for path in ("//evil.example/", "/\\evil.example"):
                moved = await client.get(f"{BASE}{path}?token=x")
                assert moved.headers["location"].startswith("/")
                assert not moved.headers["location"].startswith(("//", "/\\"))
            assert (await client.get(f"{BASE}/a%0d%0aSet-Cookie:%20x=y?token=x")).status_code == 404

    asyncio.run(main())


def test_a_session_ends_by_time_by_logging_out_and_with_its_sockets() -> None:
    async def main() -> None:
        clock = Clock()
        authority = Authority(start_token="s", now=clock)
        secret, login = await authority.exchange("s", "p")
        ended: list[str] = []
        login.watch(ended.append)
        clock.time += SESSION_TIME - 1
        assert authority.by_cookie(secret) is login
        clock.time += 1
        assert authority.by_cookie(secret) is None
        assert len(ended) == 1

        secret, login = await authority.exchange(authority.make_link(Role.VIEWER), "p")
        assert login.role is Role.VIEWER
        login.watch(ended.append)
        authority.log_out(login)
        assert authority.by_cookie(secret) is None
        assert ended[1:] == ["logged out"]
        assert authority.by_cookie("") is None

    asyncio.run(main())


def test_links_are_good_for_some_minutes_and_are_few() -> None:
    async def main() -> None:
        clock = Clock()
        authority = Authority(now=clock)
        old = authority.make_link(Role.ADMIN)
        clock.time += 600
        with pytest.raises(LoginRefused, match="too old"):
            await authority.exchange(old, "p")
        first = authority.make_link(Role.ADMIN)
        for _ in range(16):
            authority.make_link(Role.ADMIN)
        with pytest.raises(LoginRefused):
            await authority.exchange(first, "p")

    asyncio.run(main())


def test_named_tokens_last_hashed_in_a_file_for_their_owner_alone(tmp_path: Path) -> None:
    file = tmp_path / "folder" / "tokens.json"
    authority = Authority(tokens_file=file)
    token = authority.make_token("arm", Role.OPERATOR)
    assert stat.S_IMODE(file.stat().st_mode) == 0o600
    assert token not in file.read_text()
    again = Authority(tokens_file=file)
    login = again.by_bearer(token, "p")
    assert (login.name, login.role) == ("arm", Role.OPERATOR)
    with pytest.raises(UsageError, match="already"):
        again.make_token("arm", Role.VIEWER)
    ended: list[str] = []
    login.watch(ended.append)
    again.drop_token("arm")
    assert len(ended) == 1
    with pytest.raises(LoginRefused):
        again.by_bearer(token, "p")
    with pytest.raises(UnknownName):
        again.drop_token("arm")
    with pytest.raises(LoginRefused):
        Authority(tokens_file=file).by_bearer(token, "p")

    file.chmod(0o644)
    with pytest.raises(UsageError, match="chmod 600"):
        Authority(tokens_file=file)
    file.chmod(0o600)
    file.write_text("nonsense")
    with pytest.raises(UsageError, match="no file of tokens"):
        Authority(tokens_file=file)


def test_passwords_are_kept_as_a_salted_hash() -> None:
    kept = hash_password("correct horse")
    assert "correct" not in kept
    assert kept != hash_password("correct horse")
    assert check_password("correct horse", kept)
    assert not check_password("correct horsf", kept)
    assert not check_password("x" * 5000, kept)
    with pytest.raises(UsageError):
        hash_password("short")


def test_a_peer_is_locked_out_after_wrong_passwords_and_others_are_not() -> None:
    async def main() -> None:
        clock = Clock()
        authority = Authority(password=CHEAP, local_token="t", now=clock)
        for _ in range(TRIES):
            with pytest.raises(LoginRefused, match="wrong"):
                await authority.log_in("nonsense", "10.0.0.1")
        with pytest.raises(LoginRefused, match="too many") as refused:
            await authority.log_in("correct horse", "10.0.0.1")
        assert 0 < refused.value.wait <= LOCKED
        assert (await authority.log_in("correct horse", "10.0.0.2"))[1].role is Role.ADMIN
        assert authority.by_bearer("t", "10.0.0.1").name == "local"  # nobody guesses a token
        clock.time += LOCKED + 1
        await authority.log_in("correct horse", "10.0.0.1")

    asyncio.run(main())


def test_one_computer_is_one_peer_under_ipv6() -> None:
    clock = Clock()
    lock_out = LockOut(clock)
    for n in range(TRIES):
        lock_out.failed(f"fe80::1:{n}%eth0")
    assert lock_out.wait("fe80::2:1") > 0
    assert lock_out.wait("fe80:0:0:1::1") == 0


def test_logging_in_by_password_and_what_needs_a_fresh_login() -> None:
    async def main() -> None:
        async with rig(password=CHEAP, host="192.0.2.1", names=("127.0.0.1",), exposed=True) as made:
            clock = Clock()
            made.authority.now = clock
            async with made.client(None, origin=BASE) as client:
                wrong = await client.post("/api/v1/session", json={"password": "nonsense"})
                assert wrong.status_code == 401
                both = await client.post("/api/v1/session", json={"password": "x", "token": "y"})
                assert both.status_code == 422
                assert (await client.post("/api/v1/session", json={"password": "correct horse"})).status_code == 200
                identity, same = "/api/v1/buses/bench/servos/dynamixel:1@57600/identity", {"id": 1}
                assert (await client.post(identity, json=same)).status_code == 200
                clock.time += 301
                refused = await client.post(identity, json=same)
                assert (refused.status_code, error_of(refused)["type"]) == (401, "LoginTooOld")
                assert (await client.post("/api/v1/stop")).status_code == 200
                await client.post("/api/v1/session", json={"password": "correct horse"})
                assert (await client.post(identity, json=same)).status_code == 200
                assert (await client.get("/api/v1/server")).json()["warning"]
                assert (await client.delete("/api/v1/session")).status_code == 200
                assert (await client.get("/api/v1/server")).status_code == 401

    asyncio.run(main())


def test_tokens_and_links_by_the_api() -> None:
    async def main() -> None:
        async with rig() as made, made.client(Role.ADMIN) as client:
            made_token = await client.post("/api/v1/tokens", json={"name": "arm", "role": "viewer"})
            token = made_token.json()["token"]
            listed = (await client.get("/api/v1/tokens")).json()
            assert {"arm"} <= {one["name"] for one in listed}
            async with made.client(None, authorization=f"Bearer {token}") as arm:
                assert (await arm.get("/api/v1/server")).json()["you"]["name"] == "arm"
                assert (await client.delete("/api/v1/tokens/arm")).status_code == 200
                assert (await arm.get("/api/v1/server")).status_code == 401
            url = (await client.post("/api/v1/links", json={"role": "viewer"})).json()["url"]
            assert url.startswith(f"{BASE}/?token=")
            async with made.client(None, origin=BASE) as phone:
                answer = await phone.post("/api/v1/session", json={"token": url.partition("=")[2]})
                assert answer.json()["role"] == "viewer"
                sessions = (await client.get("/api/v1/sessions")).json()
                assert (await client.delete(f"/api/v1/sessions/{sessions[0]['id']}")).status_code == 200
                assert (await phone.get("/api/v1/server")).status_code == 401

    asyncio.run(main())


def test_other_addresses_need_tls_and_a_password_or_a_flag() -> None:
    kept = "scrypt:1:1:1:x:y"
    for host in ("0.0.0.0", "192.0.2.1", "::", "robot.local"):
        with pytest.raises(UsageError, match="other computers"):
            WebConfig(host=host).check()
        with pytest.raises(UsageError, match="other computers"):
            WebConfig(host=host, password=kept).check()
        WebConfig(host=host, password=kept, certificate=Path("c"), key=Path("k")).check()
        WebConfig(host=host, exposed=True).check()
        assert WebConfig(host=host, exposed=True).warning
    for host in ("127.0.0.1", "::1", "localhost"):
        WebConfig(host=host).check()
        assert not WebConfig(host=host).warning
    with pytest.raises(UsageError, match="both"):
        WebConfig(certificate=Path("c")).check()


def test_what_the_process_is_told_repeats_no_secret() -> None:
    assert parse('{"port": 0, "names": ["a"], "audit": "/x"}').names == ("a",)
    for line in ("", "nonsense hidden", "[]", '{"hidden": 1}', '{"host": "0.0.0.0", "start_token": "hidden"}'):
        with pytest.raises(UsageError) as error:
            parse(line)
        assert "hidden" not in str(error.value) or "hidden" in line.partition(":")[0]
