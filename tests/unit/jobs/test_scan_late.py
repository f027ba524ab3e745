"""Late answers in a scan: those to what was asked before it are none of its servos."""

from typing import Any

from servobus.core.exchange import Batch, LateAnswers, Lateness
from servobus.errors import NoReply
from servobus.families.registry import FAMILIES
from servobus.jobs.scan import ScanResult, scan

DYNAMIXEL = FAMILIES["dynamixel"]


def test_an_answer_to_an_earlier_question_is_not_looked_at() -> None:
    survey = ScanResult()
    job = scan([DYNAMIXEL], (57_600,), [1, 2], None, survey, lambda *_: None)
    late = Lateness(0.0, frozenset({(DYNAMIXEL.framing, 9)}), 0.0)
    answer: Any = None
    asked = []
    try:
        while True:
            step = job.send(answer)
            answer = None
            if isinstance(step, Batch):
                asked += [exchange.id for exchange in step.exchanges]
                answer = [NoReply("silence") for _ in step.exchanges]
            elif isinstance(step, LateAnswers):
                answer = late
    except StopIteration:
        pass
    assert set(asked) == {1, 2}
    assert survey.found == []
