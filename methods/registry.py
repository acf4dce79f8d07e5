"""Methods and their parts by the names that configurations use.

An installed package adds its own under the entry point group ``nrsfm_harness.algorithms``.
"""

from __future__ import annotations

import inspect
from collections.abc import Mapping
from functools import cache
from importlib.metadata import EntryPoint, entry_points
from typing import Any

from sklearn.base import BaseEstimator

from methods.adaptive import AdaptiveMultiBody
from methods.base import Method, MethodError
from methods.bmm import BMM
from methods.edsc import EDSC
from methods.multibody import MultiBody
from methods.pipelines import ClusterThenReconstruct, ClusterTracks, ReconstructThenCluster
from methods.ssc import SSC

ALGORITHMS: dict[str, type[BaseEstimator]] = {
    "ours": AdaptiveMultiBody,
    "ours_printed": MultiBody,
    "bmm": BMM,
    "ssc": SSC,
    "edsc": EDSC,
    "cluster_tracks": ClusterTracks,
    "reconstruct_then_cluster": ReconstructThenCluster,
    "cluster_then_reconstruct": ClusterThenReconstruct,
}


ENTRY_POINTS = "nrsfm_harness.algorithms"


def algorithm(name: object) -> type[BaseEstimator]:
    """The class of a name, ours or an installed package's; raises MethodError that lists the names."""
    if name in ALGORITHMS:
        return ALGORITHMS[str(name)]
    theirs = others()
    if name not in theirs:  # it may have come since
        others.cache_clear()
        theirs = others()
    if name not in theirs:
        raise MethodError(f"method.algorithm is {name!r}, which is none of {', '.join([*ALGORITHMS, *sorted(theirs)])}")
    try:
        found = theirs[str(name)].load()
    except Exception as error:
        raise MethodError(f"method {name} cannot be imported: {type(error).__name__}: {error}") from error
    if not (isinstance(found, type) and issubclass(found, BaseEstimator)):
        raise MethodError(f"method {name} is {found!r}, not a class that derives from methods.base.Method")
    return found


@cache
def others() -> Mapping[str, EntryPoint]:
    """The algorithms that installed packages add, by name; not imported yet."""
    return {entry.name: entry for entry in entry_points(group=ENTRY_POINTS)}


def build(settings: Mapping[str, Any]) -> BaseEstimator:
    """Make an algorithm from plain settings: ``algorithm`` names it, the rest are its hyper-parameters.

    A hyper-parameter that is itself a mapping with ``algorithm`` becomes a part, as a pipeline's clusterer.

    Raises
    ------
    MethodError
        If the algorithm is unknown, or a hyper-parameter is missing or not its own.
    """
    given = dict(settings)
    name = given.pop("algorithm", None)
    kind = algorithm(name)
    parameters = {k: build(v) if isinstance(v, Mapping) and "algorithm" in v else v for k, v in given.items()}
    try:
        inspect.signature(kind).bind(**parameters)
    except TypeError as error:
        known = ", ".join(inspect.signature(kind).parameters)
        raise MethodError(f"method {name}: {error}; its hyper-parameters are {known}") from None
    return kind(**parameters)


def build_method(settings: Mapping[str, Any]) -> Method:
    """:func:`build`, for something that a trial can run; raises MethodError for a mere part."""
    method = build(settings)
    if not isinstance(method, Method):
        raise MethodError(f"method.algorithm is {settings['algorithm']!r}, a part of methods and not one by itself")
    return method


def version(method: BaseEstimator) -> str:
    """Versions of a method and its parts, as ``cluster_tracks:1 ssc:1``."""
    names = {kind: name for name, kind in ALGORITHMS.items()}
    parts = [method, *(v for v in method.get_params(deep=False).values() if isinstance(v, BaseEstimator))]
    return " ".join(f"{names.get(type(p), type(p).__name__)}:{getattr(p, 'version', '1')}" for p in parts)
