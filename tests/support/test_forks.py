"""Forks beside threads: a child never waits for a thread that it does not have."""

from __future__ import annotations

import os
import subprocess
import sys
import threading
from pathlib import Path

import pytest

import kinseek
from kinseek.support import forks

pytestmark = pytest.mark.skipif(not hasattr(os, "fork"), reason="this system cannot fork")

BEGIN = """
import os, signal, sys, threading, time
import numpy as np
import kinseek

def child(call, seconds=5):
    pid = os.fork()
    if pid == 0:
        signal.alarm(seconds)
        try:
            call()
        except BaseException as error:
            print(repr(error), flush=True)
            os._exit(1)
        os._exit(0)
    return pid

def ended(pid):
    return os.waitpid(pid, 0)[1]
"""


def script(text: str, *words: str) -> str:
    """Run a script in a process of its own, whose threads are all known; give what it prints."""
    done = subprocess.run(
        [sys.executable, "-W", "ignore::DeprecationWarning", "-c", BEGIN + text, *words],
        capture_output=True,
        text=True,
        check=False,
        timeout=120,
    )
    assert (done.returncode, done.stderr) == (0, "")
    return done.stdout.strip()


def test_a_lock_is_free_in_a_child_and_held_in_the_parent() -> None:
    lock, taken, over = forks.Lock(), threading.Event(), threading.Event()

    def hold() -> None:
        with lock.now:
            taken.set()
            over.wait(10.0)

    holder = threading.Thread(target=hold)
    holder.start()
    taken.wait(10.0)
    pid = os.fork()
    if pid == 0:
        os._exit(not lock.now.acquire(timeout=5.0))
    assert os.waitpid(pid, 0)[1] == 0
    assert not lock.now.acquire(timeout=0.01)
    over.set()
    holder.join()
    with lock.now, lock.now:
        pass


def test_a_child_releases_what_its_own_thread_had_taken() -> None:
    lock = forks.Lock()
    with lock.now:
        pid = os.fork()
    if pid == 0:
        os._exit(not lock.now.acquire(timeout=5.0))
    assert os.waitpid(pid, 0)[1] == 0


@pytest.mark.slow
def test_a_child_answers_while_threads_of_its_parent_do() -> None:
    """Most children hang within some forks if a lock is left to them: each call makes new goals and problems."""
    told = script("""
arm = kinseek.load("ur5e")
poses = arm.fk(arm.sample(200, seed=1))
arm.ik(poses)
over = False

def work():
    while not over:
        arm.ik(poses[:8], threads=1)

threads = [threading.Thread(target=work) for _ in range(2)]
for thread in threads: thread.start()
hung = 0
for _ in range(40):
    hung += ended(child(lambda: arm.ik(poses[:8], threads=1), 2)) != 0
    if hung: break
over = True
for thread in threads: thread.join()
print(hung)
""")
    assert told == "0"


FIRST = """
from pathlib import Path
verb = sys.argv[1]
arm = kinseek.load("ur5e")
T = arm.fk(arm.sample(1, seed=1)[0])
path = Path(kinseek.__file__).parent / "robots" / "catalog" / "ur5e.urdf"
CALLS = {
    "ik": lambda: arm.ik(T),
    "ik with ranges": lambda: arm.ik(kinseek.Goal.pose(T, free="rz")),
    "branches": lambda: arm.branches(T),
    "follow": lambda: arm.follow(np.array([T, T])),
    "prove": lambda: arm.prove(T, budget=100),
    "a search": lambda: arm.ik(T, solver=kinseek.DivideAndConquer(breadth=1)),
    "load": lambda: kinseek.load(path).ik(T),
    "a scene": lambda: kinseek.Scene.of(arm, capsules=0.02).free(arm.sample(2)),
}
if verb == "again":
    for call in CALLS.values(): call()
    for name in list(CALLS): CALLS[name + ", another arm"] = CALLS.pop(name)
    arm = kinseek.load("ur5e")
    call = lambda: [call() for call in CALLS.values()]
else:
    call = CALLS[verb]
thread = threading.Thread(target=call)
thread.start()
children = []
while thread.is_alive() and len(children) < 12:
    children.append(child(call, 20))
    time.sleep(0.003)
thread.join()
print(sum(ended(pid) != 0 for pid in children))
"""


