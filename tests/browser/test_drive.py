"""Move and Plot in a browser: a dial, held buttons, STOP by a key, a wheel, a tab that hangs; curves and exports."""

import csv
import io
import math
import time
import urllib.error
from collections.abc import Callable
from typing import Any

import pytest

RX28 = "dynamixel:1@57600"


def angle(server: Any, servo: str = RX28) -> float:
    """Give the angle of a servo, degrees, past the page."""
    return math.degrees(server.value(servo, "present_position")["value"])


def wait(condition: Callable[[], bool], seconds: float = 15.0) -> None:
    """Wait until something is so."""
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end, "it did not become so"
        time.sleep(0.05)


def still(server: Any, servo: str = RX28) -> float:
    """Wait until a servo stands still, and give its angle."""
    before = angle(server, servo)
    while True:
        time.sleep(0.3)
        now = angle(server, servo)
        if abs(now - before) < 0.5:
            return now
        before = now


def resumed(server: Any) -> None:
    """Let servos be moved again after a stop of an earlier test."""
    if server.ask("GET", "/buses")[0]["stopped_by"]:
        time.sleep(5.1)  # nothing moves for as long after a stop
        server.ask("POST", "/buses/bench/resume", {})


def torque_on(server: Any, servo: str) -> None:
    """Switch the torque on; while what a tab drove that was closed just now is being stopped, that is refused."""
    for last in (False, False, True):
        try:
            server.ask("POST", "/buses/bench/torque", {"servos": [servo], "on": True})
        except urllib.error.HTTPError as error:
            if last or error.code != 409:
                raise
            time.sleep(1.0)
        else:
            return


@pytest.fixture
def moving(show: Any, server: Any) -> Any:
    """Open the page Move with one RX-28 whose torque is on; gives page and card."""
    resumed(server)
    page = show(f"/move?servo={RX28}")
    card = page.locator(".sb-drive")
    card.locator(".now").get_by_text("°").wait_for()
    torque_on(server, RX28)
    card.get_by_text("holds").wait_for()
    return page, card


def test_a_goal_on_the_dial_is_gone_to_and_esc_stops_the_way(moving: Any, server: Any) -> None:
    page, card = moving
    card.locator(".sb-aim").focus()
    page.keyboard.press("Home")
    wait(lambda: angle(server) < 3)
    page.keyboard.press("End")
    wait(lambda: angle(server) > 30)
    page.keyboard.press("Escape")
    page.get_by_text("Nothing moves until somebody resumes").first.wait_for()
    assert still(server) < 290
    before = angle(server)
    card.locator(".sb-aim").focus()
    page.keyboard.press("End")
    page.locator(".q-notification").get_by_text("stopped").first.wait_for()
    assert still(server) == pytest.approx(before, abs=1)


def test_a_held_button_jogs_and_its_release_ends_that(moving: Any, server: Any) -> None:
    page, card = moving
    middle = card.get_by_label("Goal of RX-28 1 in degrees")
    middle.fill("150")
    middle.press("Enter")
    wait(lambda: abs(angle(server) - 150) < 1)
    button = card.locator(".sb-hold").first
    button.hover()
    page.mouse.down()
    wait(lambda: angle(server) < 130)
    page.mouse.up()
    stopped = still(server)
    assert still(server) == pytest.approx(stopped, abs=0.5)


def test_a_tab_that_hangs_while_it_jogs_moves_nothing_any_more(moving: Any, server: Any) -> None:
    page, card = moving
    goal = card.get_by_label("Goal of RX-28 1 in degrees")
    goal.fill("250")
    goal.press("Enter")
    wait(lambda: abs(angle(server) - 250) < 1)
    card.locator(".sb-hold").first.hover()
    page.mouse.down()
    wait(lambda: angle(server) < 240)
    page.evaluate("() => { setTimeout(() => { const end = Date.now() + 5000; while (Date.now() < end); }, 20); }")
    time.sleep(1.0)
    hung = angle(server)
    time.sleep(1.0)
    assert angle(server) == pytest.approx(hung, abs=0.5)
    page.mouse.up()


def test_a_wheel_turns_while_its_button_is_held(show: Any, server: Any) -> None:
    resumed(server)
    servo = "herkulex:219@115200"
    torque_on(server, servo)
    page = show(f"/move?servo={servo}")
    card = page.locator(".sb-drive")
    card.get_by_text("Wheel").click()
    card.get_by_text("turns while held").wait_for()
    card.locator(".sb-drive-wheel .sb-hold").last.hover()
    page.mouse.down()
    wait(lambda: abs(server.value(servo, "present_speed")["value"]) > 0.1)
    page.mouse.up()
    wait(lambda: abs(server.value(servo, "present_speed")["value"]) < 0.05)
    card.get_by_text("Position").click()
    card.locator(".sb-aim").wait_for()


def test_curves_run_and_are_exported(show: Any, server: Any) -> None:
    resumed(server)
    page = show(f"/plot?servo={RX28}")
    legend = page.locator(".sb-legend b").first
    legend.get_by_text("°").wait_for()
    page.wait_for_timeout(1500)
    page.get_by_text("Export").click()
    with page.expect_download() as download:
        page.get_by_text("CSV, all that was read").click()
    rows = list(csv.reader(io.StringIO(download.value.path().read_text())))
    assert rows[0] == ["time [s]", "RX-28 1 present position [°]"]
    assert len(rows) > 10
    assert float(rows[-1][1]) == pytest.approx(angle(server), abs=1)
    page.get_by_text("Export").click()
    with page.expect_download() as picture:
        page.get_by_text("PNG, a picture").click()
    assert picture.value.path().read_bytes()[:8] == b"\x89PNG\r\n\x1a\n"


def test_a_trigger_pauses_the_plot(show: Any, server: Any) -> None:
    resumed(server)
    torque_on(server, RX28)
    server.ask("POST", "/buses/bench/moves", {"goals": {RX28: math.radians(100)}, "time": 1.0})
    wait(lambda: abs(angle(server) - 100) < 1)
    page = show(f"/plot?servo={RX28}")
    page.locator(".sb-legend b").get_by_text("°").wait_for()
    page.get_by_label("Time shown").click()
    page.get_by_role("option", name="5 s", exact=True).click()
    page.get_by_text("Trigger").click()
    page.get_by_label("Level").fill("110")
    page.get_by_text("Arm", exact=True).click()
    page.get_by_text("armed").wait_for()
    server.ask("POST", "/buses/bench/moves", {"goals": {RX28: math.radians(120)}, "time": 0.5})
    page.get_by_text("fired at").wait_for()
    page.get_by_text("Go on").wait_for()


def test_both_pages_fit_a_phone(show: Any) -> None:
    for path in ("/move", "/plot"):
        page = show(path, width=390)
        page.locator(".sb-drive, .sb-chart").first.wait_for()
        assert page.evaluate("document.documentElement.scrollWidth") <= 390
