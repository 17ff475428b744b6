"""Read the meshes of a robot: those that other libraries read, in a process of its own with limits of memory and time.

The libraries that read XML, materials and images trust what a file declares. `limits` and the readers reject what is
known to make them compute for hours or fill the memory. Whatever else does so ends that process, and this one goes on.
"""

from __future__ import annotations

import pickle
from functools import partial
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from kinseek.errors import InvalidRobot
from kinseek.support.interrupts import uninterrupted
from kinseek.support.workers import Worker, WorkerDied, limit_process

from .limits import Budget, ending
from .parts import MOST_MESH, import_trimesh, mesh_parts

MOST_MEMORY = 2**32
"""Most bytes of memory of the process."""
MOST_SECONDS = 120
"""Most processor time of the process, which reads all meshes of a robot [s]."""

_IN_PROCESS = ("dae", "glb")
"""Formats that the process reads; OBJ, too, if its materials are read."""
_ONE_THREAD = {f"{each}_NUM_THREADS": "1" for each in ("MKL", "OMP", "OPENBLAS")}
"""Environment of the process: each thread of a numerical library would take a part of its memory."""


class MeshReader:
    """Reads the meshes of one robot or one file of obstacles, which share a budget."""

    def __init__(self, budget: Budget, looks: bool = True) -> None:
        """Prepare; the process starts with the first mesh that needs it.

        Args:
            budget: What all the meshes may take together.
            looks: Read their colours, materials and images, too?
        """
        self.budget, self._looks = budget, looks
        self._worker: Worker | None = None
        self._ended = ""

    def __enter__(self) -> MeshReader:
        """End the process at the end of the block."""
        return self

    def __exit__(self, *raised: object) -> None:
        """As `close`."""
        self.close()

    def close(self) -> None:
        """End the process."""
        if self._worker is not None:
            self._worker.close()

    def read(self, path: Path, most: int = MOST_MESH) -> list[Any]:
        """Read a mesh, see `mesh_parts`.

        Raises:
            InvalidRobot: As there; or its reader took too much memory or time, or none can be started.
            ImportError: trimesh is not installed.
        """
        kind = ending(path)
        if kind not in _IN_PROCESS and not (kind == "obj" and self._looks):
            return mesh_parts(path, most, budget=self.budget, looks=False)
        if self._ended:
            raise InvalidRobot(f"{str(path)!r} is not read: {self._ended}")
        if find_spec("trimesh") is None:
            raise ImportError("trimesh is not installed")
        try:
            self.budget, found = uninterrupted(lambda: self._ask(path, most), self._kill)
        except WorkerDied as error:
            self._ended = f"the process that reads meshes ended {error}"
            raise InvalidRobot(f"{str(path)!r} cannot be read: {self._ended}") from None
        if isinstance(found, str):
            raise InvalidRobot(found)
        parts: list[Any] = pickle.loads(found)
        return parts

    def _ask(self, path: Path, most: int) -> Any:
        """Let the process answer a request, see `answer`."""
        if self._worker is None:
            self._worker = Worker(_ONE_THREAD)
            if self._ended:  # `_kill` came before there was a process.
                raise WorkerDied(self._ended)
            import_trimesh()  # The process imports it at the same time.
            self._worker.begin(partial(answer, MOST_MEMORY, MOST_SECONDS))
        when = f"at {str(path)!r}; all meshes of a robot may take {MOST_SECONDS} s and {MOST_MEMORY:,} bytes of memory"
        return self._worker.compute((path, most, self.budget, self._looks), when)

    def _kill(self) -> None:
        """End the process after a signal handler has raised an exception; another thread waits for its answer."""
        self._ended = "the process that reads meshes was interrupted"
        if self._worker is not None:
            self._worker.kill()


def answer(memory: int, seconds: int, request: tuple[Path, int, Budget, bool]) -> tuple[Budget, bytes | str]:
    """Read a mesh in the process: return what is left of the budget, and the bodies, or why they cannot be read."""
    limit_process(memory, seconds)
    path, most, budget, looks = request
    try:
        parts = mesh_parts(path, most, budget=budget, looks=looks)
        for part in parts:  # Two bytes of the reply can be a dictionary there, of which each body has a copy.
            part.metadata.clear()
        reply = pickle.dumps(parts)
        budget.take_unpacked(len(reply))
    except InvalidRobot as error:
        return budget, str(error)
    except MemoryError:
        return budget, f"{str(path)!r} cannot be read: it takes more than {memory:,} bytes of memory"
    return budget, reply
