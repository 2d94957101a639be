"""Tasks: `nox -s setup`, `test`, `lint`, `docs`, `bench`; all of them in the environment that is active."""

import nox

nox.options.default_venv_backend = "none"
nox.options.sessions = ["lint", "test"]


@nox.session
def setup(session: nox.Session) -> None:
    """Install the project for development, and the hooks that check a commit."""
    session.run("python", "-m", "pip", "install", "-c", "constraints.txt", "-e", ".[test,dev]")
    session.run("pre-commit", "install")


@nox.session
def test(session: nox.Session) -> None:
    """The tests, or those that are named: `nox -s test -- tests/viewer/session`."""
    session.run("python", "-m", "pytest", "-n", "auto", "--dist", "worksteal", *session.posargs)


@nox.session
def lint(session: nox.Session) -> None:
    """Lint, format and types."""
    session.run("ruff", "check", ".")
    session.run("ruff", "format", "--check", ".")
    session.run("mypy")


@nox.session
def docs(session: nox.Session) -> None:
    """The pictures of the documents."""
    session.run("bash", "docs/make_pictures.sh", external=True)


@nox.session
def bench(session: nox.Session) -> None:
    """Speed and memory on this machine."""
    session.run("sport", "bench", *session.posargs)
