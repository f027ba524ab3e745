"""What the API does with virtual servos, and how it says what went wrong."""

import asyncio
import json
import math
from pathlib import Path
from typing import Any

import httpx
import pytest

pytest.importorskip("fastapi", reason="the web process needs fastapi: servobus[server]")

from servobus.errors import NoReply
from servobus.families import registry
from servobus.server.web.auth import Role
from unit.server.web.rig import KEYS, ROBOT, error_of, rig

RX, RX2, DRS, LX = KEYS
BENCH = "/api/v1/buses/bench"
JSON = {"content-type": "application/json"}


async def ended(client: httpx.AsyncClient, started: httpx.Response) -> dict[str, Any]:
    """Wait for a job; its servos live on a virtual clock, so that it ends at once."""
    assert started.status_code == 202, started.text
    for _ in range(1000):
        job: dict[str, Any] = (await client.get(f"/api/v1/jobs/{started.json()['id']}")).json()
        if job["state"] != "running":
            return job
        await asyncio.sleep(0.002)
    raise AssertionError("this job never ended")


def test_a_scan_tells_what_it_finds_and_the_servos_are_known_then() -> None:
    async def main() -> None:
        async with rig(buses={"b": "virtual:rx28@1,2,lx16a@3?clock=virtual"}) as made, made.client() as client:
            job = await ended(client, await client.post("/api/v1/buses/b/scan", json={"ids": [1, 2, 3]}))
            assert job["state"] == "done"
            assert [one["key"] for one in job["found"]] == [RX, RX2, LX]
            speeds = sum(len(registry.factory_bauds(family)) for family in registry.FAMILIES.values())
            assert (job["done"], job["total"]) == (3 * speeds, 3 * speeds)
            servos = (await client.get("/api/v1/buses/b/servos")).json()
            assert [one["key"] for one in servos] == [RX, RX2, LX]
            assert servos[0]["state"]["torque"] is False
            assert servos[0]["model"] == "rx28"
            told = [event["what"] for event in (await client.get("/api/v1/events")).json()]
            assert told.count("appeared") == 3

    asyncio.run(main())


def test_values_are_si_and_named_as_the_table_names_them() -> None:
    async def main() -> None:
        async with rig() as made, made.client(Role.VIEWER) as client:
            values = (await client.get(f"{BENCH}/servos/{RX}/values?names=present_position&names=max_position")).json()
            # RX-28, from its manual: 300 degrees are 1023 steps, and the counter-clockwise limit is 1023 at first.
            assert values["max_position"]["raw"] == 1023
            assert values["max_position"]["value"] == pytest.approx(300 * math.pi / 180)
            assert values["max_position"]["unit"] == "rad"
            assert values["max_position"]["text"] == "300.0°"
            table = {row["name"]: row for row in (await client.get(f"{BENCH}/servos/{RX}/registers")).json()}
            led = table["alarm_led"]
            assert led["kind"] == "flags"
            assert "overheating" in led["names"]
            assert table["present_temperature"]["now"]["unit"] == "degC"
            assert table["goal_position"]["moves"] is True
            assert table["goal_position"]["limits"] == [0.0, pytest.approx(300 * math.pi / 180)]
            by_id = (await client.get(f"{BENCH}/servos/1/values?names=id")).json()
            assert by_id["id"]["value"] == 1
            models = {one["name"] for one in (await client.get("/api/v1/models")).json()}
            assert {"rx28", "drs0602", "lx16a"} <= models
            rows = (await client.get("/api/v1/models/drs0602")).json()["registers"]
            assert "present_position" in {name for row in rows for name in (row["name"], *row["aliases"])}

    asyncio.run(main())


