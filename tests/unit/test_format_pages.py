"""What formats.md and migrating.md show is so: their files, commands and Python run in the order in which they stand.

<!-- file: NAME -->      the block is written as this file
<!-- printed -->         the block is what the commands before it printed
<!-- written: NAME -->   the block is what is in this file now
"""

import re
import shlex
from pathlib import Path

import pytest
from click.testing import CliRunner

from servobus.cli.app import app

DOCS = Path(__file__).parents[2] / "docs"
BLOCK = re.compile(
    r"(?:<!-- (?P<mark>file|printed|written|not run)(?:: (?P<name>\S+))? -->\n)?```(?P<kind>\w*)\n(?P<text>.*?)```",
    re.DOTALL,
)
COMMENT = re.compile(r"\s+# .*")
PORT = "/dev/ttyUSB0"
SERVOS = "virtual:rx28@1-2,lx16a@4?clock=virtual"
"""What PORT in Python is taken to be."""
FAST = "virtual:rx28@1-2?baud=1000000&clock=virtual"
"""What it is taken to be in commands of migrating.md: a robot that pypot could drive."""


def run(commands: str) -> str:
    """Run the commands of a block; give what they printed."""
    printed = ""
    for line in commands.splitlines():
        words = shlex.split(COMMENT.sub("", line))
        assert words[0] == "servobus", line
        result = CliRunner().invoke(app, words[1:], prog_name="servobus")
        assert result.exit_code == 0, f"{line}\n{result.output}"
        printed += result.stdout
    return printed


@pytest.mark.parametrize("page", ["formats.md", "migrating.md"])
def test_the_page_runs_as_it_stands(page: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, no_home: None) -> None:
    monkeypatch.chdir(tmp_path)
    printed = ""
    names: dict[str, object] = {"__name__": "page"}
    text = (DOCS / page).read_text(encoding="utf-8")
    for match in BLOCK.finditer(text):
        mark, kind, block = match["mark"], match["kind"], match["text"]
        if mark == "file":
            Path(match["name"]).write_text(block, encoding="utf-8")
        elif mark == "printed":
            assert printed.rstrip() == block.rstrip(), match["text"]
        elif mark == "written":
            assert Path(match["name"]).read_text(encoding="utf-8") == block
        elif kind == "sh" and mark is None:
            printed = run(block.replace(PORT, f"'{FAST}'") if page == "migrating.md" else block)
        elif kind == "python" and mark is None:
            line = text.count("\n", 0, match.start("text"))
            exec(compile("\n" * line + block.replace(PORT, SERVOS), page, "exec"), names)
