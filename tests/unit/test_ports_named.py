"""Names of ports that are none: said so in one sentence, whatever pyserial says."""

import pytest

import servobus


@pytest.mark.parametrize(
    "name",
    ["socket://", "socket://pi", "socket://pi:x", "socket://:80", "socket://pi:0", "socket://pi:99999", "rfc2217://pi"],
)
def test_an_address_without_host_or_port(name: str) -> None:
    with pytest.raises(servobus.UsageError, match=r"write (socket|rfc2217)://HOST:PORT, such as \1://pi\.local:3333"):
        servobus.open(name)


def test_a_name_with_a_nul() -> None:
    with pytest.raises(servobus.UsageError, match=r"^'/dev/tty\\x00' is no name of a port"):
        servobus.open("/dev/tty\0")


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("/tmp", "/tmp is a folder, and no serial port"),
        ("socket://127.0.0.1:1", r"^socket://127\.0\.0\.1:1: cannot be opened \([A-Z][a-z ]+\)$"),
        ("/dev/null", "no serial port"),
    ],
)
def test_what_is_no_port(name: str, said: str) -> None:
    with pytest.raises(servobus.PortError, match=said) as caught:
        servobus.open(name)
    assert str(caught.value).count(name) == 1
