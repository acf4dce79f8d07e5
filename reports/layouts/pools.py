"""The rows that pool many datasets."""

from __future__ import annotations

from nrsfm.datasets.real import hopkins
from nrsfm.reports.layouts import published
from nrsfm.reports.layouts.layout import Pool

#: Scenes of the eight motion-capture sequences by their number of bodies.
BODIES = {
    "pairs": Pool("Eight pairs", published.datasets("table1")),
    "triples": Pool(
        "Eight triples",
        (
            *("stretch_dance_yoga", "drink_walking_yoga", "shark_stretch_dance", "walking_yoga_face"),
            *("face_pickup_drink", "face_yoga_shark", "shark_yoga_pickup", "stretch_yoga_walking"),
        ),
    ),
    "fours": Pool("Two scenes of four", ("drink_walking_face_shark", "dance_pickup_stretch_yoga")),
}


def _scenes(names: tuple[str, ...]) -> tuple[str, ...]:
    return tuple(f"hopkins155_{name}" for name in names)


#: The scenes of Hopkins155 by their number of motions.
HOPKINS = {
    "2": Pool("Two motions", _scenes(hopkins.TWO_MOTIONS)),
    "3": Pool("Three motions", _scenes(hopkins.THREE_MOTIONS)),
    "all": Pool("All", _scenes(hopkins.SCENES)),
}
