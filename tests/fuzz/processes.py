"""Forks, pickles and copies at random moments, beside threads that make calls: each ends, with the bits of an arm at rest.

    python -m tests.fuzz.processes --count 200 --seed 0

In each case a thread makes one call of `tests/verbs.py` again and again, of an arm that was just loaded or that answered
before. At a random moment the main thread forks a child that makes a call, pickles the arm, or copies it. What counts as a
finding: a child that does not answer, other bits, any exception. Case i of a seed always makes the same calls.
"""

from __future__ import annotations

import argparse
import copy
import faulthandler
import importlib
import os
import pickle
import signal
import sys
import threading
import time
import warnings
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

import kinseek

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))
verbs: Any = importlib.import_module("verbs")

PATIENCE = 60
"""[s] after which a child, or the whole case, is given up."""
ACTIONS = ("fork", "fork", "pickle", "copy")
PYTHON = ("coordinate descent", "blind search", "divide and conquer", "brute force", "polished")
"""Searches that take long enough to be left out half of the time."""


@cache
def expected(name: str, verb: str, seed: int) -> bytes:
    """What a call gives where nothing else is done."""
    arm = verbs.arm_of(name)
    answer: bytes = verbs.VERBS[verb](arm, verbs.asked(arm, seed)).q.tobytes()
    return answer


def in_a_child(call: Any) -> str:
    """Fork, and have the child make a call that says what is wrong."""
    pid = os.fork()
    if pid == 0:
        signal.alarm(PATIENCE)
        try:
            wrong = call()
        except BaseException as error:
            wrong = f"{type(error).__name__}: {error}"
        if wrong:
            print(f"child: {wrong}", flush=True)
        os._exit(bool(wrong))
    status = os.waitpid(pid, 0)[1]
    if os.WIFSIGNALED(status) and os.WTERMSIG(status) == signal.SIGALRM:
        return "the child never answered"
    return f"the child ended with status {status}" if status else ""


def case(seed: int, number: int) -> str:
    """Run one case; say what was found, or nothing."""
    rng = np.random.default_rng([seed, number])
    name = str(rng.choice(verbs.ARMS))
    usual = [verb for verb in verbs.VERBS if verb not in PYTHON or rng.random() < 0.5]
    beside, verb = (str(rng.choice(usual)) for _ in range(2))
    action, which = str(rng.choice(ACTIONS)), int(rng.integers(3))
    answer = expected(name, verb, which)
    arm = kinseek.load(name) if rng.random() < 0.7 else verbs.arm_of(name)
    poses, over, errors = verbs.asked(verbs.arm_of(name), which), threading.Event(), list[BaseException]()

    def make_calls() -> None:
        try:
            while not over.is_set():
                verbs.VERBS[beside](arm, poses)
        except BaseException as error:
            errors.append(error)

    def differs(one: kinseek.Arm) -> str:
        return "" if verbs.VERBS[verb](one, poses).q.tobytes() == answer else "other bits"

    faulthandler.dump_traceback_later(3 * PATIENCE, exit=True)
    thread = threading.Thread(target=make_calls)
    thread.start()
    time.sleep(rng.uniform(0.0, 0.03))
    try:
        if action == "fork":
            wrong = in_a_child(lambda: differs(arm))
        else:
            again = pickle.loads(pickle.dumps(arm)) if action == "pickle" else copy.deepcopy(arm)
            wrong = differs(again)
    except Exception as error:
        wrong = f"{type(error).__name__}: {error}"
    finally:
        over.set()
        thread.join()
        faulthandler.cancel_dump_traceback_later()
    wrong = wrong or next((f"the thread: {error!r}" for error in errors), "")
    return f"{name}, {action} of {verb!r} beside {beside!r}: {wrong}" if wrong else ""


def main() -> int:
    """Run some cases, and say what was found."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--count", type=int, default=200)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--first", type=int, default=0)
    given = parser.parse_args()
    warnings.simplefilter("ignore", DeprecationWarning)  # Python 3.12 warns of every fork beside threads.
    began, findings = time.perf_counter(), 0
    for number in range(given.first, given.first + given.count):
        if finding := case(given.seed, number):
            findings += 1
            print(f"case {number}: {finding}", flush=True)
    print(
        f"{given.count} forks, pickles and copies, {findings} findings, {time.perf_counter() - began:.0f} s"
    )
    return int(findings > 0)


if __name__ == "__main__":
    sys.exit(main())