def test_a_write_gives_old_and_new_values_and_is_checked_whole() -> None:
    async def main() -> None:
        async with rig() as made, made.client(Role.OPERATOR) as client:
            path = f"{BENCH}/servos/{RX}/values"
            preview = await client.post(f"{path}/preview", json={"values": {"max_position": "200deg", "led": True}})
            assert preview.json()["eeprom_writes"] == 1
            assert preview.json()["changes"]["max_position"]["text"] == "300.0° -> 200.0°"
            before = (await client.get(f"{path}?names=max_position")).json()
            assert before["max_position"]["raw"] == 1023  # a preview writes nothing

            values = {"max_position": "200deg", "led": True, "alarm_led": ["overheating", "overload"]}
            written = (await client.post(path, json={"values": values})).json()["changes"]
            assert written["max_position"]["new"] == pytest.approx(682 * 300 / 1023 * math.pi / 180)
            assert written["led"] == {"old": False, "new": True, "unit": "", "text": "off -> on", "taken": True}
            assert set(written["alarm_led"]["new"]) == {"overheating", "overload"}
            again = (await client.post(path, json={"values": {"max_position": {"raw": 1023}}})).json()["changes"]
            assert again["max_position"]["new"] == pytest.approx(300 * math.pi / 180)

            wrong: list[tuple[dict[str, Any], int]] = [
                ({"led": True, "max_position": 99.0}, 422),
                ({"led": "perhaps"}, 422),
                ({"led": True, "nonsense": 1}, 404),
                ({"present_position": 1.0}, 422),
                ({"max_position": True}, 422),
                ({"max_position": 10**400}, 422),
                ({"led": []}, 422),
                ({"max_position": 1.0, "ccw_angle_limit": 1.0}, 422),
                ({"id": 5}, 409),
                ({}, 422),
            ]
            for bad, status in wrong:
                answer = await client.post(path, content=json.dumps({"values": bad}), headers=JSON)
                assert answer.status_code == status, (bad, answer.text)
                error_of(answer)
            after = (await client.get(f"{path}?names=led&names=id")).json()
            assert (after["led"]["value"], after["id"]["value"]) == (True, 1)  # nothing of those was written
            audit = (await client.get("/api/v1/audit")).json()
            assert audit[0]["who"] == "operator of the test"
            assert audit[0]["what"] == "write"
            assert audit[0]["values"]["max_position"]["new"] == pytest.approx(300 * math.pi / 180)

    asyncio.run(main())


def test_moving_needs_torque_and_ends_as_a_job() -> None:
    async def main() -> None:
        async with rig() as made, made.client(Role.OPERATOR) as client:
            goals = {RX: 1.0, RX2: 2.0}
            limp = await client.post(f"{BENCH}/moves", json={"goals": goals, "time": 0.5})
            assert (limp.status_code, error_of(limp)["type"]) == (409, "TorqueOff")
            assert "remedy" in error_of(limp)
            servos = (await client.post(f"{BENCH}/torque", json={"on": True, "servos": [RX, RX2]})).json()
            assert [one["driven"] for one in servos] == [True, True]
            job = await ended(client, await client.post(f"{BENCH}/moves", json={"goals": goals, "time": 0.5}))
            assert job["result"] == {"arrived": True}
            for key, goal in goals.items():
                state = (await client.get(f"{BENCH}/servos/{key}/state")).json()["state"]
                assert state["position"] == pytest.approx(goal, abs=0.06)  # it arrives within 3 degrees
            far = await client.post(f"{BENCH}/moves", json={"goals": {RX: 99.0}})
            assert far.status_code == 422
            twice = await client.post(f"{BENCH}/moves", json={"goals": {RX: 1.0, "1": 1.0}})
            assert twice.status_code == 409
            await client.post(f"{BENCH}/torque", json={"on": False})
            state = (await client.get(f"{BENCH}/servos/{RX}/state")).json()
            assert (state["state"]["torque"], state["driven"]) == (False, False)

    asyncio.run(main())


def test_a_stop_is_for_everybody_and_holds_for_a_while() -> None:
    async def main() -> None:
        async with rig() as made, made.client(Role.OPERATOR) as client, made.client(Role.VIEWER) as viewer:
            await client.post(f"{BENCH}/torque", json={"on": True})
            done = await viewer.post("/api/v1/stop")
            assert set(done.json()["bench"]) == set(KEYS)
            assert (await client.get(BENCH)).json()["stopped_by"] == "viewer of the test"
            for path, body in [
                ("moves", {"goals": {RX: 1.0}}),
                ("torque", {"on": True}),
                (f"servos/{RX}/values", {"values": {"goal_position": 1.0}}),
                (f"servos/{RX}/values", {"values": {"torque_enable": True}}),
                (f"servos/{RX}/rearm", None),
            ]:
                answer = await client.post(f"{BENCH}/{path}", json=body)
                assert (answer.status_code, error_of(answer)["type"]) == (409, "Stopped"), path
            assert (await viewer.post(f"{BENCH}/resume")).status_code == 403
            await client.post(f"{BENCH}/resume")
            soon = await client.post(f"{BENCH}/torque", json={"on": True})  # the window of 5 s is not over
            assert (soon.status_code, error_of(soon)["type"]) == (409, "Stopped")
            assert (await client.post(f"{BENCH}/torque", json={"on": False})).status_code == 200
            made.service.bus("bench")._stopped_at -= 5.0
            assert (await client.post(f"{BENCH}/torque", json={"on": True})).status_code == 200
            some = await viewer.post(f"{BENCH}/stop", json={"servos": [RX]})
            assert list(some.json()) == [RX]

    asyncio.run(main())


