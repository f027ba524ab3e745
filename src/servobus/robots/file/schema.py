"""The JSON Schema of robot files, made from the keys that `entries` declares: editors check and complete with it.

A schema sees one value at a time: what fits together is checked by `reading` alone.
"""

from importlib import resources
from typing import Any

from servobus.robots.file.entries import (
    FORMAT,
    JointEntry,
    MotionEntry,
    PortEntry,
    RobotEntry,
    StepEntry,
    keys_of,
)
from servobus.robots.file.kinds import NAME, Name, Names
from servobus.robots.file.reading import ANGLE, PARTS

DRAFT = "http://json-schema.org/draft-07/schema#"
"""The draft that editors of TOML know."""
FILE = "robot.schema.json"
"""The schema as a file of this package."""


def schema() -> dict[str, Any]:
    """Make the schema."""
    joint = _table(JointEntry)
    joint["properties"] |= {part: _table(entry) for part, entry in PARTS.items()}
    motion = _table(MotionEntry)
    step = _table(StepEntry) | {"anyOf": [{"required": ["pose"]}, {"required": ["joints"]}]}
    motion["properties"]["steps"] = {
        "type": "array", "items": step, "minItems": 1, "description": "Poses or angles of joints, and when.",
    }  # fmt: skip
    motion["oneOf"] = [{"required": ["steps"]}, {"required": ["file"]}]
    pose = {"type": "object", "additionalProperties": ANGLE.schema(), "minProperties": 1}
    return {
        "$schema": DRAFT,
        "title": f"servobus robot file, format {FORMAT}",
        "type": "object",
        "required": ["robot"],
        "additionalProperties": False,
        "properties": {
            "robot": _table(RobotEntry),
            "port": _named(_table(PortEntry), "The ports that the servos are on."),
            "joint": _named(joint, "The joints, each with one servo or two."),
            "group": {
                "type": "object",
                "description": "Names of joints that are asked and moved together.",
                "additionalProperties": Names(Name("joint")).schema(),
            },
            "pose": _named(pose, "Poses: joint -> angle."),
            "motion": _named(motion, "Motions: steps through poses, or a file of samples."),
        },
    }


def shipped() -> str:
    """Give the text of the schema that is part of this package."""
    return resources.files(__package__).joinpath(FILE).read_text(encoding="utf-8")


def _table(entry: type) -> dict[str, Any]:
    """Give the schema of a table by the keys that its entry declares."""
    keys = keys_of(entry)
    return {
        "type": "object",
        "description": " ".join((entry.__doc__ or "").split()),
        "required": [name for name, key in keys.items() if key.required],
        "additionalProperties": False,
        "properties": {name: key.kind.schema() | {"description": key.about} for name, key in keys.items()},
    }


def _named(table: dict[str, Any], about: str) -> dict[str, Any]:
    """Give the schema of tables that have names."""
    return {
        "type": "object",
        "description": about,
        "propertyNames": {"pattern": f"^{NAME}$"},
        "additionalProperties": table,
    }
