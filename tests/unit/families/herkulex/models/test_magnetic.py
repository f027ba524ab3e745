"""The DRS-0602's table, against a second transcription of the manual's section 4-2."""

import pytest

from servobus.core.registers import Access, Area
from servobus.core.units import deg
from servobus.errors import BadValue
from servobus.families.base import Answers
from servobus.families.herkulex.models.magnetic import DRS0602
from servobus.families.herkulex.places import Eep, EepRam, Ram
from servobus.families.herkulex.protocol import Led, StatusError, TorqueControl

# name, EEP and RAM address, signed or unsigned and bytes, default, lowest and highest value, access; errata applied
TABLE = """
    model_no1                              0   - u1      6      -      - RO
    model_no2                              1   - u1      2      -      - RO
    version1                               2   - u1      0      -      - RO
    version2                               3   - u1    144      -      - RO
    baud_rate                              4   - u1     16      1     34 RW
    id                                     6   0 u1    219      0    253 RW
    ack_policy                             7   1 u1      1      0      2 RW
    alarm_led_policy                       8   2 u1     95      0    127 RW
    torque_policy                          9   3 u1     21      0    127 RW
    max_temperature                       11   5 u1     80      0    110 RW
    min_voltage                           12   6 u1     95     92    200 RW
    max_voltage                           13   7 u1    170     92    200 RW
    acceleration_ratio                    14   8 u1     25      0     50 RW
    max_acceleration_time                 15   9 u1     45      0    254 RW
    dead_zone                             16  10 u1      0      0    254 RW
    saturator_offset                      17  11 u1      0      0    254 RW
    saturator_slope                       18  12 u2      0      0  32767 RW
    pwm_offset                            20  14 s1      0   -128    127 RW
    min_pwm                               21  15 u1      0      0    254 RW
    max_pwm                               22  16 u2   1023      0   1023 RW
    overload_pwm_threshold                24  18 u2   1022      0   1023 RW
    min_position                          26  20 u2  10627      0  32767 RW
    max_position                          28  22 u2  22129      0  32767 RW
    position_kp                           30  24 u2     70      0  32767 RW
    position_kd                           32  26 u2      0      0  32767 RW
    position_ki                           34  28 u2      0      0  32767 RW
    position_feedforward_1st_gain         36  30 u2      0      0  32767 RW
    position_feedforward_2nd_gain         38  32 u2      0      0  32767 RW
    velocity_kp                           40  34 u2    100      0  32767 RW
    velocity_ki                           42  36 u2  12000      0  32767 RW
    led_blink_period                      44  38 u1     45      0    254 RW
    adc_fault_check_period                45  39 u1     45      0    254 RW
    packet_garbage_check_period           46  40 u1     18      0    254 RW
    stop_detection_period                 47  41 u1     27      0    254 RW
    overload_detection_period             48  42 u1    150      0    254 RW
    stop_threshold                        49  43 u1      6      0    254 RW
    inposition_margin                     50  44 u1      6      0    254 RW
    calibration_difference                52  46 s2      0  -1495   1495 RW
    status_error                           -  48 u1      0      0    127 RW
    status_detail                          -  49 u1      0      0    127 RW
    aux_1                                  -  50 u1      0      0      6 RW
    torque_control                         -  52 u1      0      0     96 RW
    led_control                            -  53 u1      0      0      7 RW
    voltage                                -  54 u1      -      0    200 RO
    temperature                            -  55 u1      -      0    110 RO
    current_control_mode                   -  56 u1      0      0      1 RO
    tick                                   -  57 u1      -      0    255 RO
    calibrated_position                    -  58 u2      -      -      - RO
    absolute_position                      -  60 u2      -      -      - RO
    differential_position                  -  62 s2      -      -      - RO
    pwm                                    -  64 s2      0      -      - RO
    absolute_2nd_position                  -  66 u2      -      -      - RO
    absolute_goal_position                 -  68 u2      -      -      - RO
    absolute_desired_trajectory_position   -  70 u2      -      -      - RO
    desired_velocity                       -  72 s2      0      -      - RO
"""
ROWS = [line.split() for line in TABLE.strip().splitlines()]
RESERVED = {"reserved_6": Eep(5), "reserved_11": EepRam(10, 4), "reserved_40": EepRam(51, 45), "reserved_46": Ram(51)}


def number(text: str) -> int | None:
    return None if text == "-" else int(text)


@pytest.mark.parametrize("line", ROWS, ids=lambda line: line[0])
def test_row(line: list[str]) -> None:
    name, eep, ram, layout, default, low, high, access = line
    row = DRS0602.registers[name]
    place: Eep | Ram | EepRam
    if ram == "-":
        place = Eep(int(eep))
    elif eep == "-":
        place = Ram(int(ram))
    else:
        place = EepRam(int(eep), int(ram))
    assert row.place == place
    assert (row.layout.size, row.layout.signed) == (int(layout[1]), layout[0] == "s")
    assert row.default == number(default)
    assert row.access is (Access.READ if access == "RO" else Access.READ_WRITE)
    assert row.area is (Area.RAM if eep == "-" else Area.EEPROM)
    if low != "-":
        assert row.limits == (int(low), int(high))


