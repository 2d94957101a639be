"""pytest hooks: skip tests that need torch without it, and write the ids of skipped tests to a file."""

import importlib.util
from collections.abc import Iterator
from pathlib import Path

import pytest

NEEDS_TORCH = "needs torch: pip install -e '.[train]'"
WHOLE_FILE = "\npytestmark = pytest.mark.needs_torch\n"
HAS_TORCH = all(importlib.util.find_spec(name) for name in ("torch", "onnxscript"))


class SkippedFile(pytest.File):
    """Replaces a test file that is not imported, because it imports torch."""

    def collect(self) -> Iterator[pytest.Item]:
        yield _SkippedTests.from_parent(self, name="needs_torch", nodeid=self.nodeid)


class _SkippedTests(pytest.Item):
    def runtest(self) -> None:
        pytest.skip(NEEDS_TORCH)


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption(
        "--skipped", type=Path, metavar="FILE", help="write the ids of skipped tests into a file"
    )


def pytest_pycollect_makemodule(module_path: Path, parent: pytest.Collector) -> pytest.File | None:
    if HAS_TORCH or WHOLE_FILE not in module_path.read_text("utf-8"):
        return None
    return SkippedFile.from_parent(parent, path=module_path)


@pytest.hookimpl(tryfirst=True)
def pytest_runtest_setup(item: pytest.Item) -> None:
    if not HAS_TORCH and item.get_closest_marker("needs_torch"):
        pytest.skip(NEEDS_TORCH)


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter, config: pytest.Config) -> None:
    """Write the file of `--skipped`, whose tests `pytest @FILE` runs."""
    file = config.getoption("--skipped")
    if file is not None:
        skipped = {report.nodeid for report in terminalreporter.stats.get("skipped", ())}
        file.write_text("".join(f"{name}\n" for name in sorted(skipped)), "utf-8")
