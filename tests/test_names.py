"""Looking up names."""

import pytest

from pfviz.names import UnknownName, find


def test_what_is_there_is_found():
    assert find({"a": 1}, "a", "letter") == 1


def test_the_nearest_name_is_suggested():
    with pytest.raises(UnknownName, match=r"unknown filter 'condensaton': did you mean 'condensation'\?"):
        find({"condensation": 1, "basic-sir": 2}, "condensaton", "filter")


def test_all_names_are_given_where_none_is_near():
    with pytest.raises(UnknownName, match="unknown filter 'zzz': there are condensation, basic-sir"):
        find({"condensation": 1, "basic-sir": 2}, "zzz", "filter")
