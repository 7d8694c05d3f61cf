"""A stumble of viser's is not a visitor's trouble; other errors are."""

import pytest
from pfviz_app.sending import send


def failing(*errors):
    """An action that raises these one by one and then does its work."""
    waiting, done = list(errors), []

    def action():
        if waiting:
            raise waiting.pop(0)
        done.append(True)

    return action, done


def test_a_stumble_is_tried_again():
    action, done = failing(*[RuntimeError("deque mutated during iteration")] * 2)
    send(action)
    assert done == [True]


@pytest.mark.parametrize("error", [RuntimeError("removed handle"), ValueError("deque mutated during iteration")])
def test_other_errors_are_not(error):
    action, done = failing(error)
    with pytest.raises(type(error)):
        send(action)
    assert done == []


def test_it_does_not_stumble_for_ever():
    action, _ = failing(*[RuntimeError("deque mutated during iteration")] * 50)
    with pytest.raises(RuntimeError):
        send(action)
