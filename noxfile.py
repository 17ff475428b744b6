"""What kinseek is tested with, beside what `.ci/run` has: other Pythons, the oldest and the newest libraries, known faults.

    pip install nox uv
    nox                     # all of it; a Python that is not there is left out
    nox -s tests-3.13       # one of them
    nox -s oldest newest audit
    nox -s coverage         # shown, and as pages in build/coverage
    nox -s nightly          # fuzz and soak, for an hour
    nox -s nightly -- --count 1000

Each has an environment of its own. The kernels are built anew in each, which takes a minute.
"""

from __future__ import annotations

import nox

nox.options.default_venv_backend = "uv|virtualenv"
nox.options.error_on_missing_interpreters = False
nox.options.reuse_existing_virtualenvs = True
nox.options.sessions = ("tests", "oldest", "newest", "audit")

PYTHONS = ("3.11", "3.12", "3.13", "3.14")
OLDEST = ("numpy==1.26.*", "numba==0.62.*", "click==8.1.*", "rich==13.*", "scipy==1.12.*")
"""The least that pyproject.toml allows of what the kernels and the command line stand on."""
TESTING = ("pytest>=8", "pytest-benchmark>=5", "pytest-xdist>=3.6", "hypothesis>=6.100", "scipy>=1.12")
PLAIN = (
    "tests/kernels/test_python_backend.py",
    "tests/robots/test_dh.py",
    "tests/robots/test_catalog.py",
    "tests/kernels/test_forward.py",
    "tests/kernels/test_layout.py",
    "tests/kernels/test_pointers.py",
)
"""Tests that run kernels as plain Python."""
QUICK = ("-m", "not slow", "-n", "2", "--dist", "loadfile")


def tested(session: nox.Session, *arguments: str) -> None:
    """Run the tests that need no extra but the command line; others skip themselves."""
    session.run("python", "-m", "pytest", "-q", *(session.posargs or QUICK), *arguments)


def tested_with_numba(session: nox.Session) -> None:
    """What only Numba compiles: where kernels run from the library, the tests above leave it alone."""
    session.run(
        "python", "-m", "pytest", "-q", "-m", "jit", "-n", "2", "--dist", "loadfile", env={"KINSEEK_JIT": "1"}
    )


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
    tested_with_numba(session)


@nox.session(python=PYTHONS[-1])
def newest(session: nox.Session) -> None:
    """The newest libraries, those before their release too, with the newest Python."""
    session.install("--pre", "--upgrade", "-e", ".[jit,cli]", *TESTING)
    tested(session)
    tested_with_numba(session)


@nox.session(python="3.11")
def audit(session: nox.Session) -> None:
    """Known faults of what is installed with kinseek, and a list of it (CycloneDX)."""
    session.install(".[cli]", "pip-audit>=2.7")
    session.run("pip-audit", "--skip-editable", "--format", "cyclonedx-json", "--output", "sbom.json")
    session.run("pip-audit", "--skip-editable")


@nox.session(python="3.11")
def nightly(session: nox.Session) -> None:
    """A hundred thousand fuzzed cases, others every day, then every call for ten minutes; less if arguments say so."""
    session.install("-e", ".[test]")
    session.run("python", "-m", "tests.fuzz", *session.posargs)
    session.run("python", "-m", "tests.soak", *(["30"] if session.posargs else []))


@nox.session(python="3.11")
def coverage(session: nox.Session) -> None:
    """Lines that the tests run: of the shell in the quick tests, of the kernels as plain Python. Shown, and as pages."""
    session.install("-e", ".[test]")
    measure = (
        "python",
        "-m",
        "coverage",
        "run",
        "--parallel-mode",
        "--source=src/kinseek",
        "-m",
        "pytest",
        "-q",
    )
    session.run("python", "-m", "coverage", "erase")
    session.run(*measure, *(session.posargs or ("-m", "not slow")), success_codes=[0, 1])
    session.run(*measure, *PLAIN, env={"NUMBA_DISABLE_JIT": "1"})
    session.run("python", "-m", "coverage", "combine")
    session.run("python", "-m", "coverage", "html", "--fail-under=0", "--directory=build/coverage")
    session.run("python", "-m", "coverage", "report", "--fail-under=0")