def test_endless_turn_is_for_those_who_are_watched() -> None:
    async def main() -> None:
        async with rig() as made, made.client(Role.OPERATOR) as client:
            await client.post(f"{BENCH}/torque", json={"on": True})
            path = f"{BENCH}/servos/{LX}/turn"
            answer = await client.post(path, json={"output": 0.5})
            assert answer.status_code == 409
            assert "watched" in error_of(answer)["message"]
            rows = {"mode": {"raw": 1}, "motor_speed": {"raw": 500}}
            await client.post(f"{BENCH}/torque", json={"on": False})
            for values in (rows, {"mode": "motor"}):
                written = await client.post(f"{BENCH}/servos/{LX}/values", json={"values": values})
                assert (written.status_code, "watched" in error_of(written)["message"]) == (409, True)
            unknown = await client.post(path, json={"output": 0.5}, headers={"servobus-connection": "x"})
            assert unknown.status_code == 404

    asyncio.run(main())


def test_backup_change_and_restore() -> None:
    async def main() -> None:
        async with rig() as made, made.client(Role.OPERATOR) as client:
            path = f"{BENCH}/servos/{DRS}"
            saved = (await client.get(f"{path}/backup")).json()
            assert saved["settings"]["id"]["value"] == 219
            change = {"values": {"max_position": "100deg"}, "save": True}
            assert (await client.post(f"{path}/values", json=change)).status_code == 200
            preview = (await client.post(f"{path}/restore/preview", json={"text": saved["text"]})).json()
            assert list(preview["changes"]) == ["max_position"]
            assert preview["eeprom_writes"] == 1
            restored = await client.post(f"{path}/restore", json={"text": saved["text"]})
            assert restored.json() == {"names": ["max_position"]}
            again = (await client.post(f"{path}/restore/preview", json={"text": saved["text"]})).json()
            assert again["changes"] == {}
            for text in ("", "nonsense", saved["text"].replace("drs0602", "rx28"), "\ud800"):
                wrong = await client.post(f"{path}/restore", content=json.dumps({"text": text}), headers=JSON)
                assert wrong.status_code in (409, 422), wrong.text
            other = await client.post(f"{BENCH}/servos/{RX}/restore", json={"text": saved["text"]})
            assert other.status_code == 409

    asyncio.run(main())


def test_id_speed_reset_and_reboot() -> None:
    async def main() -> None:
        async with rig() as made, made.client(Role.OPERATOR) as client:
            taken = await client.post(f"{BENCH}/servos/{RX}/identity", json={"id": 2})
            assert taken.status_code == 409
            moved = await client.post(f"{BENCH}/servos/{RX}/identity", json={"id": 7, "baud": 1_000_000})
            assert moved.json()["key"] == "dynamixel:7@1000000"
            assert (await client.get(f"{BENCH}/servos/{RX}")).status_code == 404
            odd = await client.post(f"{BENCH}/servos/7/identity", json={"baud": 12345})
            assert odd.status_code == 422
            assert (await client.post(f"{BENCH}/servos/7/identity", json={})).status_code == 422
            assert (await client.post(f"{BENCH}/servos/{DRS}/reboot")).json() == {"ok": True}
            reset = await client.post(f"{BENCH}/servos/{DRS}/reset", json={"keep": ["id", "baud"]})
            assert reset.json()["key"] == DRS

    asyncio.run(main())


