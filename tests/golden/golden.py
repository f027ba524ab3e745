"""Packets of the manuals, as files of facts.

A file `tests/golden/<family>.toml` holds one table per packet:

    [[packet]]
    name = "eep_read_request"
    section = "6-1 Example 1"           where it is printed; "" where no manual prints it
    source = "..."                      who shows it instead, or how it was made
    packet = "FF FF 09 FD 02 EC 12 1E 04"
    kind = "EepRead"                    the class of the message in the protocol's module
    fields = { id = 253, address = 30, length = 4 }
    registers = { position_kp = 440 }   raw register values that stand in the message's data
    printed = "..."                     what the manual shows instead, where it has a misprint
    fault = "..."                       what is wrong with it
    earlier = "..."                     the packet as an earlier edition of the manual has it

`packet` is always a good packet that means what `kind` and `fields` say. `printed` never is one.
The expected bytes come from here and from nowhere else.
"""

import tomllib
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any


@dataclass(frozen=True)
class Case:
    """One packet."""

    name: str
    packet: bytes
    kind: str
    fields: dict[str, Any] = field(default_factory=dict)
    section: str = ""
    source: str = ""
    registers: dict[str, int] = field(default_factory=dict)
    printed: bytes | None = None
    fault: str = ""
    earlier: bytes | None = None

    @property
    def valid(self) -> bool:
        """Whether the manual prints the packet right, or does not print it."""
        return self.printed is None

    def __str__(self) -> str:
        return self.name


def load(name: str) -> list[Case]:
    """Read `tests/golden/<name>.toml`; `packet`, `printed`, `earlier` and a `data` field become bytes."""
    text = Path(__file__).with_name(f"{name}.toml").read_text(encoding="utf-8")
    cases = [_case(row) for row in tomllib.loads(text)["packet"]]
    names = [case.name for case in cases]
    assert len(set(names)) == len(names), "two packets have one name"
    return cases


def _case(row: dict[str, Any]) -> Case:
    for key in ("packet", "printed", "earlier"):
        if key in row:
            row[key] = bytes.fromhex(row[key])
    fields = row.get("fields", {})
    if isinstance(fields.get("data"), str):
        fields["data"] = bytes.fromhex(fields["data"])
    return Case(**row)
