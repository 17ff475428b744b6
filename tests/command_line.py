"""Commands of the command line, run in this process: how they end, and what they print."""

from __future__ import annotations

import json
import shlex
from typing import Any, NamedTuple

import pytest

from kinseek.cli import main


class Ended(NamedTuple):
    """What a command printed."""

    out: str
    err: str

    @property
    def facts(self) -> Any:
        """The output as JSON."""
        return json.loads(self.out)

    @property
    def rows(self) -> list[Any]:
        """Each line of the output as JSON."""
        return [json.loads(line) for line in self.out.splitlines()]

    @property
    def words(self) -> str:
        """Output and errors with one blank between words, wherever lines are broken."""
        return " ".join(f"{self.out} {self.err}".split())


class CommandLine:
    """Runs commands: ``cli("solve ur5e --at 0.4 0 0.3", "--near", *q, code=1)``.

    A text is divided into words as a shell does it; anything else, such as a path or a number, is one word.
    """

    def __init__(self, capture: pytest.CaptureFixture[str]) -> None:
        self._capture = capture

    def __call__(self, *words: object, code: int | tuple[int, ...] = 0) -> Ended:
        """Run a command that ends with this code, or with one of these."""
        given = [
            word for each in words for word in (shlex.split(each) if isinstance(each, str) else [str(each)])
        ]
        self._capture.readouterr()
        with pytest.raises(SystemExit) as ended:
            main(given)
        out, err = self._capture.readouterr()
        assert ended.value.code in ((code,) if isinstance(code, int) else code), (given, out, err)
        lines = [line for line in err.splitlines(keepends=True) if "compiling kernels" not in line]
        return Ended(out, "".join(lines))

    def refused(self, *words: object) -> str:
        """Run a command that is misuse: nothing is printed but one line, which is returned."""
        out, err = self(*words, code=2)
        assert out == ""
        assert err.startswith("kinseek: ")
        assert err.count("\n") == 1
        return err
