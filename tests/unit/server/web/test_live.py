"""The live connection over real sockets: telemetry, events, the heartbeat, and clients that behave badly."""

import asyncio
import contextlib
import json
import socket
from collections.abc import AsyncIterator
from typing import Any

import pytest

pytest.importorskip("fastapi", reason="the web process needs fastapi: servobus[server]")

import uvicorn
from websockets.asyncio.client import ClientConnection, connect
from websockets.exceptions import ConnectionClosed, InvalidStatus

from servobus.server.web.__main__ import server_settings
from servobus.server.web.auth import Role
from servobus.server.web.feeds import MOST_FEEDS, MOST_WAITING, Events, Feed
from unit.server.web.rig import KEYS, REAL, Rig, rig

RX, RX2, _, LX = KEYS
PATIENCE = 30.0
"""s; a limit against hanging, and never a measurement."""


class Served(Rig):
    """A rig that listens on a port of this computer."""

    port = 0

    def connect(self, role: Role = Role.OPERATOR, path: str = "/api/v1/live", **headers: str) -> connect:
        bearer = {"authorization": f"Bearer {self.tokens[role]}"}
        return connect(f"ws://127.0.0.1:{self.port}{path}", additional_headers={**bearer, **headers}, compression=None)


@contextlib.asynccontextmanager
async def served(**changes: Any) -> AsyncIterator[Served]:
    async with rig(**{"buses": {"bench": REAL}, **changes}) as made:
        listener = socket.create_server(("127.0.0.1", 0))
        made.__class__ = Served
        assert isinstance(made, Served)
        made.port = listener.getsockname()[1]
        made.web.listens(made.port)
        settings = server_settings(made.web)
        settings.lifespan = "off"  # the rig has opened everything already
        server = uvicorn.Server(settings)
        server.install_signal_handlers = lambda: None  # type: ignore[attr-defined]
        task = asyncio.ensure_future(server._serve([listener]))
        while not server.started:  # noqa: ASYNC110 - uvicorn tells nobody
            await asyncio.sleep(0.001)
        try:
            yield made
        finally:
            server.should_exit = True
            await task
            listener.close()


async def said(client: ClientConnection, kind: str, **more: Any) -> dict[str, Any]:
    """Wait for a message of a kind."""
    async with asyncio.timeout(PATIENCE):
        while True:
            message: dict[str, Any] = json.loads(await client.recv())
            if message["k"] == kind and more.items() <= message.items():
                return message


async def ask(client: ClientConnection, **message: Any) -> dict[str, Any]:
    """Send something, and wait for the answer."""
    await client.send(json.dumps({"n": 1, **message}))
    async with asyncio.timeout(PATIENCE):
        while True:
            answer: dict[str, Any] = json.loads(await client.recv())
            if answer["k"] in ("ok", "error", "beat") and answer["n"] == 1:
                return answer


async def settle(client: ClientConnection) -> tuple[int, str]:
    """Wait for the end of a connection; give its code and its reason."""
    async with asyncio.timeout(PATIENCE):
        with pytest.raises(ConnectionClosed) as closed:
            while True:
                await client.recv()
    assert closed.value.rcvd is not None
    return closed.value.rcvd.code, closed.value.rcvd.reason


def test_telemetry_is_what_the_client_has_chosen() -> None:
    async def main() -> None:
        async with served() as made, made.connect(Role.VIEWER) as client:
            welcome = await said(client, "welcome")
            assert (welcome["name"], welcome["role"]) == ("viewer of the test", "viewer")
            wanted = {RX: ["present_position", "led"], "219": ["present_voltage"]}
            assert (await ask(client, k="subscribe", bus="bench", servos=wanted, period=0.01))["k"] == "ok"
            sample = await said(client, "telemetry")
            assert set(sample["servos"]) == {RX, KEYS[2]}
            assert sample["servos"][RX]["values"]["present_position"] == pytest.approx(2.6, abs=0.1)  # 150 degrees
            assert sample["servos"][RX]["values"]["led"] is False
            assert sample["servos"][RX]["alarms"] == []
            later = await said(client, "telemetry")
            assert later["t"] > sample["t"]
            # A new subscription takes the place of the old one.
            await ask(client, k="subscribe", bus="bench", period=0.02)
            while set((await said(client, "telemetry"))["servos"]) != set(KEYS):
                pass
            await ask(client, k="unsubscribe", bus="bench")
            wrong: dict[str, dict[str, Any]] = {
                "UnknownName": {"k": "subscribe", "bus": "bench", "servos": {"99": []}, "period": 1.0},
                "BadValue": {"k": "subscribe", "bus": "bench", "period": 0.0},
                "BadRequest": {"k": "subscribe", "bus": "bench", "period": "x"},
            }
            for kind, message in wrong.items():
                assert (await ask(client, **message))["error"]["type"] == kind

    asyncio.run(main())


