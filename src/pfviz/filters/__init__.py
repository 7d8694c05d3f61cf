"""The filters, one file a family."""

from pfviz.filters.basic_sir import BasicSir
from pfviz.filters.condensation import Condensation
from pfviz.filters.rb_hs_sir import RbHsSir
from pfviz.filters.registry import FILTERS, Filter, FilterInfo, make_filter
from pfviz.filters.steps import FilterError

__all__ = [
    "FILTERS",
    "BasicSir",
    "Condensation",
    "Filter",
    "FilterError",
    "FilterInfo",
    "RbHsSir",
    "make_filter",
]
