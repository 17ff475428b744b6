"""What kinseek is tested with, beside what `.ci/run` has: other Pythons, the oldest and the newest libraries, known faults.

    pip install nox uv
    nox                     # all of it; a Python that is not there is left out
    nox -s tests-3.13       # one of them
    nox -s oldest newest audit

Each has an environment of its own. The kernels are built anew in each, which takes a minute.
"""

from __future__ import annotations

import nox

nox.options.default_venv_backend = "uv|virtualenv"
nox.options.error_on_missing_interpreters = False
nox.options.reuse_existing_virtualenvs = True

PYTHONS = ("3.11", "3.12", "3.13", "3.14")
OLDEST = ("numpy==1.26.*", "numba==0.61.*", "click==8.1.*", "rich==13.*", "scipy==1.12.*")
"""The least that pyproject.toml allows of what the kernels and the command line stand on."""
TESTING = ("pytest>=8", "pytest-benchmark>=5", "pytest-xdist>=3.6", "hypothesis>=6.100", "scipy>=1.12")
QUICK = ("-m", "not slow", "-n", "2", "--dist", "loadfile")


def tested(session: nox.Session, *arguments: str) -> None:
    """Run the tests that need no extra but the command line; others skip themselves."""
    session.run("python", "-m", "pytest", "-q", *(session.posargs or QUICK), *arguments)


@nox.session(python=PYTHONS)
def tests(session: nox.Session) -> None:
    """The quick tests with a Python, everything as new as it comes."""
    session.install("-e", ".[test]")
    tested(session)


@nox.session(python="3.11")
def oldest(session: nox.Session) -> None:
    """The oldest libraries that are allowed, with the oldest Python."""
    session.install("-e", ".[jit,cli]", *TESTING, *OLDEST)
    tested(session)


@nox.session(python=PYTHONS[-1])
def newest(session: nox.Session) -> None:
    """The newest libraries, those before their release too, with the newest Python."""
    session.install("--pre", "--upgrade", "-e", ".[jit,cli]", *TESTING)
    tested(session)


@nox.session(python="3.11")
def audit(session: nox.Session) -> None:
    """Known faults of what is installed with kinseek, and a list of it (CycloneDX)."""
    session.install(".[cli]", "pip-audit>=2.7")
    session.run("pip-audit", "--skip-editable", "--format", "cyclonedx-json", "--output", "sbom.json")
    session.run("pip-audit", "--skip-editable")
