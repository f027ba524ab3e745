"""The list of packets, to which only new ones are sent."""

from collections.abc import Sequence

from nicegui.element import Element

from servobus.server.web.traffic import Seen, servo_name

Row = tuple[str, str, str, str, str, str, str, str]
"""Time, who asked, direction, servo, words, bytes, latency, how the row looks."""
WAYS = {">": "→", "<": "←"}
MOST = 600
"""Rows in the browser."""
LONGEST_HEX = 48
"""Bytes of a packet that are shown."""


def row_of(seen: Seen) -> Row:
    """Give a packet as a row."""
    entry = seen.entry
    kind = "sb-bad" if entry["trouble"] else "" if entry["kind"] in ("request", "answer") else "sb-muted"
    latency = entry["latency"]
    return (
        f"{entry['time']:.3f}",
        seen.by,
        WAYS.get(entry["direction"] or "", "·"),
        servo_name(entry),
        entry["text"],
        _short_hex(entry["hex"]),
        "" if latency is None else f"{1000 * latency:.2f} ms",
        f"sb-log-{'in' if entry['direction'] == '<' else 'out'} {kind}".strip(),
    )


def _short_hex(hex: str) -> str:
    bytes_ = hex.split()
    return hex if len(bytes_) <= LONGEST_HEX else f"{' '.join(bytes_[:LONGEST_HEX])} … {len(bytes_)} bytes"


class PacketLog(Element, component="log.js"):
    """Shows packets, the newest at the bottom, and follows them as long as nobody scrolls back."""

    def __init__(self) -> None:
        super().__init__()
        self.props["most"] = MOST

    def add(self, seen: Sequence[Seen]) -> None:
        self.run_method("add", [row_of(one) for one in seen[-MOST:]])

    def replace(self, seen: Sequence[Seen]) -> None:
        self.run_method("replace", [row_of(one) for one in seen[-MOST:]])