def test_a_servo_that_is_lost_is_told_and_so_is_one_that_is_back() -> None:
    async def main() -> None:
        async with served() as made, made.connect() as client:
            bus = made.service.bus("bench").bus
            bus.attach("rx28", 50)
            await ask(client, k="subscribe", bus="bench", servos={"50": ["led"]}, period=0.01)
            assert (await said(client, "telemetry"))["servos"]["dynamixel:50@57600"]["values"] is None
            assert (await said(client, "event", what="lost"))["servo"] == "dynamixel:50@57600"
            async with made.client(Role.OPERATOR) as api:
                api.base_url = f"http://127.0.0.1:{made.port}"
                await api.post(f"/api/v1/buses/bench/servos/{RX2}/identity", json={"id": 50})
            await said(client, "event", what="appeared")

    asyncio.run(main())


def test_who_is_silent_while_he_drives_stops_his_servos_and_no_others() -> None:
    async def main() -> None:
        async with served() as made, made.connect() as mine, made.connect() as other:
            bench = made.service.bus("bench")
            await bench.bus.torque_on()
            for client in (mine, other):
                await said(client, "welcome")
            time = (await ask(other, k="beat"))["time"]
            assert (await ask(other, k="hold", deadman=5.0))["k"] == "ok"
            drive = {"k": "drive", "bus": "bench", "time": 0.5, "seq": 1}
            assert (await ask(other, **drive, goals={RX2: 2.0}, sent=time))["k"] == "ok"
            early = await ask(mine, **drive, goals={RX: 2.0}, sent=time)
            assert "send `hold`" in early["error"]["message"]
            await ask(mine, k="hold", deadman=0.1)
            now = (await ask(mine, k="beat"))["time"]
            assert (await ask(mine, **drive, goals={RX: 2.0}, sent=now))["k"] == "ok"
            event = await said(other, "event", what="deadman")
            assert (event["servos"], event["failed"]) == ([RX], None)
            assert bench.servo(RX2).permit.driven
            assert not bench.servo(RX).permit.driven
            late = await ask(mine, **{**drive, "seq": 2}, goals={RX: 2.0}, sent=now)
            assert late["error"]["type"] == "Stopped"

    asyncio.run(main())


def test_F28_a_servo_has_one_holder_and_others_are_told_who_that_is() -> None:
    async def main() -> None:
        async with served() as made, made.connect() as mine, made.connect() as other:
            bench = made.service.bus("bench")
            await bench.bus.torque_on()
            connection = (await said(other, "welcome"))["connection"]
            for client in (mine, other):
                await ask(client, k="hold", deadman=5.0)
            now = (await ask(mine, k="beat"))["time"]
            drive = {"k": "drive", "bus": "bench", "time": 0.5, "goals": {RX: 2.0}, "sent": now}
            assert (await ask(mine, **drive, seq=1))["k"] == "ok"
            refused = (await ask(other, **drive, seq=1))["error"]
            assert (refused["type"], "operator of the test" in refused["message"]) == ("Held", True)
            async with made.client(Role.OPERATOR) as api:
                api.base_url = f"http://127.0.0.1:{made.port}"
                path, body = "/api/v1/buses/bench", {"servos": [RX]}
                assert (await api.get(f"{path}/servos/{RX}")).json()["holder"] == "operator of the test"
                assert (await api.post(f"{path}/moves", json={"goals": {RX: 1.0}})).status_code == 409
                assert (await api.post(f"{path}/moves", json={"goals": {RX2: 1.0}})).status_code == 202
                assert (await api.post(f"{path}/take", json=body)).status_code == 409  # nobody would be watched
                taken = await api.post(f"{path}/take", json=body, headers={"servobus-connection": connection})
                assert taken.json()[0]["driven"] is False  # it was made safe
            assert (await said(mine, "event", what="taken over"))["servos"] == [RX]
            assert (await ask(mine, **drive, seq=2))["error"]["type"] == "Held"
            assert (await ask(other, **drive, seq=2))["k"] == "ok"
            await ask(mine, k="stop", bus="bench")
            assert bench._holders.of("bench", RX) is None

    asyncio.run(main())


