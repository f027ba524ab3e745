"""Parts of addresses that many routes share."""

from typing import Annotated

from fastapi import Path

BusName = Annotated[str, Path(alias="bus", max_length=60, description="the name of a bus")]
ServoName = Annotated[
    str,
    Path(
        alias="servo",
        max_length=80,
        description="FAMILY:ID@BAUD, such as dynamixel:1@57600; the id alone where it is unique on the bus",
    ),
]
RobotName = Annotated[str, Path(alias="robot", max_length=60, description="the name of a robot")]
