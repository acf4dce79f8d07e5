"""Reads one C3D file with ezc3d, in a process that may crash or be ended; started by :mod:`datasets.c3dfile`.

``python -P c3dchild.py FILE RESULT SECONDS BYTES`` writes RESULT, an .npz, under these limits of time and memory.
"""

from __future__ import annotations

import os
import resource
import sys
from itertools import count


def main(path: str, result: str, seconds: int, memory: int) -> None:
    os.environ["OPENBLAS_NUM_THREADS"] = "1"  # each thread takes memory of its own
    resource.setrlimit(resource.RLIMIT_CPU, (seconds, seconds + 1))
    resource.setrlimit(resource.RLIMIT_AS, (memory, memory))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    import ezc3d
    import numpy as np

    file = ezc3d.c3d(path)
    point = file["parameters"]["POINT"]
    more = (f"LABELS{k}" for k in count(2))
    labels = list(point["LABELS"]["value"])
    while (name := next(more)) in point:  # a parameter holds 255 labels
        labels += point[name]["value"]
    units = point["UNITS"]["value"]
    np.savez(
        result,
        points=file["data"]["points"][:3].transpose(2, 0, 1),
        labels=np.array([label.strip() for label in labels], dtype=str),
        rate=point["RATE"]["value"][0],
        unit=units[0].strip() if units else "",
    )


if __name__ == "__main__":
    try:
        main(sys.argv[1], sys.argv[2], int(sys.argv[3]), int(sys.argv[4]))
    except Exception as error:  # whatever the reader or numpy make of damaged bytes
        sys.exit(f"{type(error).__name__}: {' '.join(str(error).split())}")
