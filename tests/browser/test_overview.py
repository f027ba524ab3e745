"""The frame of all pages and the overview: logging in, scan, STOP by key, the heartbeat, a phone, many servos."""

import re
import time
from collections.abc import Callable, Iterator
from typing import Any

import pytest

from browser.conftest import PATIENCE, Server

RX28 = "dynamixel:1@57600"
BANNER = ".sb-banner-bad"


@pytest.fixture
def enter(server: Server, chromium: Any) -> Iterator[Callable[..., Any]]:
    """Give what opens a page by a link of its own, as a browser that has never been here."""
    contexts: list[Any] = []

    def enter(path: str = "/", role: str = "operator", **how: Any) -> Any:
        context = chromium.new_context(**({"viewport": {"width": 1280, "height": 860}} | how))
        contexts.append(context)
        page = context.new_page()
        page.set_default_timeout(PATIENCE)
        page.goto(server.ask("POST", "/links", {"role": role})["url"])
        page.get_by_text("connected").first.wait_for(state="attached")
        if path != "/":
            page.goto(server.url + path)
            page.get_by_text("connected").first.wait_for(state="attached")
        page.wait_for_function("window.socket && window.socket.connected")
        return page

    yield enter
    for context in contexts:
        context.close()


def card(page: Any, key: str) -> Any:
    return page.locator(f'[data-key="{key}"]')


def driven(server: Server, key: str = RX28) -> bool:
    servos = {servo["key"]: servo for servo in server.ask("GET", "/buses/bench/servos")}
    return bool(servos[key]["driven"])


def within(check: Callable[[], bool], seconds: float = 10.0) -> bool:
    until = time.monotonic() + seconds
    while not check():
        if time.monotonic() > until:
            return False
        time.sleep(0.05)
    return True


def resume(server: Server) -> None:
    """Let servos be driven again."""
    server.ask("POST", "/buses/bench/resume", {})


def torque_on(page: Any) -> None:
    """Switch the torque on, as soon as some time has passed after a stop."""
    card(page, RX28).get_by_role("checkbox").check()

    def done() -> bool:
        page.get_by_role("button", name="Torque on").click()
        page.wait_for_timeout(700)
        return "torque on" in card(page, RX28).inner_text()

    assert within(done)


@pytest.fixture(autouse=True)
def off(server: Server) -> Iterator[None]:
    """Leave no torque on."""
    yield
    server.ask("POST", "/buses/bench/torque", {"servos": [RX28], "on": False})


def test_a_link_logs_in_once_and_leaves_no_token(server: Server, chromium: Any) -> None:
    link = server.ask("POST", "/links", {"role": "operator"})["url"]
    first, second = chromium.new_context(), chromium.new_context()
    page = first.new_page()
    page.goto(link)
    page.get_by_role("button", name="Stop all servos").first.wait_for(state="attached")
    assert "token" not in page.url
    other = second.new_page()
    other.goto(link)
    other.get_by_text("this link was used already").wait_for()
    first.close()
    second.close()


def test_scan_finds_servos_and_they_are_seen(enter: Callable[..., Any], server: Server) -> None:
    server.ask("DELETE", f"/buses/bench/servos/{RX28}")
    page = enter()
    card(page, "dynamixel:2@57600").wait_for()
    assert card(page, RX28).count() == 0
    page.get_by_role("button", name="Scan", exact=True).click()
    page.get_by_label("Ids").fill("0-2")
    page.locator(".sb-card").get_by_role("button", name="Scan", exact=True).click()
    card(page, RX28).get_by_text("torque").wait_for()
    assert page.locator("article[data-key]").count() == 5
    assert within(lambda: server.ask("GET", "/jobs")[0]["state"] == "done")
    assert re.search(r"\d+\.\d°", card(page, RX28).inner_text())
    page.get_by_label("Filter").fill("drs")
    assert page.locator("article[data-key]").count() == 1
    page.get_by_label("Filter").fill("")


def test_a_search_can_be_broken_off(enter: Callable[..., Any], server: Server) -> None:
    page = enter()
    page.get_by_role("button", name="Scan", exact=True).click()
    page.locator(".sb-card").get_by_role("button", name="Scan", exact=True).click()
    page.get_by_text("0 found").wait_for()
    page.get_by_role("button", name="Cancel").click()
    page.get_by_text("Broken off").first.wait_for()
    assert server.ask("GET", "/jobs")[0]["state"] == "cancelled"


