"""Packets, doctor and bench in a browser: what is set around a servo is felt by it, seen on the line, and mended."""

import re
import time
from collections.abc import Callable
from typing import Any

HOT = "dynamixel:3@57600"


def wait(condition: Callable[[], bool], seconds: float = 20.0) -> None:
    """Wait until something is so."""
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end, "it did not become so"
        time.sleep(0.05)


def drag(page: Any, slider: Any, share: float) -> None:
    """Put a slider to a share of its way."""
    slider.scroll_into_view_if_needed()
    box = slider.bounding_box()
    page.mouse.click(box["x"] + share * box["width"], box["y"] + box["height"] / 2)


def test_heat_on_the_bench_is_what_the_servo_tells_and_the_doctor_says(show: Any, server: Any) -> None:
    page = show("/bench")
    card = page.locator(".sb-bench-card", has_text="RX-28 id 3")
    try:
        drag(page, card.get_by_label("Heat"), 0.93)
        wait(lambda: bool(server.value(HOT, "present_temperature")["value"] > 85))
        page.goto(f"{server.url}/doctor")
        page.get_by_label("Ids", exact=True).fill("3")
        page.get_by_role("button", name="Examine").click()
        page.locator(".sb-finding-fail", has_text="overheating").wait_for()
        page.locator(".sb-finding-fail").get_by_role("button", name="Torque off").first.wait_for()
    finally:
        page.goto(f"{server.url}/bench")
        page.get_by_role("button", name="Put everything right").click()
        wait(lambda: bool(server.value(HOT, "present_temperature")["value"] < 40))


def test_packets_are_seen_filtered_and_written(show: Any) -> None:
    page = show("/packets")
    rows = page.locator(".sb-log-row")
    rows.filter(has_text="present_voltage").first.wait_for()
    page.get_by_label("Find words or bytes").fill("FF FF 01 02 01 FB")
    wait(lambda: rows.count() == 0)
    page.get_by_role("button", name="Send").click()  # the packet that stands there is a PING to id 1
    page.get_by_text(re.compile("status of id 1")).wait_for()
    wait(lambda: "PING id 1" in rows.all_inner_texts()[0] if rows.count() else False)
    page.get_by_label("Command").fill("03")
    page.get_by_label("Data, hexadecimal").fill("1E 00 02")
    page.get_by_text("may move a servo").wait_for()
