"""Work that Ctrl-C does not tear: what it gives, what it raises, and what is stopped and waited for."""

from __future__ import annotations

import signal
import threading
import time

import pytest

from kinseek.undisturbed import undisturbed


def test_it_gives_what_the_work_gives_in_a_thread_of_its_own() -> None:
    thread = undisturbed(threading.current_thread)
    assert thread is not threading.main_thread()


def test_it_raises_what_the_work_raises() -> None:
    with pytest.raises(ZeroDivisionError):
        undisturbed(lambda: 1 // 0)


def test_who_waits_hears_that_there_are_no_more_threads(monkeypatch: pytest.MonkeyPatch) -> None:
    def start(thread: threading.Thread) -> None:
        raise RuntimeError("can't start new thread")

    monkeypatch.setattr(threading.Thread, "start", start)
    with pytest.raises(RuntimeError, match="can't start"):
        undisturbed(lambda: 1)


@pytest.mark.skipif(not hasattr(signal, "setitimer"), reason="no timers that interrupt")
def test_an_interrupt_stops_the_work_and_waits_for_its_end() -> None:
    stopped, ended = threading.Event(), threading.Event()

    def work() -> None:
        stopped.wait(10.0)
        time.sleep(0.02)
        ended.set()

    handler = signal.signal(signal.SIGALRM, signal.default_int_handler)
    try:
        signal.setitimer(signal.ITIMER_REAL, 0.05)
        with pytest.raises(KeyboardInterrupt):
            undisturbed(work, stop=stopped.set)
    finally:
        signal.signal(signal.SIGALRM, handler)
    assert ended.is_set()