def test_who_goes_away_stops_his_servos() -> None:
    async def main() -> None:
        async with served() as made, made.connect() as other:
            bench = made.service.bus("bench")
            await bench.bus.torque_on()
            async with made.connect() as mine:
                connection = (await said(mine, "welcome"))["connection"]
                await ask(mine, k="hold", deadman=5.0)
                async with made.client(Role.OPERATOR) as api:
                    api.base_url = f"http://127.0.0.1:{made.port}"
                    turn = await api.post(
                        f"/api/v1/buses/bench/servos/{LX}/turn",
                        json={"output": 0.5},
                        headers={"servobus-connection": connection},
                    )
                    assert turn.status_code == 200, turn.text
                async with made.client(Role.ADMIN) as api:  # another login has no part in this connection
                    api.base_url = f"http://127.0.0.1:{made.port}"
                    stolen = await api.post(
                        f"/api/v1/buses/bench/servos/{LX}/turn",
                        json={"output": 0.5},
                        headers={"servobus-connection": connection},
                    )
                    assert stolen.status_code == 404
            assert (await said(other, "event", what="deadman"))["servos"] == [LX]

    asyncio.run(main())


def test_old_and_repeated_commands_are_refused() -> None:
    async def main() -> None:
        async with served() as made, made.connect() as client:
            await made.service.bus("bench").bus.torque_on()
            await ask(client, k="hold", deadman=5.0)
            now = (await ask(client, k="beat"))["time"]
            drive = {"k": "drive", "bus": "bench", "time": 0.5, "goals": {RX: 2.0}}
            old = await ask(client, **drive, seq=5, sent=now - 1.0)
            assert "too old" in old["error"]["message"]
            assert (await ask(client, **drive, seq=6, sent=now))["k"] == "ok"
            again = await ask(client, **drive, seq=6, sent=now)
            assert "came after" in again["error"]["message"]
            assert (await ask(client, **drive, seq=7, sent=now + 10.0))["k"] == "error"

    asyncio.run(main())


def test_a_viewer_stops_and_drives_nothing() -> None:
    async def main() -> None:
        async with served() as made, made.connect(Role.VIEWER) as client, made.connect() as other:
            for message in (
                {"k": "hold", "deadman": 1.0},
                {"k": "drive", "bus": "bench", "goals": {RX: 1.0}, "time": 1.0, "seq": 1, "sent": 0.0},
            ):
                assert (await ask(client, **message))["error"]["type"] == "RoleTooLow"
            assert set((await ask(client, k="stop"))["stopped"]["bench"]) == set(KEYS)
            assert (await said(other, "event", what="stopped"))["by"] == "viewer of the test"

    asyncio.run(main())


def test_messages_that_make_no_sense_end_nothing() -> None:
    async def main() -> None:
        async with served() as made, made.connect() as client:
            for text in ("", "{", "[]", "5", "null", '{"k": "nonsense"}', '{"k": 5, "n": []}', '{"k": "beat", "x": 1}'):
                await client.send(text)
                assert (await said(client, "error"))["error"]["type"] == "BadRequest"
            await client.send("[" * 50_000)
            assert (await said(client, "error"))["error"]["type"] == "BadRequest"
            assert (await ask(client, k="beat"))["k"] == "beat"
            await client.send(b"\x00")
            assert (await settle(client))[0] == 1008

    asyncio.run(main())


def test_F27_ten_megabytes_and_a_flood_end_the_connection_that_sent_them() -> None:
    async def main() -> None:
        async with served() as made, made.connect() as other:
            async with made.connect() as client:
                with contextlib.suppress(ConnectionClosed):
                    await client.send("x" * (10 << 20))
                assert (await settle(client))[0] == 1009
            async with made.connect() as client:
                with contextlib.suppress(ConnectionClosed):
                    for _ in range(500):
                        await client.send('{"k": "beat"}')
                code, reason = await settle(client)
                assert (code, "messages a second" in reason) == (1008, True)
            assert (await ask(other, k="beat"))["k"] == "beat"

    asyncio.run(main())


