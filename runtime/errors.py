"""The project's exceptions: every message says what is wrong, where, and what to do."""

import sys
from collections.abc import Callable
from unicodedata import category


class SportError(Exception):
    """Base of all errors that a user can cause or correct.

    `problem` names the file or field and what was expected; `remedy` says what to do about it.
    The command line prints `str(error)` and exits with 2; the viewer shows it in the status line.
    """

    def __init__(self, problem: str, remedy: str = "") -> None:
        self.problem = _shown(problem)
        self.remedy = _shown(remedy)
        super().__init__(f"{self.problem} {self.remedy}".strip())


def _shown(text: str) -> str:
    """Return `text` on one line, in characters that can be encoded: file names may be any bytes."""
    if text.isprintable():
        return text
    plain = text.encode("utf-8", "backslashreplace").decode("utf-8")
    return "".join(ascii(sign)[1:-1] if category(sign) in ("Cc", "Zl", "Zp") else sign for sign in plain)


class FileError(SportError):
    """A file is missing, damaged, too large or in the wrong format."""


class ModelError(SportError):
    """A network or its metadata is missing, damaged or of an unsupported version."""


class TerrainError(SportError):
    """A terrain name or height map cannot be used."""


class PromptError(SportError):
    """A prompt or body-part description cannot be used."""


class DisplayError(SportError):
    """No window or OpenGL context can be created."""


class UsageError(SportError):
    """An argument or setting has a value that cannot be used.

    `parameter` is the argument's name in the called function. `problem` begins with it, so that a front end
    can substitute its own name for it ("--seconds").
    """

    def __init__(self, problem: str, remedy: str = "", parameter: str = "") -> None:
        self.parameter = parameter
        super().__init__(f"{parameter}{problem}", remedy)


def run_command(name: str, command: Callable[[], int | None]) -> int:
    """Run a command and return its exit code: 2 for a SportError, printed in one sentence on stderr; 130 for Ctrl+C."""
    try:
        return command() or 0
    except SportError as error:
        print(f"{name}: {error}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        return 130
