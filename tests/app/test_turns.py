"""Whoever asks first is first, and never more at once than may be."""

import threading
import time

from pfviz_app.turns import Turns


def test_no_more_than_the_limit_at_once_and_all_get_theirs():
    turns, lock = Turns(2), threading.Lock()
    inside, most, done = 0, 0, []

    def work(name):
        nonlocal inside, most
        for _ in range(20):
            with turns:
                with lock:
                    inside += 1
                    most = max(most, inside)
                time.sleep(0.0005)
                with lock:
                    inside -= 1
                    done.append(name)

    threads = [threading.Thread(target=work, args=(name,)) for name in range(5)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join(30.0)
    assert most == 2 and len(done) == 100
    firsts = done[:50]
    assert all(firsts.count(name) >= 5 for name in range(5)), "nobody waits while others have many turns"


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
