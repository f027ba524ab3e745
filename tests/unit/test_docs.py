"""The pages tell the truth: their Python runs, the generated ones are current, every decision is written down."""

import importlib.util
import os
import re
import subprocess
import sys
from functools import cache
from pathlib import Path
from types import ModuleType

import pytest

from servobus.families import registry

ROOT = Path(__file__).parents[2]
DOCS = ROOT / "docs"
PORTS = re.compile(r'"(?:/dev/tty\w+|COM\d+|socket://[^"]+|rfc2217://[^"]+)"')
VIRTUAL = '"virtual:rx28@1-2,drs0602@3,lx16a@4?clock=virtual"'
"""What a real port in a snippet is taken to be."""
REAL_TIME = re.compile(r'"(virtual:[^"?]+)"')
SNIPPET = re.compile(r"(<!-- not run -->\n)?```python\n(.*?)```", re.DOTALL)


def snippets(page: Path) -> list[tuple[int, str]]:
    """Give the Python of a page, each snippet with its line, less those marked as not to be run."""
    if not page.exists():
        return []
    text = page.read_text(encoding="utf-8")
    return [(text.count("\n", 0, match.start(2)), match[2]) for match in SNIPPET.finditer(text) if not match[1]]


@pytest.mark.parametrize(
    "page",
    [
        DOCS / "python.md",
        DOCS / "virtual.md",
        DOCS / "diagnosing.md",
        DOCS / "calibrating.md",
        DOCS / "motion.md",
        DOCS / "architecture.md",
        DOCS / "robot.md",
        ROOT / "README.md",
    ],
    ids=lambda page: page.name,
)
def test_snippets_run(page: Path, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """One after the other in one namespace, as a reader would try them."""
    if not page.exists():
        pytest.skip(f"there is no {page.name}")
    monkeypatch.chdir(tmp_path)
    shown = re.findall(r"^class (\w+)\(", page.read_text(encoding="utf-8"), re.MULTILINE)
    others = {key: model for key, model in registry.MODELS.entries.items() if model.__name__ not in shown}
    monkeypatch.setattr(registry.MODELS, "entries", others)  # what a page adds is known on that page alone
    monkeypatch.setattr(registry.FAMILIES, "entries", dict(registry.FAMILIES.entries))
    for name, table in re.findall(r"```toml\n# (\S+\.toml)\n(.*?)```", page.read_text(encoding="utf-8"), re.DOTALL):
        Path(name).write_text(REAL_TIME.sub(r'"\1?clock=virtual"', table), encoding="utf-8")
    names: dict[str, object] = {"__name__": "snippets"}
    for line, snippet in snippets(page):
        text = REAL_TIME.sub(r'"\1?clock=virtual"', PORTS.sub(VIRTUAL, snippet))
        code = "\n" * line + text
        exec(compile(code, str(page), "exec"), names)


@pytest.mark.parametrize(
    "page", [DOCS / "python.md", DOCS / "robot.md", DOCS / "virtual.md"], ids=lambda page: page.name
)
def test_pages_have_snippets(page: Path) -> None:
    assert snippets(page)


@pytest.mark.skipif(sys.platform == "win32", reason="there are no pseudo terminals")
def test_pytest_examples_pass(tmp_path: Path) -> None:
    """The tests of virtual.md, each in a file of its own, under a pytest of its own that has our plugin."""
    tests = [text for _, text in snippets(DOCS / "virtual.md") if "def test_" in text]
    assert len(tests) == 4
    for number, text in enumerate(tests):
        (tmp_path / f"test_{number}.py").write_text(text, encoding="utf-8")
    command = [sys.executable, "-m", "pytest", "-p", "no:cacheprovider", "-p", "servobus.pytest_plugin", str(tmp_path)]
    environment = os.environ | {"PYTEST_DISABLE_PLUGIN_AUTOLOAD": "1"}  # else an installed one would be there twice
    done = subprocess.run(command, capture_output=True, text=True, timeout=60, check=False, env=environment)
    assert done.returncode == 0, done.stdout
    assert "4 passed" in done.stdout


@pytest.mark.parametrize("page", sorted(DOCS.rglob("*.md")), ids=lambda page: page.name)
def test_links_lead_somewhere(page: Path) -> None:
    for target in re.findall(r"\]\(([^)#]*)(?:#[\w-]+)?\)", page.read_text(encoding="utf-8")):
        if target and "://" not in target:
            assert (page.parent / target).exists(), f"{page.name}: {target}"


def generator() -> ModuleType:
    spec = importlib.util.spec_from_file_location("generate", DOCS / "generate.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_generated_pages_are_current(capsys: pytest.CaptureFixture[str]) -> None:
    assert generator().main(["--check"]) == 0, capsys.readouterr().out


def test_a_stale_page_is_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    generate = generator()
    monkeypatch.setattr(generate, "imports", cache(generate.imports))  # all files of the package are read for it
    monkeypatch.setattr(generate, "PAGES", tmp_path)
    monkeypatch.setattr(generate, "ARCHITECTURE", tmp_path / "architecture.md")
    rooms = (DOCS / "architecture.md").read_text(encoding="utf-8")
    (tmp_path / "architecture.md").write_text(rooms.replace("| `core` |", "| `cellar` |"), encoding="utf-8")
    assert generate.main([]) == 0
    assert (tmp_path / "architecture.md").read_text(encoding="utf-8") == rooms
    assert generate.main(["--check"]) == 0
    (tmp_path / "rx28.md").write_text("old", encoding="utf-8")
    assert generate.main(["--check"]) == 1
    assert "docs/registers/rx28.md" in capsys.readouterr().out.splitlines()[-1]


def test_every_register_has_its_line() -> None:
    generate = generator()
    for key, model in generate.MODELS.items():
        text = (DOCS / "registers" / f"{key}.md").read_text(encoding="utf-8")
        for name in [*model.registers, *model.aliases]:
            assert f"\n| `{name}` |" in text, f"{key}: {name}"


NUMBER = re.compile(r"\bE[HDL]-\d\d\b")


def decided() -> list[str]:
    text = (DOCS / "decisions.md").read_text(encoding="utf-8")
    return re.findall(r"^- \*\*(E[HDL]-\d\d)\*\* ", text, re.MULTILINE)


def test_decisions_are_numbered_without_gaps() -> None:
    last = {"EH": 66, "ED": 56, "EL": 35}
    assert decided() == [f"{kind}-{number:02}" for kind in last for number in range(1, last[kind] + 1)]


@pytest.mark.parametrize("folder", ["src", "tests", "docs"])
def test_every_number_in_use_is_decided(folder: str) -> None:
    known = set(decided())
    for path in [*(ROOT / folder).rglob("*.py"), *(ROOT / folder).rglob("*.toml"), *(ROOT / folder).rglob("*.md")]:
        for number in NUMBER.findall(path.read_text(encoding="utf-8")):
            assert number in known, f"{path.relative_to(ROOT)}: {number}"
