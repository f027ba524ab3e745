import pytest

from servobus.core.registers import Access, Area
from servobus.errors import BadValue
from servobus.families.base import Model
from servobus.families.dynamixel.places import TABLE
from servobus.families.herkulex.places import EEP, RAM
from servobus.families.registry import DRS0602, LX16A, MODELS, RX28
from servobus.virtual.device.memory import Memory


@pytest.fixture(params=list(MODELS.values()), ids=list(MODELS))
def any_memory(request: pytest.FixtureRequest) -> Memory:
    model: type[Model] = request.param
    return Memory(model)


def test_a_new_memory_holds_the_defaults(any_memory: Memory) -> None:
    for row in any_memory.model.registers.values():
        assert any_memory[row] == (row.default or 0)


def test_every_register_keeps_its_own_value(any_memory: Memory) -> None:
    values = {row: row.limits[number % 2] for number, row in enumerate(any_memory.model.registers.values())}
    for row, raw in values.items():
        any_memory[row] = raw
    assert {row: any_memory[row] for row in values} == values


def test_ram_is_lost_and_eeprom_kept(any_memory: Memory) -> None:
    stored = any_memory.stored()
    for name in stored:
        row = any_memory.model.registers[name]
        any_memory.store(row, row.limits[1])
    volatile = next(
        row
        for row in any_memory.model.registers.values()
        if row.area is Area.RAM and row.default == 0 and row.access is Access.READ_WRITE and row.accepts(1)
    )
    any_memory[volatile] = 1
    any_memory.power_on()
    assert any_memory[volatile] == (volatile.default or 0)
    for name in stored:
        row = any_memory.model.registers[name]
        assert any_memory[row] == any_memory.eeprom[row] == row.limits[1]


def test_dynamixel_has_one_table() -> None:
    memory = Memory(RX28)
    assert len(memory.space(TABLE)) == 50
    memory[RX28.goal_position] = 0x1234 & 0x3FF
    assert memory.space(TABLE)[30:32] == b"\x34\x02"
    memory.write(TABLE, 8, b"\x34\x02")
    assert memory[RX28.ccw_angle_limit] == memory.eeprom[RX28.ccw_angle_limit] == 0x234


def test_sign_and_magnitude() -> None:
    memory = Memory(RX28)
    memory[RX28.present_speed] = -100
    assert memory.space(TABLE)[38:40] == (100 | 0x400).to_bytes(2, "little")
    assert memory[RX28.present_speed] == -100


def test_herkulex_has_two_maps() -> None:
    memory = Memory(DRS0602)
    assert (len(memory.space(EEP)), len(memory.space(RAM))) == (54, 74)
    memory.write(EEP, 6, b"\x07")
    assert (memory[DRS0602.id], memory.eeprom[DRS0602.id]) == (219, 7)
    memory.write(RAM, 0, b"\x09")
    assert (memory[DRS0602.id], memory.eeprom[DRS0602.id]) == (9, 7)
    memory.power_on()
    assert memory[DRS0602.id] == 7


def test_lewansoul_values_can_differ_from_what_is_saved() -> None:
    memory = Memory(LX16A)
    memory[LX16A.angle_offset] = -20
    assert memory.eeprom[LX16A.angle_offset] == 0
    memory.power_on()
    assert memory[LX16A.angle_offset] == 0
    memory.store(LX16A.angle_offset, -20)
    memory.power_on()
    assert memory[LX16A.angle_offset] == -20


def test_factory_reset_keeps_what_it_is_told_to() -> None:
    memory = Memory(DRS0602)
    for row in (DRS0602.id, DRS0602.min_voltage):
        memory.store(row, 100)
    memory.factory_reset(keep={DRS0602.id})
    assert (memory.eeprom[DRS0602.id], memory.eeprom[DRS0602.min_voltage]) == (100, 95)
    assert memory[DRS0602.min_voltage] == 100  # until the next power-on


def test_what_is_stored_is_told_once_for_each_change() -> None:
    memory = Memory(RX28)
    told: list[bool] = []
    memory.on_store = lambda: told.append(True)
    memory[RX28.goal_position] = 5
    assert not told
    memory.write(TABLE, 6, b"\x01\x00\x02\x00")
    assert len(told) == 1
    memory.write(TABLE, 6, b"\x01\x00\x02\x00")
    assert len(told) == 1
    memory.factory_reset()
    assert len(told) == 2


def test_stored_and_restore(any_memory: Memory) -> None:
    kept = any_memory.stored()
    assert kept["id"] == any_memory.model.register("id").default
    other = Memory(any_memory.model)
    other.restore(kept | {"id": 17})
    other.power_on()
    assert other[other.model.register("id")] == 17


@pytest.mark.parametrize(
    "values", [{"goal_position": 5}, {"nothing": 1}, {"id": 254}, {"id": "x"}, {"model_number": 28}]
)
def test_restore_refuses_and_changes_nothing(values: dict[str, int]) -> None:
    memory = Memory(RX28)
    with pytest.raises(BadValue):
        memory.restore({"baud_rate": 1} | values)
    assert memory.stored() == Memory(RX28).stored()


def test_what_is_not_stored_has_no_stored_value() -> None:
    with pytest.raises(BadValue, match="lost at power-off"):
        Memory(RX28).eeprom[RX28.led] = 1
