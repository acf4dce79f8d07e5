"""What other papers print for the same data: e_3D by method, beside the measured tables and without a verdict."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

from nrsfm.reports.layouts import published

LABELS: Mapping[str, str] = MappingProxyType(
    {
        "mp": "MP",
        "pta": "PTA",
        "csf1": "CSF",
        "csf2": "CSF2",
        "ksta": "KSTA",
        "pnd": "PND",
        "cns": "CNS",
        "bmm": "BMM",
        "r_bmm": "R-BMM",
        "r_bmm_2020": "R-BMM (2020)",
        "organic": "Organic priors",
        "organic_2022": "Organic priors (2022)",
        "zhu": "Zhu et al. 2014",
        "spatio_temporal_2017": "Spatio-temporal (2017)",
        "grassmann_2018": "Grassmannian (2018)",
        "jumping_2019": "Jumping manifolds (2019)",
    }
)


@dataclass(frozen=True)
class Literature:
    """A table of numbers that other papers print."""

    source: str  #: a key of ``nrsfm.reports.layouts.published.SOURCES``
    caption: str  #: where the numbers are printed, and in which metric as far as it is known

    @property
    def methods(self) -> tuple[str, ...]:
        return published.methods(self.source)

    def values(self, dataset: str) -> tuple[str | None, ...]:
        """The printed numbers of a dataset, method by method; None where there is none."""
        return tuple(published.printed(self.source, dataset, method, "e_3d") for method in self.methods)


_FOLLOWUP = (
    "by the supplement of Kumar, Dai, Li, “Spatio-temporal union of subspaces for multi-body NRSfM”, 2017. It does not "
    "say which e_3D it prints: the metric is in doubt, and there is no verdict."
)
PAIRS = Literature("pairs_followup", f"e_3D of the same pairs as printed {_FOLLOWUP}")
UMPM = Literature("umpm_followup", f"e_3D of the same takes as printed {_FOLLOWUP}")
DENSE = Literature(
    "dense_literature",
    "e_3D of the four faces as printed by later papers: the 2017 follow-up, Kumar et al. CVPR 2018, Kumar CVPR 2019, "
    "Kumar WACV 2020, Kumar and Van Gool ECCV 2022. Their metric is the mean over frames of a Frobenius ratio. How "
    "frames are aligned differs between them, so there is no verdict.",
)
SINGLE = Literature(
    "single_body_literature",
    "e_3D of the eight bodies as printed by Table 2 of Kumar and Van Gool, “Organic Priors in Non-Rigid Structure from "
    "Motion”, ECCV 2022. The column mixes metrics: it is defined as the mean over frames of a Frobenius ratio, but "
    "rows taken over from older papers (PTA, CSF, KSTA, BMM) are the older e_3d_dai, and the depth's sign may be "
    "chosen frame by frame in others. The metric of each row is in doubt, and there is no verdict.",
)