@pytest.mark.parametrize(("key", "field"), [("Escape", True), (" ", False)])
def test_stop_by_key(enter: Callable[..., Any], server: Server, key: str, field: bool) -> None:
    page = enter()
    torque_on(page)
    assert driven(server)
    if field:
        page.get_by_label("Filter").focus()
    page.keyboard.press(key)
    page.locator(BANNER).get_by_text("was stopped by browser").wait_for()
    assert server.ask("GET", "/buses")[0]["stopped_by"]
    page.get_by_role("button", name="Torque on").click()
    page.get_by_role("alert").get_by_text(": nothing moves until").wait_for()
    page.get_by_role("button", name="Resume").click()
    page.get_by_role("dialog").get_by_text(RX28).wait_for()
    page.get_by_role("dialog").get_by_role("button", name="Resume").click()
    page.locator(BANNER).wait_for(state="detached")
    resume(server)


def test_space_in_a_text_field_is_a_space(enter: Callable[..., Any], server: Server) -> None:
    page = enter()
    page.get_by_label("Filter").focus()
    page.keyboard.type("servo 2")
    assert page.get_by_label("Filter").input_value() == "servo 2"
    assert server.ask("GET", "/buses")[0]["stopped_by"] is None


def test_a_viewer_stops_and_moves_nothing(enter: Callable[..., Any], server: Server) -> None:
    page = enter(role="viewer")
    card(page, RX28).get_by_role("checkbox").check()
    assert page.get_by_role("button", name="Torque on").count() == 0
    page.get_by_role("button", name="Stop all servos").first.click()
    page.locator(BANNER).get_by_text("was stopped by browser").wait_for()
    assert page.get_by_role("button", name="Resume").count() == 0
    resume(server)


@pytest.mark.parametrize("how", ["closed", "hung"])
def test_a_tab_that_is_closed_or_hangs_lets_go(enter: Callable[..., Any], server: Server, how: str) -> None:
    page = enter()
    torque_on(page)
    assert driven(server)
    if how == "closed":
        page.close()
    else:
        page.evaluate("setTimeout(() => { const end = Date.now() + 3000; while (Date.now() < end); }, 0)")
    assert within(lambda: not driven(server), 2.5)
    said = [event for event in server.ask("GET", "/events") if event["what"] == "deadman"]
    assert RX28 in said[-1]["servos"]


@pytest.mark.parametrize("dark", ["light", "dark"])
def test_a_phone_scrolls_one_way_and_has_stop_below(enter: Callable[..., Any], dark: str) -> None:
    page = enter(viewport={"width": 390, "height": 844}, has_touch=True, is_mobile=True, color_scheme=dark)
    card(page, RX28).wait_for()
    assert page.evaluate("document.documentElement.scrollWidth") == 390
    page.get_by_role("button", name="Lines").click()
    assert page.evaluate("document.documentElement.scrollWidth") == 390
    stops = [box for one in page.locator("[data-stop]").all() if (box := one.bounding_box())]
    assert len(stops) == 1
    assert stops[0]["y"] > 700
    back = page.evaluate("getComputedStyle(document.body).backgroundColor")
    light = sum(map(int, re.findall(r"\d+", back)[:3])) > 380
    assert light is (dark == "light")


def test_every_list_survives_254_servos(show: Callable[..., Any], server: Server) -> None:
    server.ask("POST", "/buses", {"name": "many", "port": "virtual:rx28@0-253"})
    try:
        job = server.ask("POST", "/buses/many/scan", {"families": ["dynamixel"], "bauds": [57600]})["id"]
        assert within(lambda: server.ask("GET", f"/jobs/{job}")["state"] == "done", 60.0)
        page = show("/?bus=many")
        page.locator("[data-key]").nth(253).wait_for(state="attached")
        page.get_by_label("mark all").check()
        page.get_by_text("254 marked").first.wait_for()
        assert page.evaluate("servobus.alive()")
    finally:
        server.ask("DELETE", "/buses/many")