def test_F27_both_sockets_are_refused_over_the_network_too() -> None:
    async def main() -> None:
        async with served() as made:
            for path in ("/api/v1/live", "/_nicegui_ws/socket.io/"):
                for headers, status in (
                    ({"origin": "http://evil.example"}, 403),
                    ({"authorization": "Bearer wrong"}, 401),
                    ({"host": "evil.example"}, 421),
                ):
                    with pytest.raises(InvalidStatus) as refused:
                        async with made.connect(Role.OPERATOR, path, **headers):
                            pass
                    assert refused.value.response.status_code in (status, 400)

    asyncio.run(main())


def test_the_end_of_a_login_reaches_its_open_connections() -> None:
    async def main() -> None:
        async with served() as made, made.connect(Role.VIEWER) as client:
            await said(client, "welcome")
            made.authority.drop_token("viewer of the test")
            code, reason = await settle(client)
            assert (code, "taken back" in reason) == (4401, True)

    asyncio.run(main())


def test_fifty_clients_are_served_and_too_many_are_told_so() -> None:
    async def main() -> None:
        async with served() as made, contextlib.AsyncExitStack() as stack:
            clients = [await stack.enter_async_context(made.connect(Role.VIEWER)) for _ in range(50)]
            for client in clients:
                await ask(client, k="subscribe", bus="bench", period=0.05)
            for client in clients:
                assert set((await said(client, "telemetry"))["servos"]) == set(KEYS)
            more = [await stack.enter_async_context(made.connect(Role.VIEWER)) for _ in range(MOST_FEEDS - 50)]
            for client in more:
                await said(client, "welcome")
            over = await stack.enter_async_context(made.connect(Role.VIEWER))
            assert (await settle(over))[0] == 1013

    asyncio.run(main())


def test_F27_a_client_that_does_not_read_loses_telemetry_and_holds_up_nobody() -> None:
    async def main() -> None:
        async with served() as made, made.connect(Role.VIEWER) as quick:
            await said(quick, "welcome")
            before = set(made.service.events._feeds)
            slow = socket.socket()
            slow.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
            slow.setblocking(False)
            await asyncio.get_running_loop().sock_connect(slow, ("127.0.0.1", made.port))
            request = (
                f"GET /api/v1/live HTTP/1.1\r\nHost: 127.0.0.1:{made.port}\r\nUpgrade: websocket\r\n"
                "Connection: Upgrade\r\nSec-WebSocket-Key: AAAAAAAAAAAAAAAAAAAAAA==\r\nSec-WebSocket-Version: 13\r\n"
                f"Authorization: Bearer {made.tokens[Role.VIEWER]}\r\n\r\n"
            )
            await asyncio.get_running_loop().sock_sendall(slow, request.encode())
            async with asyncio.timeout(PATIENCE):
                while not (new := set(made.service.events._feeds) - before):  # noqa: ASYNC110 - as above
                    await asyncio.sleep(0.001)
                (feed,) = new
                while feed.lost < 100:  # its buffers are full by then
                    feed.sample("bench", {"t": 0.0, "servos": {"x": "y" * 60_000}})
                    await asyncio.sleep(0)
            assert len(feed._newest) == 1
            assert (await ask(quick, k="beat"))["k"] == "beat"
            for _ in range(MOST_WAITING + 1):
                feed.tell({"k": "event"})
            assert "too slowly" in feed.full
            assert (await ask(quick, k="beat"))["k"] == "beat"
            slow.close()

    asyncio.run(main())


def test_a_client_with_too_many_events_is_closed_with_the_reason() -> None:
    async def main() -> None:
        async with served() as made, made.connect(Role.VIEWER) as client:
            await said(client, "welcome")
            for _ in range(MOST_WAITING + 1):
                made.service.events.tell("test")
            code, reason = await settle(client)
            assert (code, "too slowly" in reason) == (1013, True)

    asyncio.run(main())


def test_the_newest_telemetry_counts_and_every_event_does() -> None:
    async def main() -> None:
        events, feed = Events(), Feed("x")
        events.join(feed)
        for n in range(5):
            feed.sample("a", {"t": n})
            events.tell("happened", n=n)
        feed.answer({"k": "ok"})
        messages = await feed.next()
        assert [message["k"] for message in messages] == ["ok", *["event"] * 5, "telemetry"]
        assert (messages[-1]["t"], messages[-1]["lost"]) == (4, 4)
        assert [event["n"] for event in events.past(3)] == [3, 4]

    asyncio.run(main())