def test_sixty_numbered_rows() -> None:
    assert len(ROWS) == 55
    assert set(DRS0602.registers) == {line[0] for line in ROWS} | set(RESERVED)
    assert {name: DRS0602.registers[name].place for name in RESERVED} == RESERVED
    assert all(DRS0602.registers[name].access is Access.RESERVED for name in RESERVED)
    # NO 41 and 42 are one register here.
    assert len(DRS0602.registers) + 1 == 60


def test_both_maps_are_without_gap() -> None:
    eep, ram = set[int](), set[int]()
    for row in DRS0602.registers.values():
        if isinstance(row.place, Eep | EepRam):
            eep |= set(range(row.place.eep, row.place.eep + row.layout.size))
        if isinstance(row.place, Ram | EepRam):
            ram |= set(range(row.place.ram, row.place.ram + row.layout.size))
    assert eep == set(range(54))
    assert ram == set(range(74))


def test_name_and_number() -> None:
    assert DRS0602.key() == "drs0602"
    assert DRS0602.number == 0x0602
    assert [DRS0602.registers[name].default for name in ("model_no1", "model_no2")] == [6, 2]


@pytest.mark.parametrize(
    ("name", "raw", "value"),
    [
        ("calibrated_position", 16384, 0.0),
        ("calibrated_position", 9903, -180 * deg),  # Aux 1, NO 45
        ("absolute_position", 22865, 180 * deg),
        ("absolute_goal_position", 16384 + 12962, 360 * deg),
        ("absolute_2nd_position", 1024 + 100, 16.3 * deg),
        ("differential_position", -100, -62 * deg),
        ("desired_velocity", 1000, 34 * deg),
        ("max_acceleration_time", 254, 2.8448),
        ("led_blink_period", 45, 0.504),
        ("overload_detection_period", 150, 0.600),
        ("acceleration_ratio", 25, 0.25),
        ("min_voltage", 95, 9.5),
        ("max_temperature", 80, 80.0),
        ("max_pwm", 1023, 1.0),
        ("pwm_offset", -128, -128 / 1023),
        ("saturator_slope", 256, 1.0),
        ("position_kp", 70, 8.75),
        ("position_ki", 16384, 1.0),
        ("velocity_kp", 64, 1.0),
        ("velocity_ki", 8192, 0.5),
    ],
)
def test_scale(name: str, raw: int, value: float) -> None:
    row = DRS0602.registers[name]
    assert row.decode(raw) == pytest.approx(value)
    assert row.scale.encode(value) == raw


def test_default_limits_are_not_symmetric() -> None:
    low, high = (row.decode(row.default) for row in (DRS0602.min_position, DRS0602.max_position) if row.default)
    assert low == pytest.approx(-159.9 * deg, abs=0.1 * deg)
    assert high == pytest.approx(159.6 * deg, abs=0.1 * deg)


def test_factory_policies() -> None:
    assert DRS0602.ack_policy.default == Answers.READS
    default = DRS0602.torque_policy.default
    assert default is not None
    assert DRS0602.torque_policy.decode(default) == (
        StatusError.INPUT_VOLTAGE | StatusError.TEMPERATURE | StatusError.OVERLOAD
    )


def test_speeds() -> None:
    assert DRS0602.baud_rate.decode(0x10) == 115_200
    assert DRS0602.baud_rate.encode(57_600) == 0x22
    with pytest.raises(BadValue, match="9600 baud is not one of"):
        DRS0602.baud_rate.encode(9600)
    assert not DRS0602.baud_rate.accepts(5)


def test_choices() -> None:
    assert DRS0602.torque_control.encode(TorqueControl.BRAKE) == 0x40
    assert not DRS0602.torque_control.accepts(0x20)
    assert DRS0602.led_control.parse("red+green") == Led.RED | Led.GREEN
    assert DRS0602.ack_policy.show(Answers.READS) == "reads"


def test_what_is_measured_is_not_written() -> None:
    with pytest.raises(BadValue, match="can only be read"):
        DRS0602.calibrated_position.encode(0.0)
    assert DRS0602.absolute_goal_position.limits == (0, 32767)


def test_shared_names() -> None:
    assert DRS0602.aliases == {
        "baud": "baud_rate",
        "answer_level": "ack_policy",
        "torque_enable": "torque_control",
        "goal_position": "absolute_goal_position",
        "present_position": "calibrated_position",
        "present_speed": "differential_position",
        "present_load": "pwm",
        "present_voltage": "voltage",
        "present_temperature": "temperature",
        "output_limit": "max_pwm",
        "calibration": "calibration_difference",
    }
    assert {"min_position", "max_position", "id"} <= set(DRS0602.registers)


def test_data_sheet() -> None:
    sheet = DRS0602.sheet
    (best,) = sheet.performance
    assert (best.voltage, best.stall_torque) == (14.8, 7.6)
    assert best.speed == pytest.approx(365.9 * deg, abs=0.1 * deg)
    assert sheet.voltage == (9.5, 14.8)
    assert sheet.resolution == pytest.approx(0.02778 * deg, rel=1e-3)
