"""Values by joint: what is there, and what could not be read."""

import pytest

from servobus.errors import NoReply
from servobus.robots.values import ByJoint


def test_values_are_complete_or_raise_what_came_instead_of_the_first() -> None:
    whole = ByJoint({"base": 0.5, "lift": -1.0})
    assert whole.complete() is whole
    with pytest.raises(NoReply, match="id 2"):
        ByJoint({"base": 0.5}, {"lift": NoReply("id 2"), "grip": NoReply("id 3")}).complete()