def test_a_servo_that_does_not_answer_is_no_fault_of_the_server() -> None:
    async def main() -> None:
        async with rig() as made, made.client() as client:
            attached = await client.post(f"{BENCH}/servos", json={"model": "rx28", "id": 99})
            assert (attached.status_code, attached.json()["key"]) == (201, "dynamixel:99@57600")
            answer = await client.get(f"{BENCH}/servos/99/state")
            assert (answer.status_code, error_of(answer)["type"]) == (424, NoReply.__name__)
            assert (await client.delete(f"{BENCH}/servos/99")).json() == {"ok": True}
            assert (await client.get(f"{BENCH}/servos/99")).status_code == 404
            assert (await client.post(f"{BENCH}/servos", json={"model": "none", "id": 1})).status_code == 404
            gone = await client.post("/api/v1/buses", json={"name": "x", "port": "/dev/there-is-none"})
            assert (gone.status_code, error_of(gone)["type"]) == (424, "PortError")

    asyncio.run(main())


def test_buses_come_and_go() -> None:
    async def main() -> None:
        async with rig() as made, made.client() as client:
            opened = await client.post("/api/v1/buses", json={"name": "two", "port": "virtual:lx16a@5?clock=virtual"})
            assert opened.status_code == 201
            again = await client.post("/api/v1/buses", json={"name": "two", "port": "virtual:lx16a@5?clock=virtual"})
            assert again.status_code == 409
            assert (await client.delete("/api/v1/buses/two")).json() == {"ok": True}
            assert (await client.get("/api/v1/buses/two")).status_code == 404
            assert [bus["name"] for bus in (await client.get("/api/v1/buses")).json()] == ["bench"]

    asyncio.run(main())


def test_jobs_can_be_broken_off_and_are_bounded() -> None:
    async def main() -> None:
        async with rig() as made, made.client(Role.OPERATOR) as client:

            async def never(_: Any) -> None:
                await asyncio.Event().wait()

            job = made.service.jobs.start("scan", "bench", "x", never)
            assert (await client.delete(f"/api/v1/jobs/{job.id}")).json()["state"] == "cancelled"
            for _ in range(15):
                made.service.jobs.start("move", "bench", "x", never)
            made.service.jobs.start("doctor", "bench", "x", never)
            twice = await client.post(f"{BENCH}/doctor", json={})
            assert (twice.status_code, "running already" in error_of(twice)["message"]) == (409, True)
            refused = await client.post(f"{BENCH}/scan", json={"ids": [1]})
            assert (refused.status_code, error_of(refused)["type"]) == (429, "TooMany")
            await client.post(f"{BENCH}/stop")  # a stop breaks them off
            await asyncio.sleep(0.01)
            assert {one["state"] for one in (await client.get("/api/v1/jobs")).json()} == {"cancelled"}

    asyncio.run(main())


def test_an_examination_is_a_job_with_findings() -> None:
    async def main() -> None:
        async with rig() as made, made.client(Role.OPERATOR) as client:
            started = await client.post(f"{BENCH}/doctor", json={"ids": [1, 2], "reads": 20})
            job = await ended(client, started)
            assert job["state"] == "done", job
            checks = {finding["check"]: finding["level"] for finding in job["found"]}
            assert checks["reads"] == "ok"
            assert job["result"] == {"findings": len(job["found"])}

    asyncio.run(main())


def test_recordings_are_files_of_one_folder_and_no_others(tmp_path: Path) -> None:
    async def main() -> None:
        folder = tmp_path / "recordings"
        folder.mkdir()
        (folder / "one.rec").write_text("hello")
        (folder / ".hidden").write_text("hidden")
        (tmp_path / "secret").write_text("secret")
        async with rig(recordings=folder) as made, made.client(Role.VIEWER) as client:
            assert [one["name"] for one in (await client.get("/api/v1/recordings")).json()] == ["one.rec"]
            answer = await client.get("/api/v1/recordings/one.rec")
            assert answer.text == "hello"
            assert answer.headers["content-disposition"].startswith("attachment")
            for name in ("..%2Fsecret", "../secret", ".hidden", "none", "%2Fetc%2Fpasswd"):
                assert (await client.get(f"/api/v1/recordings/{name}")).status_code == 404

    asyncio.run(main())


