"""Methods and their parts by the names that configurations use."""

from __future__ import annotations

import inspect
from collections.abc import Mapping
from typing import Any

from sklearn.base import BaseEstimator

from methods.base import Method, MethodError
from methods.bmm import BMM
from methods.edsc import EDSC
from methods.multibody import MultiBody
from methods.pipelines import ClusterThenReconstruct, ClusterTracks, ReconstructThenCluster
from methods.ssc import SSC

ALGORITHMS: dict[str, type[BaseEstimator]] = {
    "ours": MultiBody,
    "bmm": BMM,
    "ssc": SSC,
    "edsc": EDSC,
    "cluster_tracks": ClusterTracks,
    "reconstruct_then_cluster": ReconstructThenCluster,
    "cluster_then_reconstruct": ClusterThenReconstruct,
}


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
    if name not in ALGORITHMS:
        raise MethodError(f"method.algorithm is {name!r}, which is none of {', '.join(ALGORITHMS)}")
    parameters = {k: build(v) if isinstance(v, Mapping) and "algorithm" in v else v for k, v in given.items()}
    kind = ALGORITHMS[name]
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
