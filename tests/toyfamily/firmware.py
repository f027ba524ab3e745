"""The firmware of the virtual toys."""

from servobus.core.framing import Corrupt, Packet
from servobus.virtual.device.servo import Replies, VirtualServo
from toyfamily.places import CELLS
from toyfamily.protocol import ANSWER, FRAMING, Code, Trouble


class ToyServo(VirtualServo):
    tick = 0.002
    garbage_timeout = 0.05

    def start(self) -> None:
        self.id, self.baud = self.get("id"), self.model.factory_baud
        self._point = self.shaft.position
        self.put("goal_position", self._here())

    @property
    def torque(self) -> bool:
        return self.get("torque_enable") == 1

    @property
    def led(self) -> str:
        return "off"

    @property
    def alarms(self) -> Trouble:
        hottest = self.row("max_temperature").decode(self.get("max_temperature"))
        return Trouble.HOT if self.temperature > hottest else Trouble(0)

    def hear(self, event: Packet | Corrupt, now: float) -> Replies:  # noqa: ARG002 - nothing here is dated
        if isinstance(event, Corrupt):
            return []
        id, data = self.id, self._obey(Code(event.code), event.data)
        answer = bytes((0x80 | self.alarms,)) if data is None else bytes((self.alarms,)) + data
        return [(0.0005, FRAMING.frame(Packet(id, event.code | ANSWER, answer)))]

    def _obey(self, code: Code, data: bytes) -> bytes | None:
        """Give what is answered, None to refuse."""
        if code is Code.READ:
            self.put("present_position", self._here())
            self.put("present_voltage", self.row("present_voltage").scale.encode(self.voltage))
            self.put("present_temperature", self.row("present_temperature").scale.encode(self.temperature))
            return self.memory.space(CELLS)[2 * data[0] : 2 * (data[0] + data[1])]
        if code is Code.WRITE:
            row = next((row for row in self.model.registers.values() if row.place.within(CELLS) == 2 * data[0]), None)
            if row is None or not row.writable or not row.accepts(row.layout.unpack(data[1:])):
                return None
            self.memory.write(CELLS, 2 * data[0], data[1:])
            self.id = self.get("id")
        if code is Code.RESET:
            self.memory.factory_reset()
            self.power_on(self.time)
        return b""

    def control(self, ticks: int) -> None:
        for _ in range(ticks):
            if self.torque:
                step = self.row("speed").decode(self.get("speed")) * self.tick
                left = self.row("goal_position").decode(self.get("goal_position")) - self._point
                self._point += max(-step, min(left, step))
                self.shaft.drive(max(-1.0, min(20 * (self._point - self.shaft.position), 1.0)))
            else:
                self._point = self.shaft.position
                self.shaft.release()
            self.shaft.tick()

    def _here(self) -> int:
        row = self.row("present_position")
        return max(0, min(row.scale.encode(self.shaft.position), 3600))
