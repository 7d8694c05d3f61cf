"""Whoever asks first is first, and never more at once than may be."""

import threading
import time

from pfviz_app import turns
from pfviz_app.turns import Allowance, Turns


def test_whoever_asks_first_is_first():
    turns, order, threads = Turns(1), [], []

    def work(name):
        with turns:
            order.append(name)

    with turns:
        for name in range(5):
            threads.append(threading.Thread(target=work, args=(name,)))
            threads[-1].start()
            while len(turns._waiting) <= name:
                time.sleep(0.001)
    for thread in threads:
        thread.join(30.0)
    assert order == [0, 1, 2, 3, 4]


def test_no_more_than_the_limit_are_in_at_once():
    turns, lock = Turns(2), threading.Lock()
    inside, most, done = 0, 0, 0

    def work():
        nonlocal inside, most, done
        for _ in range(20):
            with turns:
                with lock:
                    inside += 1
                    most = max(most, inside)
                time.sleep(0.0005)
                with lock:
                    inside, done = inside - 1, done + 1

    threads = [threading.Thread(target=work) for _ in range(5)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join(30.0)
    assert most <= 2 and done == 100


def test_a_turn_is_given_back_when_its_work_fails():
    turns = Turns(1)
    for _ in range(3):
        try:
            with turns:
                raise ValueError
        except ValueError:
            pass
    with turns:
        assert turns._free == 0
    assert turns._free == 1


def test_an_allowance_is_spent_and_comes_back(monkeypatch):
    now = [100.0]
    monkeypatch.setattr(turns.time, "monotonic", lambda: now[0])
    charts = Allowance(0.05)
    assert charts.left
    charts.spend(0.01)
    assert not charts.left
    now[0] += 0.199
    assert not charts.left
    now[0] += 0.002
    assert charts.left
    charts.spend(0.01)
    charts.spend(0.01)
    now[0] += 0.399
    assert not charts.left
    now[0] += 0.002
    assert charts.left
