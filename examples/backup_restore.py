"""Keep the settings of a servo in a file, spoil them, and get them back.

    python examples/backup_restore.py [PORT]

For one RX-28 with id 1. Without a port it takes a virtual one. Expect where the file is, the spoilt limit,
and the names of the two settings that had to be written back. Id and speed are never restored.
"""

import sys
import tempfile
from pathlib import Path

import servobus
from servobus import RX28, Backup, deg

port = sys.argv[1] if len(sys.argv) > 1 else "virtual:rx28@1?clock=virtual"
file = Path(tempfile.gettempdir()) / "rx28-1.toml"

with servobus.open(port) as bus:
    servo = bus.find(1, family="dynamixel")
    file.write_text(servo.backup().text(), encoding="utf-8")
    print(f"settings kept in {file}")

    servo.store({RX28.ccw_angle_limit: 200 * deg, RX28.max_torque: 0.5})
    print("spoilt: highest goal is", RX28.ccw_angle_limit.show(servo.read(RX28.ccw_angle_limit)))

    saved = Backup.parse(file.read_text(encoding="utf-8"))
    print("restored:", ", ".join(servo.restore(saved)))
