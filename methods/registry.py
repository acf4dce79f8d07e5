"""Methods and their parts by the names that configurations use.

A module ``methods/NAME.py`` with one class needs no entry here. An installed package adds methods by entry points of
the group ``nrsfm.methods``, ``NAME = "package.module:Class"``.
"""

from __future__ import annotations

import inspect
from collections.abc import Mapping
from functools import cache
from importlib import import_module
from importlib.metadata import EntryPoint, entry_points
from importlib.util import find_spec
from typing import Any

from sklearn.base import BaseEstimator

from nrsfm.methods import ENTRY_POINTS
from nrsfm.methods.base import Method, MethodError
from nrsfm.methods.clustering.edsc import EDSC
from nrsfm.methods.clustering.ensc import EnSC
from nrsfm.methods.clustering.lrr import LRR
from nrsfm.methods.clustering.lsr import LSR
from nrsfm.methods.clustering.neighbours import Neighbours
from nrsfm.methods.clustering.ssc import SSC
from nrsfm.methods.clustering.ssc_omp import SSCOMP
from nrsfm.methods.multibody.adaptive import AdaptiveMultiBody
from nrsfm.methods.multibody.printed import MultiBody
from nrsfm.methods.pipelines import ClusterThenReconstruct, ClusterTracks, ReconstructThenCluster
from nrsfm.methods.structure.bmm import BMM
from nrsfm.methods.structure.csf import CSF
from nrsfm.methods.structure.pnd import PND
from nrsfm.methods.structure.pta import PTA
from nrsfm.methods.structure.smooth_bmm import SmoothBMM
from nrsfm.methods.structure.weighted_bmm import WeightedBMM

ALGORITHMS: dict[str, type[BaseEstimator]] = {
    "adaptive": AdaptiveMultiBody,
    "ours": MultiBody,
    "bmm": BMM,
    "smooth_bmm": SmoothBMM,
    "weighted_bmm": WeightedBMM,
    "pta": PTA,
    "csf": CSF,
    "pnd": PND,
    "ssc": SSC,
    "ssc_omp": SSCOMP,
    "edsc": EDSC,
    "ensc": EnSC,
    "lrr": LRR,
    "lsr": LSR,
    "neighbours": Neighbours,
    "cluster_tracks": ClusterTracks,
    "reconstruct_then_cluster": ReconstructThenCluster,
    "cluster_then_reconstruct": ClusterThenReconstruct,
}


def algorithm(name: object) -> type[BaseEstimator]:
    """The class of a name: of this package, of ``methods/NAME.py``, or of an installed package.

    Raises
    ------
    MethodError
        If no class has the name, with the names that there are; or if the class cannot be imported or is no estimator.
    """
    if name in ALGORITHMS:
        return ALGORITHMS[str(name)]
    word = str(name)
    if kind := _of_module(word):
        return kind
    if word not in others():  # a package may have been installed since
        others.cache_clear()
    if word not in others():
        names = ", ".join([*ALGORITHMS, *sorted(others())])
        raise MethodError(f"method.algorithm is {name!r}, which is none of {names}")
    return _of_package(others()[word])


def provider(name: object) -> EntryPoint | None:
    """The entry point of the installed package that has an algorithm; None for one of this package, or for none.

    Raises MethodError if ``methods/NAME.py`` exists and cannot be imported.
    """
    return None if name in ALGORITHMS or _of_module(str(name)) else others().get(str(name))


def _of_module(name: str) -> type[BaseEstimator] | None:
    """The one public estimator that ``methods/NAME.py`` defines; None if there is no such module or estimator."""
    if not (name.isidentifier() and find_spec(f"nrsfm.methods.{name}")):
        return None
    try:
        module = import_module(f"nrsfm.methods.{name}")
    except Exception as error:
        raise MethodError(f"methods/{name}.py cannot be imported: {type(error).__name__}: {error}") from error
    kinds = [
        kind
        for kind in vars(module).values()
        if isinstance(kind, type)
        and issubclass(kind, BaseEstimator)
        and kind.__module__ == module.__name__
        and not kind.__name__.startswith("_")
    ]
    if len(kinds) > 1:
        names = ", ".join(kind.__name__ for kind in kinds)
        raise MethodError(f"methods/{name}.py defines {names}; wanted one class, or entries in methods/registry.py")
    return kinds[0] if kinds else None


def _of_package(entry: EntryPoint) -> type[BaseEstimator]:
    """The class of an installed package's entry point."""
    package = entry.dist.name if entry.dist else "?"
    where = f"method {entry.name} of the installed package {package}"
    try:
        kind = entry.load()
    except Exception as error:
        raise MethodError(
            f"{where} cannot be imported: {type(error).__name__}: {error}; mend it or uninstall {package}"
        ) from error
    if not (isinstance(kind, type) and issubclass(kind, BaseEstimator)):
        raise MethodError(f"{where} is {kind!r}, not a class that derives from nrsfm.methods.base.Method")
    return kind


@cache
def others() -> Mapping[str, EntryPoint]:
    """The algorithms of installed packages by name, not imported yet. Of several with one name the first counts."""
    return {entry.name: entry for entry in reversed(tuple(entry_points(group=ENTRY_POINTS)))}


def build(settings: Mapping[str, Any]) -> BaseEstimator:
    """Make an algorithm from plain settings: ``algorithm`` is its name, the rest are its hyper-parameters.

    A hyper-parameter that is itself a mapping with ``algorithm`` becomes a part, such as a pipeline's clusterer.

    Raises
    ------
    MethodError
        If the algorithm is unknown, a hyper-parameter is missing or unknown, or the constructor fails or does not keep
        its hyper-parameters.
    """
    name = settings.get("algorithm")
    kind = algorithm(name)
    parameters = {
        key: build(value) if isinstance(value, Mapping) and "algorithm" in value else value
        for key, value in settings.items()
        if key != "algorithm"
    }
    try:
        inspect.signature(kind).bind(**parameters)
    except TypeError as error:
        known = ", ".join(inspect.signature(kind).parameters)
        raise MethodError(f"method {name}: {error}; its hyper-parameters are {known}") from None
    try:
        estimator = kind(**parameters)
        estimator.get_params()
    except Exception as error:
        raise MethodError(f"method {name} cannot be made: {type(error).__name__}: {error}") from error
    return estimator


def build_method(settings: Mapping[str, Any]) -> Method:
    """:func:`build` for a method that a trial can run; raises MethodError for a part, such as a clusterer."""
    method = build(settings)
    if not isinstance(method, Method):
        raise MethodError(f"method.algorithm is {settings['algorithm']!r}, a part of methods and not one by itself")
    return method


def version(method: BaseEstimator) -> str:
    """Versions of a method and its parts, as ``cluster_tracks:1 ssc:1``."""
    names = {kind: name for name, kind in ALGORITHMS.items()}
    parts = [method, *(v for v in method.get_params(deep=False).values() if isinstance(v, BaseEstimator))]
    return " ".join(f"{names.get(type(p), type(p).__name__)}:{getattr(p, 'version', '1')}" for p in parts)
