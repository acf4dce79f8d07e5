"""The names of methods for readers."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

from nrsfm.harness.record.text import one_line

LABELS: Mapping[str, str] = MappingProxyType(
    {
        "ours": "Ours",
        "ours_c": "Ours, C",
        "ours_cd": "Ours, C and D",
        "adaptive": "Adaptive (this project)",
        "adaptive_apart": "Adaptive, not coupled",
        "adaptive_no_order": "Adaptive, no order in time",
        "adaptive_no_nuclear": "Adaptive, no nuclear norm",
        "adaptive_not_whitened": "Adaptive, not whitened",
        "ours_exact": "Ours, exact diagonal",
        "ours_diag": "Ours, C - diag(C)",
        "ours_no_nuclear": "Ours, no nuclear norm",
        "bmm": "BMM",
        "smooth_bmm": "Smooth BMM",
        "r_bmm": "R-BMM",
        "organic": "Organic priors",
        "pta": "PTA",
        "csf1": "CSF",
        "csf2": "CSF2",
        "pnd": "PND",
        "edsc": "EDSC",
        "edsc_dim15": "EDSC, Dim 15",
        "ssc2d": "SSC(2D)",
        "ssc2d_share70": "SSC(2D), share .7",
        "bmm_ssc3d": "BMM + SSC(3D)",
        "bmm_ssc3d_k11": "BMM, K = 11, + SSC(3D)",
        "bmm_ssc3d_share70": "BMM + SSC(3D), share .7",
        "ssc2d_bmm": "SSC(2D) + BMM",
        "ssc2d_bmm_share70": "SSC(2D) + BMM, share .7",
        "omp2d": "SSC-OMP(2D)",
        "lrr2d": "LRR(2D)",
        "ensc2d": "EnSC(2D)",
        "lsr2d": "LSR(2D)",
        "neighbours2d": "Nearest neighbours",
        "bmm_lrr3d": "BMM + LRR(3D)",
        "pta_ssc3d_share70": "PTA + SSC(3D), share .7",
        "ssc_raw": "SSC",
        "ssc_raw_4n": "SSC, 4n dimensions",
        "edsc_raw": "EDSC",
        "lrr_raw": "LRR",
    }
)


def method_label(method: str) -> str:
    """A method's label; its name on one line for a method that has none."""
    return LABELS.get(method, one_line(method, 60))