def test_the_audit_log_lasts_in_a_file(tmp_path: Path) -> None:
    async def main() -> None:
        path = tmp_path / "state" / "audit.jsonl"
        async with rig(audit=path) as made, made.client(Role.OPERATOR) as client:
            await client.post(f"{BENCH}/servos/{RX}/led", json={"colour": "on"})
        lines = [json.loads(line) for line in path.read_text().splitlines()]
        (led,) = [line for line in lines if line["what"] == "led"]
        assert (led["who"], led["servo"], led["result"]) == ("operator of the test", RX, "done")

    asyncio.run(main())


def test_a_robot_is_read_set_up_and_moved_by_its_joints(tmp_path: Path) -> None:
    async def main() -> None:
        file = tmp_path / "arm.toml"
        file.write_text(ROBOT)
        async with rig(robots={"arm": str(file)}) as made, made.client(Role.ADMIN) as client:
            (entry,) = (await client.get("/api/v1/robots")).json()
            assert entry["joints"]["shoulder"]["servos"] == [{"bus": "bench", "key": RX}]
            assert entry["poses"]["home"]["elbow"] == pytest.approx(20 * math.pi / 180)
            angles = (await client.get("/api/v1/robots/arm/positions")).json()
            assert set(angles["positions"]) == {"shoulder", "elbow"}
            assert (await client.get("/api/v1/robots/arm/check")).status_code == 200

            plan = (await client.get("/api/v1/robots/arm/plan")).json()
            assert (plan["changes"], plan["eeprom_writes"]) == (2, 1)
            assert (await client.post("/api/v1/robots/arm/apply", json={})).status_code == 200
            assert (await client.get("/api/v1/robots/arm/plan")).json()["changes"] == 0
            led = (await client.get(f"{BENCH}/servos/{RX}/values?names=led")).json()
            assert led["led"]["value"] is True
            assert (await client.post("/api/v1/robots/arm/undo", json={})).status_code == 200
            assert (await client.get("/api/v1/robots/arm/plan")).json()["changes"] == 2

            path = "/api/v1/robots/arm/moves"
            assert (await client.post(path, json={"pose": "home"})).status_code == 409  # no torque
            await client.post("/api/v1/robots/arm/torque", json={"on": True})
            moved = await client.post(path, json={"pose": "home", "time": 1.0})
            assert (moved.status_code, moved.json()) == (202, {"duration": 1.0})
            assert (await client.post(path, json={"goals": {"shoulder": 1.5}})).status_code == 422  # outside its limits
            assert (await client.post(path, json={"pose": "none"})).status_code == 404
            assert (await client.post(path, json={})).status_code == 422
            await client.post("/api/v1/stop")
            assert (await client.post(path, json={"pose": "home"})).status_code == 409
            assert (await client.delete("/api/v1/buses/bench")).status_code == 409  # the robot uses it

    asyncio.run(main())


def test_errors_have_one_shape_and_repeat_no_input() -> None:
    async def main() -> None:
        async with rig() as made, made.client() as client:
            answers = [
                (await client.get("/api/v1/nothing"), 404),
                (await client.put("/api/v1/buses"), 405),
                (await client.get("/api/v1/buses/none"), 404),
                (await client.post(f"{BENCH}/moves", content=b"{", headers=JSON), 422),
                (await client.post(f"{BENCH}/moves", content=b"\xff", headers=JSON), 422),
                (await client.post(f"{BENCH}/moves", content=b'{"goals": {"1": NaN}}', headers=JSON), 422),
                (await client.post(f"{BENCH}/moves", content=b'{"goals": {"1": 1e999}}', headers=JSON), 422),
                (
                    await client.post(f"{BENCH}/moves", content=b'{"time": ' + b"9" * 5000 + b"}", headers=JSON),
                    422,
                ),
                (await client.post(f"{BENCH}/moves", content=b'{"goals": {"\\ud800": 1}}', headers=JSON), 422),
                (await client.post(f"{BENCH}/moves", content=b"[" * 5000, headers=JSON), 422),
                (await client.get("/api/v1/events?after=-1"), 422),
                (await client.post("/api/v1/session", json={"token": 5, "password": "topsecret"}), 422),
            ]
            for answer, status in answers:
                assert answer.status_code in (status, 400 if status == 422 else status), answer.text
                error_of(answer)
                assert "topsecret" not in answer.text

    asyncio.run(main())
