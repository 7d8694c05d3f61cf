"""What one visitor has made serves the others."""

import threading
from dataclasses import dataclass

import pytest
from pfviz_app.shelf import Shelf


@dataclass(frozen=True)
class Thing:
    nbytes: int


class Maker:
    """Makes things, and counts them."""

    def __init__(self, nbytes=10):
        self.made = 0
        self._nbytes = nbytes

    def __call__(self):
        self.made += 1
        return Thing(self._nbytes)


def test_what_is_there_is_not_made_again():
    shelf, make = Shelf(100), Maker()
    first = shelf.get("a", make)
    assert shelf.get("a", make) is first
    assert shelf.get("b", make) is not first
    assert make.made == len(shelf) == 2


def test_what_was_not_used_for_longest_is_let_go():
    shelf, make = Shelf(30), Maker()
    for key in "abcabd":
        shelf.get(key, make)
    assert make.made == 4
    assert shelf.nbytes == 30
    for key, made in (("a", 4), ("b", 4), ("d", 4), ("c", 5)):
        shelf.get(key, make)
        assert make.made == made, key


def test_what_is_larger_than_the_shelf_is_kept_alone():
    shelf = Shelf(30)
    shelf.get("small", Maker())
    shelf.get("large", Maker(1000))
    assert (len(shelf), shelf.nbytes) == (1, 1000)
    shelf.get("small", Maker())
    assert (len(shelf), shelf.nbytes) == (1, 10)


def test_who_wants_it_while_it_is_made_waits_for_it():
    shelf, go, begun, found = Shelf(100), threading.Event(), threading.Event(), []

    def slowly():
        begun.set()
        assert go.wait(30.0)
        return Thing(1)

    def never():
        raise AssertionError("it was being made")

    first = threading.Thread(target=lambda: found.append(shelf.get("a", slowly)))
    first.start()
    assert begun.wait(30.0)
    others = [threading.Thread(target=lambda: found.append(shelf.get("a", never))) for _ in range(5)]
    for other in others:
        other.start()
    shelf.get("b", Maker())
    go.set()
    for thread in (first, *others):
        thread.join(30.0)
    assert len(found) == 6
    assert len(set(map(id, found))) == 1


def test_who_waits_tries_it_themselves_where_it_failed():
    shelf, go, begun = Shelf(100), threading.Event(), threading.Event()

    def fail():
        begun.set()
        assert go.wait(30.0)
        raise ValueError("no")

    def first():
        with pytest.raises(ValueError, match="no"):
            shelf.get("a", fail)

    found = []
    threads = [threading.Thread(target=first)]
    threads[0].start()
    assert begun.wait(30.0)
    threads.append(threading.Thread(target=lambda: found.append(shelf.get("a", Maker()))))
    threads[1].start()
    go.set()
    for thread in threads:
        thread.join(30.0)
    assert found == [Thing(10)]
    assert len(shelf) == 1
