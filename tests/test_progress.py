"""How far a job is, and what an interrupted job does."""

import _thread
import threading
import time

import pytest
from rich.console import Console

from jaxmuscle.cli import console as shown
from jaxmuscle.progress import Meter, Progress, Stopped, in_words, interruptible


def reports(*work, expected):
    told = []
    meter = Meter(told.append)
    meter.expect(expected)
    for each in work:
        meter.did(each, "at it")
    return told


def test_fraction_is_the_part_of_the_work_that_is_done():
    told = reports(0, 1, 2, 1, expected=4)
    assert [report.fraction for report in told] == [0, 0.25, 0.75, 1]
    assert told[-1].seconds_left == 0


def test_fraction_never_falls_when_more_work_is_found():
    told = []
    meter = Meter(told.append)
    meter.expect(2)
    meter.did(2, "first")
    meter.expect(6)
    meter.did(1, "second")
    meter.did(5, "third")
    assert [report.fraction for report in told] == [1, 1, 1]
    assert told[1].seconds_left > 0


def test_the_time_left_follows_the_speed_that_is_seen(monkeypatch):
    clock = iter([0.0, 100.0])
    monkeypatch.setattr(time, "monotonic", lambda: next(clock))
    (told,) = reports(30, expected=60)
    assert told.seconds_left == pytest.approx(30 * (100 + 10) / (30 + 10))


def test_work_that_was_not_needed_is_skipped():
    told = []
    meter = Meter(told.append)
    meter.expect(10)
    meter.did(1, "begin")
    meter.skip_to(2, "end")
    assert told[-1].fraction == 0.8


def test_work_of_an_earlier_run_says_nothing_of_the_speed(monkeypatch):
    monkeypatch.setattr(time, "monotonic", lambda: 100.0)
    told = []
    meter = Meter(told.append)
    meter.expect(60)
    meter.had(30, "searching")
    assert (told[0].fraction, told[0].seconds_left) == (0.5, 30.0)
    meter.stop()
    with pytest.raises(Stopped):
        meter.had(1, "more")


def test_a_report_is_a_line():
    assert str(Progress("trying creep", 0.336, 41.2)) == "trying creep (34%, about 41 s left)"
    assert in_words(99) == "99 s" and in_words(150) == "2 min"


def test_a_stopped_job_ends_at_its_next_report():
    meter = Meter(lambda _: None)
    meter.stop()
    with pytest.raises(Stopped):
        meter.did(1, "more")


def test_results_and_errors_come_through():
    assert interruptible(lambda: threading.current_thread() is threading.main_thread(), lambda: None) is False
    with pytest.raises(KeyError, match="lost"):
        interruptible(lambda: {}["lost"], lambda: None)


def test_in_another_thread_the_work_is_done_there():
    seen = []
    thread = threading.Thread(
        target=lambda: seen.append(interruptible(lambda: threading.current_thread() is thread, lambda: None))
    )
    thread.start()
    thread.join()
    assert seen == [True]


@pytest.mark.usefixtures("interrupts")
def test_ctrl_c_is_heard_while_the_work_does_not_listen():
    """As XLA does not, which holds the thread that compiles."""
    release, stopped = threading.Event(), []

    def deaf():
        _thread.interrupt_main()
        release.wait(30)

    begin = time.monotonic()
    with pytest.raises(KeyboardInterrupt):
        interruptible(deaf, lambda: stopped.append(True))
    release.set()
    assert stopped == [True]
    assert time.monotonic() - begin < 20


def test_lines_where_there_is_no_terminal(capsys, monkeypatch):
    """One for each new thing and each tenth; one more after some seconds of silence."""
    monkeypatch.setattr(shown, "HEARTBEAT", 0.2)
    with shown.progress() as tell:
        tell("loading")
        for done in range(0, 101, 5):
            tell(Progress("trying creep", done / 100, 10.0))
        time.sleep(1.5)
    told = capsys.readouterr()
    assert told.out == ""
    lines = told.err.splitlines()
    assert lines[:2] == ["loading", "trying creep (0%, about 10 s left)"]
    assert [line.split("(")[1].split("%")[0] for line in lines[1:12]] == [str(n) for n in range(0, 101, 10)]
    assert lines[12].startswith("… ") and "trying creep (100%" in lines[12]


def test_a_bar_with_the_fraction_and_the_time_left_in_a_terminal():
    console = Console(force_terminal=True, width=100, record=True)
    with shown._bar(console) as tell:
        tell("loading")
        tell(Progress("trying [creep]", 0.42, 12.0))
        time.sleep(0.3)
    text = console.export_text()
    assert "trying [creep]" in text and "42%" in text and "about 12 s left" in text
