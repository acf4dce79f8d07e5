"""Catalogue of the public data files, and their state in the data folder."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import lru_cache
from importlib import resources
from pathlib import Path, PurePosixPath

from nrsfm.datasets.errors import DatasetError, MissingData

PRESENT, ABSENT, CHANGED = "present", "absent", "changed"


@dataclass(frozen=True)
class File:
    """One public file."""

    path: str  # its place in the data folder, group/name
    url: str
    sha256: str  # in hex digits
    size: int  # in bytes
    terms: str  # what its authors allow
    source: str  # what to cite
    aliases: tuple[str, ...] = ()  # other words for it, such as the name of the sequence that it holds

    @property
    def group(self) -> str:
        return self.path.partition("/")[0]

    @property
    def words(self) -> set[str]:
        """Words that select the file: its group, its path, its name with and without the suffix, its aliases."""
        name = PurePosixPath(self.path)
        return {self.group, self.path, name.name, name.stem, *self.aliases}


def listed(group: str, url: str, terms: str, source: str, table: str) -> list[File]:
    """Files of one folder of a server; each line of the table is ``name size sha256 [name there [alias ...]]``."""
    files = []
    for line in table.strip().splitlines():
        name, size, digest, *rest = line.split()
        there, *aliases = rest or [name]
        files.append(File(f"{group}/{name}", f"{url}/{there}", digest, int(size), terms, source, tuple(aliases)))
    return files


_GITHUB = "https://raw.githubusercontent.com"
_TRAJECTORY_SPACE = (
    f"{_GITHUB}/summmanpan/NRSfM_Consensus/edefe657241c603bd26d574d1f11fce8838c632b/data_set/without_rot"
)

#: The lines ``size sha256`` of ``hopkins155.txt`` by the scene's name.
HOPKINS: Mapping[str, str] = {
    name: rest
    for name, _, rest in (
        line.partition(" ")
        for line in resources.files("nrsfm.datasets.public").joinpath("hopkins155.txt").read_text().splitlines()
    )
}

_CMU = ("none stated; motion from the CMU database, free to use", "Akhter et al., PAMI 2011; mocap.cs.cmu.edu")

CATALOGUE: Mapping[str, File] = {
    file.path: file
    for file in [
        *listed(
            "mocap",
            _TRAJECTORY_SPACE,
            *_CMU,
            """
            drink.mat   2707996 a0bba1cde1cbf7ce9c97fabfa8d5632e95b74dc3b38b26c20c1071ea2512d545
            pickup.mat  893728  b04efc8833a840ac097ab70f08e5b9e6afb830f53e983d33831806662d84a4e4
            yoga.mat    766734  6cd04c602263963cdecfbf3c6c9b1102869e054f22d448f4ab1bfb0aa0b1469d
            stretch.mat 928869  91a360959dd353ff8732ffbbdb2f2ab37b3963a145c6fe81d1bdb71f118aaef7
            """,
        ),
        *listed(
            "mocap",
            f"{_TRAJECTORY_SPACE}/no_add_rot_inPaper",
            *_CMU,
            "dance.mat 1212378 db2f93e4b39776f2ad5c1ccb2fd5cce1be9313c7484ebd03e499f8d4763e1680 dance_falta_list.mat",
        ),
        *listed(
            "mocap",
            f"{_GITHUB}/scivision/em-sfm/c0abf730b7148c35831b1fdf5ae02ae928471dbf/data",
            "free non-commercial use and distribution",
            "Torresani et al., PAMI 2008; scivision/em-sfm",
            """
            face.mat    303386 dc3087a2b2381a319e92ce64e47836721fa81426f00e18ad26aa4be5e2c00b9d
            walking.mat 343226 aa6613e590a067c285c2686daef72c43576c37953cd4a4df76b04730ca9d3dfc
            jaws.mat    524186 e962fe60aaed847397d922889496519310d34374a098c6d6f9282232d0635fcc jaws.mat shark
            """,
        ),
        *listed(
            "mocap",
            f"{_GITHUB}/vrabaud/sfm_toolbox/7ce933b31b71292eddabb40bacfd619720fa221d/nrsfm/data/shark",
            "none stated",
            "Torresani et al., PAMI 2008; vrabaud/sfm_toolbox",
            """
            jaws_cameras.mat 774285 7d989d938b38ea1011f8580368e7e785081cfdb15e9f1b4cb6ba82329fde9ca6 jawSource.mat shark
            """,
        ),
        *listed(
            "c3d",
            f"{_GITHUB}/Mohaoui-S/MoCap-data/a1178bf06f76ee90a65d79222b3d220f09bdfdcc",
            "free to use",
            "CMU Graphics Lab motion capture database, mocap.cs.cmu.edu",
            "cmu_02_01.c3d 231152 a272d142c2bdd3eed937238cb029a450ea46224cdaa500ab3b58f1c5e7308063 02_01.c3d",
        ),
        *listed(
            "hopkins155",
            f"{_GITHUB}/VictorSanh/Unsupervised_Learning_HMWK/255cf39a8ffc241a72907ada54c80d7787208510"
            "/HMWK2/data/Hopkins155",
            "public benchmark; none stated",
            "Tron and Vidal, CVPR 2007",
            "\n".join(f"{n}_truth.mat {rest} {n}/{n}_truth.mat {n}" for n, rest in HOPKINS.items()),
        ),
    ]
}

#: Groups that are fetched only when they are named; the paper's tables need the others.
ON_REQUEST = frozenset({"hopkins155", "c3d"})
State = tuple[File, str]


def select(names: Iterable[str] = (), catalogue: Mapping[str, File] | None = None) -> list[File]:
    """Files by group (``mocap``), path, file name or alias (``shark``); no names mean all.

    Raises
    ------
    DatasetError
        If a name fits no file.
    """
    files = list((CATALOGUE if catalogue is None else catalogue).values())
    wanted = list(names)
    for name in wanted:
        if not any(name in file.words for file in files):
            groups = ", ".join(sorted({file.group for file in files})) or "none"
            raise DatasetError(f"{name!r} is no file of the catalogue (groups: {groups}); see 'nrsfm data list'")
    return [file for file in files if not wanted or file.words.intersection(wanted)]


def sha256(path: Path) -> str:
    """SHA-256 of a file's content as hex digits; reread only when its size or time of change differs.

    Raises MissingData if the file is not there, DatasetError if it cannot be read.
    """
    try:
        known = path.stat()
        return _sha256(str(path), known.st_mtime_ns, known.st_size)
    except (FileNotFoundError, NotADirectoryError):
        raise MissingData(f"{path} is not there; fetch it with 'nrsfm data get'") from None
    except OSError as error:
        raise DatasetError(f"{path}: cannot be read ({error.strerror}); see to its permissions") from None


@lru_cache(maxsize=4096)
def _sha256(path: str, mtime_ns: int, size: int) -> str:
    with Path(path).open("rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()


def status(folder: Path, names: Iterable[str] = (), catalogue: Mapping[str, File] | None = None) -> list[State]:
    """Each file with the state present, absent or changed, judged by its size alone."""
    return [(file, _state(folder / file.path, file)) for file in select(names, catalogue)]


def verify(folder: Path, names: Iterable[str] = (), catalogue: Mapping[str, File] | None = None) -> list[State]:
    """Each file with the state present, absent or changed, judged by its checksum; DatasetError if unreadable."""
    return [
        (file, CHANGED if state == PRESENT and sha256(folder / file.path) != file.sha256 else state)
        for file, state in status(folder, names, catalogue)
    ]


def _state(path: Path, file: File) -> str:
    try:
        if not path.exists():
            return ABSENT
        return PRESENT if path.is_file() and path.stat().st_size == file.size else CHANGED
    except OSError as error:
        raise DatasetError(f"{path}: cannot be read ({error.strerror}); see to its permissions") from None
