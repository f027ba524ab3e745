"""Facts about ports, on a made-up /dev, /proc and /sys.

The files are those of Linux: proc(5) for /proc/PID/fd, /proc/PID/cmdline and /proc/locks, the kernel's ftdi_sio driver
for latency_timer.
"""

import os
import sys
from pathlib import Path

import pytest

from servobus.errors import PortError
from servobus.transports import usb_adapter as facts
from servobus.transports.usb_adapter import Adapter, Holder, Holders, access, adapter, find_again, holders

if sys.platform == "win32":
    pytest.skip("these facts are Linux's", allow_module_level=True)

PORT = "/dev/ttyUSB0"
FTDI = Adapter(PORT, 0x0403, 0x6001, "FTDI", "FT232R USB UART", "A50285BI", "1-1.2")


@pytest.fixture
def root(tmp_path: Path) -> Path:
    """Make a computer with one port, /dev/ttyUSB0, that nobody has open."""
    for folder in ("dev/serial/by-id", "proc", "sys/class/tty/ttyUSB0/device"):
        (tmp_path / folder).mkdir(parents=True)
    (tmp_path / "dev/ttyUSB0").touch()
    (tmp_path / "dev/serial/by-id/usb-FTDI").symlink_to("../../ttyUSB0")
    (tmp_path / "proc/locks").touch()
    return tmp_path


def process(root: Path, pid: int, *files: str, command: bytes = b"python3\0arm.py\0") -> None:
    place = root / "proc" / str(pid)
    (place / "fd").mkdir(parents=True)
    (place / "cmdline").write_bytes(command)
    for number, file in enumerate(files):
        (place / "fd" / str(number)).symlink_to(file)


def plugged(monkeypatch: pytest.MonkeyPatch, *there: Adapter) -> None:
    monkeypatch.setattr(facts, "adapters", lambda: list(there))


class TestAccess:
    def test_of_a_port_that_is_there(self, root: Path) -> None:
        about = access(PORT, root)
        assert about is not None
        assert (about.real, about.exists, about.allowed, about.remedy) == (PORT, True, True, "")

    def test_of_a_link_tells_what_is_behind_it(self, root: Path) -> None:
        about = access("/dev/serial/by-id/usb-FTDI", root)
        assert about is not None
        assert (about.real, about.exists) == (PORT, True)

    def test_of_a_port_that_is_not_there(self, root: Path) -> None:
        about = access("/dev/ttyUSB1", root)
        assert about is not None
        assert (about.exists, about.allowed, about.remedy) == (False, False, "")

    @pytest.mark.parametrize("name", ["socket://robot:3333", "rfc2217://robot:4000"])
    def test_of_other_ports_is_unknown(self, root: Path, name: str) -> None:
        assert access(name, root) is None

    @pytest.mark.parametrize(
        ("mode", "group", "member", "remedy"),
        [
            (0o660, "dialout", False, "sudo usermod -aG dialout $USER"),
            (0o660, "dialout", True, "log out and in again"),
            (0o660, "", False, "sudo chmod a+rw /dev/ttyUSB0"),  # root's: nobody should join that group
            (0o600, "dialout", False, "sudo chmod a+rw /dev/ttyUSB0"),
        ],
    )
    def test_that_is_refused_names_the_remedy(
        self, root: Path, monkeypatch: pytest.MonkeyPatch, mode: int, group: str, member: bool, remedy: str
    ) -> None:
        (root / "dev/ttyUSB0").chmod(mode)
        monkeypatch.setattr(os, "access", lambda *_: False)
        monkeypatch.setattr(facts, "_group", lambda _: (group, member))
        about = access(PORT, root)
        assert about is not None
        assert not about.allowed
        assert about.remedy == remedy

    def test_knows_the_groups_of_this_system(self) -> None:
        import grp  # noqa: PLC0415 - not there on Windows

        some = next(group for group in grp.getgrall() if group.gr_gid != 0)
        assert facts._group(some.gr_gid)[0] == grp.getgrgid(some.gr_gid).gr_name
        assert facts._group(0) == ("", False)


