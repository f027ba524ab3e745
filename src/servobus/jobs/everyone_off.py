"""Torque off without looking for anybody: told to every id, or to one, at every speed.

Servos of several families on one wire hear what is meant for the others, and bytes at another speed as garbage. What
one takes for the start of a packet makes it miss the next bytes, up to the length of its longest packet. So each
request goes behind so many bytes that are no start of any packet.
"""

from collections.abc import Iterable, Mapping, Sequence

from servobus.core.exchange import Exchange, Pause, Procedure, SetBaud, told
from servobus.core.ids import BROADCAST
from servobus.families.base import Answers, Family, Model, ServoRef

ROUNDS = 2
"""Times that it is told: nothing answers, and bytes get lost."""
LONGEST_FLUSH = 0.06
"""s of flush before one request at most. Assumption: who is deaf for longer has given up by the second round."""
FLUSH = b"\x00"


def everyone_off(
    rounds: Sequence[tuple[Family, Sequence[int]]],
    models: Mapping[str, Iterable[type[Model]]],
    id: int = BROADCAST,
) -> Procedure[None]:
    """Tell servos to switch their torque off; nothing answers, and nothing tells whether it was heard.

    rounds  families, each with the speeds at which it is told
    models  name of a family -> models that its servos may be of
    id      who is told; all by default
    """
    speeds: dict[int, list[Family]] = {}
    for family, bauds in rounds:
        for baud in bauds:
            speeds.setdefault(baud, []).append(family)
    # The second time the other way round: at which speeds one was spoken to before is another thing then.
    for order in [sorted(speeds, reverse=True), sorted(speeds)] * (ROUNDS // 2):
        for baud in order:
            yield SetBaud(baud)
            for family in speeds[baud]:
                flush = FLUSH * min(family.framing.max_size, int(LONGEST_FLUSH * baud / 10))
                # One request for each place at which models of this family have their torque.
                places = {model.register("torque_enable").place: model for model in models[family.name]}
                for model in places.values():
                    off = family.put(
                        ServoRef(id, model, Answers.READS), {model.register("torque_enable"): 0}, keep=False
                    )
                    for step in told(off):
                        yield step.behind(flush) if isinstance(step, Exchange) else step
    yield Pause(0)  # until the last of it has left
