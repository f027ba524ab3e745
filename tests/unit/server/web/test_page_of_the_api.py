"""What docs/api.md says of the API is so."""

import re
from pathlib import Path
from typing import get_args

import pytest

pytest.importorskip("fastapi", reason="the web process needs fastapi: servobus[server]")

from servobus.server.web import auth, feeds, holders, rates, rules, served_bus
from servobus.server.web.api import live
from servobus.server.web.app import WebApplication
from servobus.server.web.config import WebConfig

PAGE = (Path(__file__).parents[4] / "docs" / "api.md").read_text(encoding="utf-8")


def test_messages_of_the_live_connection() -> None:
    table = PAGE.partition("| the client sends |")[2].partition("\n\n")[0]
    kinds = {get_args(one.model_fields["k"].annotation)[0] for one in get_args(get_args(live.Asked)[0])}
    assert set(re.findall(r"^\| `(\w+)`", table, re.MULTILINE)) == kinds


def test_bounds() -> None:
    for said, value in [
        ("for 12 h", auth.SESSION_TIME == 12 * 3600),
        ("good for ten minutes", auth.LINK_TIME == 600),
        ("within the last five minutes", auth.FRESH == 300),
        ("After ten wrong passwords within a minute", (auth.TRIES, auth.LOCKED) == (10, 60)),
        ("64 kB, or 1 MB for a backup", (rules.SMALL, rules.LARGE) == (64 << 10, 1 << 20)),
        ("50 commands or 200 questions", (rates.COMMANDS, rates.READINGS) == (50, 200)),
        ("for 5 s, and until somebody resumes", served_bus.WINDOW == 5),
        ("(s, 0.1 to 5)", (holders.SHORTEST, holders.LONGEST) == (0.1, 5.0)),
        ("than 0.5 s, is refused", holders.STALE == 0.5),
        ("where a thousand of them wait", feeds.MOST_WAITING == 1000),
    ]:
        assert re.sub(r"\s+", " ", said) in re.sub(r"\s+", " ", PAGE), said
        assert value, said


def test_addresses() -> None:
    api = WebApplication(WebConfig()).api
    known = {re.sub(r"\{\w+\}", "X", path) for path in api.openapi()["paths"]} | {
        "/api/v1/openapi.json",
        "/api/v1/live",
    }
    for path in re.findall(r"(/api/v1/[\w./]+)", PAGE):
        assert re.sub(r"\b(BUS|ID)\b", "X", path.rstrip("./")) in known, path
    for path in re.findall(r"\$B(/[\w/]+)", PAGE):
        assert re.sub(r"/(bench|1)\b", "/X", f"/api/v1{path}") in known, path