@pytest.mark.slow
@pytest.mark.parametrize(
    "verb", ["ik", "ik with ranges", "branches", "follow", "prove", "a search", "load", "again"]
)
def test_a_child_makes_the_call_that_a_thread_of_its_parent_makes_for_the_first_time(verb: str) -> None:
    """The thread imports what the call needs, and makes what the arm needs once."""
    assert script(FIRST, verb) == "0"


@pytest.mark.slow
def test_a_child_asks_a_scene_that_a_thread_of_its_parent_asks() -> None:
    pytest.importorskip("coal")
    assert script(FIRST, "a scene") == "0"
    told = script("""
arm = kinseek.load("ur5e")
scene = kinseek.Scene.of(arm, capsules=0.02)
scene.add_box("board", size=(0.02, 0.4, 0.4), pose=kinseek.pose([0.5, 0, 0.5]))
q = arm.sample(40, seed=1)
free = scene.free(q).tolist()
over = False

def work():
    clearance = 0.0
    while not over:
        clearance = 0.05 - clearance
        for one in q: scene.nearest(one)
        scene.free(q, clearance=clearance)

thread = threading.Thread(target=work)
thread.start()

def call():
    assert scene.free(q).tolist() == free

print(sum(ended(child(call)) != 0 for _ in range(25)))
over = True
thread.join()
""")
    assert told == "0"


@pytest.mark.slow
def test_a_fork_waits_until_another_thread_has_imported(tmp_path: Path) -> None:
    (tmp_path / "takes_long.py").write_text("import time\ntime.sleep(0.3)\ndone = 1\n", encoding="utf-8")
    told = script(
        """
sys.path.insert(0, sys.argv[1])
from kinseek.support.forks import importing

def work():
    with importing:
        import takes_long

def call():
    from takes_long import done
    with importing: pass

thread = threading.Thread(target=work)
thread.start()
time.sleep(0.1)
print(ended(child(call)))
thread.join()
with importing: pass
""",
        str(tmp_path),
    )
    assert told == "0"


@pytest.mark.slow
def test_what_the_first_fork_imports_registers_no_pairs_of_functions() -> None:
    told = script("""
from kinseek.support import forks
pairs = []
os.register_at_fork = lambda **functions: pairs.append(functions)
threading.Thread(target=lambda: time.sleep(0.5)).start()
forks._load()
print([sorted(each) for each in pairs if set(each) != {"after_in_child"}], forks._loaded)
""")
    assert told == "[] True"


def test_a_process_with_one_thread_imports_nothing_when_it_forks() -> None:
    told = script("""
before = set(sys.modules)
pid = child(lambda: None)
print(ended(pid), set(sys.modules) - before)
""")
    assert told == "0 set()"


def test_locks_stand_in_one_place() -> None:
    """Any other lock could be left held to a child: those here are of threads and pages that no child goes on with."""
    package = Path(kinseek.__file__).parent
    kinds = ("Lock()", "RLock()", "Condition()", "Event()", "Semaphore(", "Barrier(")
    found = {
        path.relative_to(package).as_posix()
        for path in package.rglob("*.py")
        if any(f"threading.{kind}" in path.read_text("utf-8") for kind in kinds)
    }
    assert found == {
        "kernels/compiler.py",
        "maps/processes.py",
        "robots/xacro.py",
        "solvers/threads.py",
        "viewer/page.py",
        "viewer/server.py",
        "viewer/workers.py",
    }


def test_a_fork_waits_for_an_import_that_asks_for_a_logger() -> None:
    told = script("""
import logging  # After kinseek.
from kinseek.support import forks
taken = threading.Event()
def imports():
    with forks.importing:
        taken.set()
        time.sleep(0.2)
        logging.getLogger("of the package that is imported")
threading.Thread(target=imports).start()
taken.wait()
signal.alarm(10)
print(ended(child(lambda: None)))
""")
    assert told == "0"


@pytest.mark.jit
@pytest.mark.slow
def test_a_fork_waits_until_another_thread_has_compiled(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("KINSEEK_JIT", "1")
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path))
    told = script("""
from numba.core.compiler_lock import global_compiler_lock
sys.stderr = open(os.devnull, "w")  # It says that kernels are compiled.
arm = kinseek.load("planar2")
q = np.zeros((3, 2))
thread = threading.Thread(target=lambda: arm.fk(q))
thread.start()
while thread.is_alive() and global_compiler_lock._lock.acquire(blocking=False):
    global_compiler_lock._lock.release()
    time.sleep(0.001)
print(ended(child(lambda: arm.jacobian(q), 100)))
thread.join()
""")
    assert told == "0"
