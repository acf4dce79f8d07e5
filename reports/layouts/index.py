"""The layout of every experiment's table.

A new table is a new entry of :data:`~nrsfm.reports.layouts.paper_tables.PAPER_TABLES` or
:data:`~nrsfm.reports.layouts.study_tables.STUDY_TABLES`. An experiment without an entry gets a table all the same: its
columns are the methods that it asks for.
"""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

from nrsfm.reports.layouts.layout import Layout
from nrsfm.reports.layouts.paper_tables import PAPER_TABLES
from nrsfm.reports.layouts.study_tables import STUDY_TABLES

LAYOUTS: Mapping[str, Layout] = MappingProxyType({**PAPER_TABLES, **STUDY_TABLES})

#: Experiments that fill other tables than one of their own name.
FILLS: Mapping[str, tuple[str, ...]] = MappingProxyType({"tables": ("table1", "table2")})


def layout(experiment: str) -> Layout:
    """The layout of an experiment's table; both errors of whatever methods it asks for where it has no entry."""
    return LAYOUTS.get(experiment) or Layout(experiment, f"Experiment {experiment}: no published table.")
