"""Moved; see servobus.families.base."""

from servobus.families.base import *  # noqa: F403
from servobus.families.base import blocks, cannot, check_output  # noqa: F401
from servobus.protocols.ids import BROADCAST, LAST_ID, check_id  # noqa: F401
