"""The page of one servo: what somebody changes there is in the servo, and can be taken back."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

from browser.conftest import Server

RX28, DRS0602, LX16A = "dynamixel:1@57600", "herkulex:219@115200", "lewansoul:5@115200"


def field(page: Any, register: str) -> Any:
    return page.locator(f"[data-register={register}] input").first


def type_in(page: Any, register: str, text: str) -> None:
    field(page, register).fill(text)
    field(page, register).press("Enter")


def write(page: Any) -> None:
    """Review the edits and have them written."""
    page.get_by_role("button", name="Review").click()
    page.get_by_role("button", name="Write").click()


def test_registers_are_changed_verified_and_undone(server: Server, show: Callable[..., Any]) -> None:
    page = show(f"/servo?servo={RX28}")
    type_in(page, "highest_limit_temperature", "70")
    type_in(page, "max_torque", "50 %")
    page.get_by_text("2 changes").wait_for()
    page.get_by_text("2 writes to the EEPROM").first.wait_for()
    assert server.value(RX28, "highest_limit_temperature")["raw"] == 80
    write(page)
    page.get_by_text("2 values written and read back").wait_for()
    assert server.value(RX28, "highest_limit_temperature")["raw"] == 70
    assert server.value(RX28, "max_torque")["raw"] == 512
    page.get_by_role("button", name="Undo").click()
    page.get_by_text("2 values brought back").wait_for()
    assert server.value(RX28, "highest_limit_temperature")["raw"] == 80
    assert server.value(RX28, "max_torque")["raw"] == 1023


def test_what_cannot_be_is_said_beside_the_value_and_not_written(server: Server, show: Callable[..., Any]) -> None:
    page = show(f"/servo?servo={RX28}")
    type_in(page, "highest_limit_temperature", "500")
    page.get_by_text("500 °C (raw 500) is not in").wait_for()
    assert not page.get_by_role("button", name="Review").is_visible()
    type_in(page, "cw_angle_limit", "200")
    type_in(page, "ccw_angle_limit", "100")
    page.get_by_role("button", name="Review").click()
    page.get_by_text("must be below the upper one").wait_for()
    assert page.get_by_role("button", name="Write").is_disabled()
    assert server.value(RX28, "cw_angle_limit")["raw"] == 0


def test_a_herkulex_is_changed_until_power_off_alone(server: Server, show: Callable[..., Any]) -> None:
    page = show(f"/servo?servo={DRS0602}")
    type_in(page, "position_kp", "raw 100")
    page.get_by_role("button", name="Review").click()
    page.get_by_text("Until power-off: RAM alone").click()
    page.get_by_text("Nothing goes to the EEPROM").wait_for()
    page.get_by_role("button", name="Write").click()
    page.get_by_text("1 value written and read back").wait_for()
    assert server.value(DRS0602, "position_kp")["raw"] == 100
    assert server.value(DRS0602, "position_kp", stored=True)["raw"] == 70
    page.locator("[data-register=position_kp]").get_by_text("after power-on:").wait_for()


def test_the_grid_of_conditions(server: Server, show: Callable[..., Any]) -> None:
    page = show(f"/servo?servo={RX28}&tab=conditions")
    page.get_by_role("checkbox", name="Goal outside the limits: torque off").click()
    page.get_by_text("1 change").wait_for()
    write(page)
    page.get_by_text("1 value written and read back").wait_for()
    assert server.value(RX28, "alarm_shutdown")["raw"] == 36 | 0x02  # angle limit is bit 1, manual 3-4
    page.get_by_role("button", name="Undo").click()
    page.get_by_text("1 value brought back").wait_for()


def test_another_id(server: Server, show: Callable[..., Any]) -> None:
    page = show("/servo?servo=dynamixel:2@57600&tab=care")
    page.locator("input[data-do=id]").fill("7")
    page.locator("[data-do=identity]").click()
    page.get_by_role("button", name="Change", exact=True).click()
    page.get_by_text("RX-28 7").first.wait_for()
    assert server.value("dynamixel:7@57600", "id")["raw"] == 7
    page.locator("input[data-do=id]").fill("2")
    page.locator("[data-do=identity]").click()
    page.get_by_role("button", name="Change", exact=True).click()
    page.get_by_text("RX-28 2").first.wait_for()


def test_a_new_zero_without_turning_the_shaft(server: Server, show: Callable[..., Any]) -> None:
    page = show(f"/servo?servo={LX16A}&tab=care")
    page.locator("input[data-do=zero-angle]").fill("115.2")
    page.locator("[data-do=zero]").click()
    page.get_by_role("button", name="Set", exact=True).click()
    page.get_by_text("The zero is set").wait_for()
    assert server.value(LX16A, "angle_offset")["raw"] == 20  # 4.8° in units of 0.24°
    assert abs(server.value(LX16A, "present_position")["raw"] - 480) <= 1


def test_backup_restore_and_copy(server: Server, show: Callable[..., Any], tmp_path: Path) -> None:
    page = show("/servo?servo=dynamixel:3@57600&tab=care")
    with page.expect_download() as download:
        page.locator("[data-do=backup]").click()
    file = tmp_path / download.value.suggested_filename
    download.value.save_as(file)
    assert file.name == "rx28-3.toml"
    text = file.read_text()
    assert "highest_limit_temperature = 80" in text
    changed = tmp_path / "changed.toml"
    changed.write_text(text.replace("highest_limit_temperature = 80", "highest_limit_temperature = 65"))
    page.locator("[data-do=restore] input[type=file]").set_input_files(changed)
    page.get_by_role("button", name="Write", exact=True).click()
    page.get_by_text("1 setting written and read back").wait_for()
    assert server.value("dynamixel:3@57600", "highest_limit_temperature")["raw"] == 65
    page.locator("[data-do=copy-to]").click()
    page.get_by_role("option", name="RX-28 1").click()
    page.locator("[data-do=copy]").click()
    page.get_by_role("button", name="Write", exact=True).click()
    page.get_by_text("1 setting written and read back").last.wait_for()
    assert server.value(RX28, "highest_limit_temperature")["raw"] == 65
    page.locator("[data-do=reset]").click()
    page.get_by_role("button", name="Reset", exact=True).click()


def test_it_fits_a_phone(show: Callable[..., Any]) -> None:
    page = show(f"/servo?servo={DRS0602}", width=390)
    page.locator("[data-register=position_kp]").wait_for()
    assert page.evaluate("document.documentElement.scrollWidth") == 390
