"""The filters, one file each."""

from pfviz.filters.auxiliary import Auxiliary
from pfviz.filters.basic_sir import BasicSir
from pfviz.filters.condensation import Condensation
from pfviz.filters.hs_sir import HsSir
from pfviz.filters.icondensation import ICondensation
from pfviz.filters.innovation_sir import InnovationSir
from pfviz.filters.local_search import LocalSearch
from pfviz.filters.ls_hs_sir import LsHsSir
from pfviz.filters.ls_n_ips import LsNIps
from pfviz.filters.rb_hs_sir import RbHsSir
from pfviz.filters.registry import FILTERS, Filter, FilterInfo, make_filter
from pfviz.filters.steps import FilterError
from pfviz.filters.unscented import Unscented

__all__ = [
    "FILTERS",
    "Auxiliary",
    "BasicSir",
    "Condensation",
    "Filter",
    "FilterError",
    "FilterInfo",
    "HsSir",
    "ICondensation",
    "InnovationSir",
    "LocalSearch",
    "LsHsSir",
    "LsNIps",
    "RbHsSir",
    "Unscented",
    "make_filter",
]