class TestHolders:
    def test_nobody(self, root: Path) -> None:
        process(root, 4711, "/dev/null", "/dev/ttyUSB1", "socket:[12345]")
        assert holders(PORT, root) == Holders()

    def test_are_named(self, root: Path) -> None:
        process(root, 4711, "/dev/null", PORT, command=b"/usr/bin/python3\0arm.py\0--fast\0")
        found = holders("/dev/serial/by-id/usb-FTDI", root)
        assert found.known == (Holder(4711, "python3 arm.py --fast"),)
        assert str(found) == "python3 arm.py --fast (pid 4711)"

    def test_this_process_is_told_apart(self, root: Path) -> None:
        process(root, os.getpid(), PORT)
        process(root, 4711, PORT)
        found = holders(PORT, root)
        assert [holder.pid for holder in found.others] == [4711]
        assert str(found) == "python3 arm.py (pid 4711)"
        assert str(Holders(tuple(holder for holder in found.known if holder.own))) == "this process"

    def test_of_another_user(self, root: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        process(root, 4711, PORT)
        hidden, real = root / "proc/4711/fd", Path.iterdir

        def iterdir(path: Path) -> object:
            if path == hidden:
                raise PermissionError(13, "Permission denied")
            return real(path)

        monkeypatch.setattr(Path, "iterdir", iterdir)
        found = holders(PORT, root)
        assert found == Holders((), hidden=True)
        assert str(found) == "a process of another user"
        # Whoever locks the port is known to everybody.
        about = (root / "dev/ttyUSB0").stat()
        place = f"{os.major(about.st_dev):02x}:{os.minor(about.st_dev):02x}:{about.st_ino}"
        (root / "proc/locks").write_text(
            f"1: POSIX  ADVISORY  WRITE 600 {place} 0 EOF\n"
            f"2: FLOCK  ADVISORY  WRITE 4711 {place} 0 EOF\n"
            f"2: -> FLOCK  ADVISORY  WRITE 601 {place} 0 EOF\n"
            "3: FLOCK  ADVISORY  WRITE 602 00:06:1 0 EOF\n"
        )
        assert str(holders(PORT, root)) == "python3 arm.py (pid 4711)"

    def test_a_process_that_ends_meanwhile_is_no_holder(self, root: Path) -> None:
        (root / "proc/4711").mkdir()
        assert holders(PORT, root) == Holders()

    def test_a_command_line_cannot_harm_a_terminal(self, root: Path) -> None:
        process(root, 4711, PORT, command=b"sh\0\x1b[2J\xff\0" + b"x" * 100)
        (holder,) = holders(PORT, root).known
        assert holder.command.startswith("sh ?[2J")
        assert holder.command.isprintable()
        assert len(holder.command) == 60
        assert holder.command.endswith(" ...")

    def test_where_nothing_tells(self, tmp_path: Path) -> None:
        assert holders(PORT, tmp_path) == Holders()
        assert str(holders("socket://robot:3333")) == "another program"


class TestAdapter:
    @pytest.fixture
    def ftdi(self, root: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
        plugged(monkeypatch, Adapter("/dev/ttyS0"), FTDI)
        (root / "sys/class/tty/ttyUSB0/device/driver").symlink_to("../../../../bus/usb-serial/drivers/ftdi_sio")
        place = root / "sys/bus/usb-serial/devices/ttyUSB0"
        place.mkdir(parents=True)
        (place / "latency_timer").write_text("16\n")
        return root

    def test_of_ftdi(self, ftdi: Path) -> None:
        found = adapter("/dev/serial/by-id/usb-FTDI", ftdi)
        assert found is not None
        assert (found.device, found.usb, found.driver, found.latency_timer) == (PORT, "0403:6001", "ftdi_sio", 16)
        assert found.latency == pytest.approx(0.018)
        assert found.slow
        assert str(found) == "FTDI FT232R USB UART (0403:6001) serial number A50285BI"

    def test_the_rule_and_the_command_that_mend_it(self, ftdi: Path) -> None:
        found = adapter(PORT, ftdi)
        assert found is not None
        assert found.udev_rule == (
            'ACTION=="add", SUBSYSTEM=="usb-serial", DRIVER=="ftdi_sio", ATTRS{idVendor}=="0403", '
            'ATTRS{idProduct}=="6001", ATTRS{serial}=="A50285BI", ATTR{latency_timer}="1"'
        )
        assert found.command == "echo 1 | sudo tee /sys/bus/usb-serial/devices/ttyUSB0/latency_timer"

    def test_that_is_fast(self, ftdi: Path) -> None:
        (ftdi / "sys/bus/usb-serial/devices/ttyUSB0/latency_timer").write_text("1\n")
        found = adapter(PORT, ftdi)
        assert found is not None
        assert not found.slow

    def test_without_a_timer(self, root: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        plugged(monkeypatch, FTDI)
        found = adapter(PORT, root)
        assert found is not None
        assert (found.latency_timer, found.latency, found.slow) == (None, None, False)

    def test_that_is_unplugged_while_one_looks(self, root: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        def comports() -> list[object]:
            raise TypeError("int() can't convert non-string with explicit base")  # what pyserial 3.5 says then

        monkeypatch.setattr("serial.tools.list_ports.comports", comports)
        assert adapter(PORT, root) is None

    @pytest.mark.parametrize("name", ["/dev/ttyUSB0", "socket://robot:3333"])
    def test_that_nobody_knows(self, root: Path, monkeypatch: pytest.MonkeyPatch, name: str) -> None:
        plugged(monkeypatch)
        assert adapter(name, root) is None


class TestFindAgain:
    MOVED = Adapter("/dev/ttyUSB3", 0x0403, 0x6001, "FTDI", "FT232R USB UART", "A50285BI", "1-1.4")
    OTHER = Adapter("/dev/ttyUSB0", 0x0403, 0x6001, "FTDI", "FT232R USB UART", "A9007UX1", "1-1.2")

    def test_under_another_name_in_another_place(self, monkeypatch: pytest.MonkeyPatch) -> None:
        plugged(monkeypatch, self.OTHER, self.MOVED)
        assert find_again(FTDI).device == "/dev/ttyUSB3"

    def test_that_is_gone_says_what_is_there(self, monkeypatch: pytest.MonkeyPatch) -> None:
        plugged(monkeypatch, self.OTHER, Adapter("/dev/ttyS0"))
        with pytest.raises(PortError, match=r"A50285BI is not plugged in; there is: /dev/ttyUSB0 \(.*A9007UX1\)$"):
            find_again(FTDI)
        plugged(monkeypatch)
        with pytest.raises(PortError, match="no USB adapter"):
            find_again(FTDI)

    def test_twins_are_told_apart_by_their_place(self, monkeypatch: pytest.MonkeyPatch) -> None:
        twins = [Adapter(f"/dev/ttyUSB{n}", 0x10C4, 0xEA60, "", "CP2102", "0001", f"1-1.{n}") for n in (1, 2)]
        plugged(monkeypatch, *twins)
        assert find_again(twins[1]).device == "/dev/ttyUSB2"
        plugged(monkeypatch, *(Adapter(one.device, *(0x10C4, 0xEA60, "", "CP2102", "0001"), "1-3") for one in twins))
        with pytest.raises(PortError, match=r"plug it in where it was; there is: /dev/ttyUSB1 .*, /dev/ttyUSB2 "):
            find_again(twins[1])

    def test_the_ports_of_one_adapter_are_told_apart(self, monkeypatch: pytest.MonkeyPatch) -> None:
        def port(name: str, location: str) -> Adapter:
            return Adapter(name, 0x0403, 0x6011, "FTDI", "Quad RS232-HS", "FT4XYZ", location)

        plugged(monkeypatch, port("/dev/ttyUSB4", "1-2:1.0"), port("/dev/ttyUSB5", "1-2:1.1"))
        assert find_again(port("/dev/ttyUSB1", "1-1.2:1.1")).device == "/dev/ttyUSB5"
