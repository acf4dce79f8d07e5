"""Download of the catalogue's files, each checked by its SHA-256."""

from __future__ import annotations

import errno
import threading
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from urllib.parse import urlsplit

from nrsfm.datasets.errors import DatasetError, MissingData
from nrsfm.datasets.public.catalogue import PRESENT, File, verify

CONNECT_SECONDS, READ_SECONDS, RETRIES, CHUNK = 4.0, 30.0, 1, 1 << 16
Progress = Callable[[File, int], None]  # called with the file and the number of its bytes that have come


def get(
    folder: Path,
    names: Iterable[str] = (),
    progress: Progress | None = None,
    catalogue: Mapping[str, File] | None = None,
) -> list[tuple[File, DatasetError | None]]:
    """Fetch the files that are absent, or whose checksum is not the catalogue's.

    A file takes its place only when its checksum is right: a download that is stopped changes nothing there. A server
    that cannot be reached is tried once, for a few seconds.

    The folder is made if it is not there. ``names`` are groups, paths, file names or aliases; none mean all. Returns
    every wanted file, with None if it is now in place. Raises DatasetError if a name is unknown or the folder cannot be
    written to.
    """
    reached: dict[str, str] = {}
    results: list[tuple[File, DatasetError | None]] = []
    for file, state in verify(folder, names, catalogue):
        error: DatasetError | None = None
        if state != PRESENT:
            place = urlsplit(file.url).netloc
            if place not in reached:
                reached[place] = _probe(file.url)
            try:
                if reached[place]:
                    raise MissingData(_sorry(folder, file, f"{place} cannot be reached ({reached[place]})"))
                _download(folder, file, progress)
            except MissingData as caught:
                error = caught
        results.append((file, error))
    return results


def _sorry(folder: Path, file: File, reason: str) -> str:
    """The message about a file that could not be fetched, with the remedy."""
    return f"{file.path}: {reason}; try again later, or copy it into {(folder / file.path).parent} yourself"


def _probe(url: str) -> str:
    """Why a server does not answer, '' if it does; in a thread, since looking up a name has no time-out."""
    import requests

    answer = [f"no answer in {CONNECT_SECONDS + 1:.0f} s"]

    def ask() -> None:
        try:
            requests.head(url, timeout=CONNECT_SECONDS).close()
            answer[0] = ""
        except requests.exceptions.RequestException as error:
            answer[0] = _reason(error)

    thread = threading.Thread(target=ask, daemon=True)
    thread.start()
    thread.join(CONNECT_SECONDS + 1)
    return answer[0]


def _reason(error: Exception) -> str:
    """Short words for a network error."""
    text = " ".join(str(error).split())
    known = {
        "resol": "its name is not known here; is there a network?",
        "refused": "connection refused",
        "timed out": "it took too long",
        "unreachable": "no network",
        "roxy": "the proxy does not answer",
        "CERTIFICATE": "its certificate is not accepted",
        "broken": "the connection broke off",
    }
    return next((words for sign, words in known.items() if sign in text), text[:100] or type(error).__name__)


class _Meter:
    """Progress bar for pooch; it ends a download that is longer than the catalogue states."""

    total = 0

    def __init__(self, file: File, progress: Progress | None) -> None:
        self.file, self.progress, self.done = file, progress, 0

    def update(self, n: int) -> None:
        self.done += n
        if self.done > self.file.size + CHUNK:
            raise ValueError("longer than the catalogue states")
        if self.progress:
            self.progress(self.file, min(self.done, self.file.size))

    def reset(self) -> None:
        self.done = 0

    def close(self) -> None:
        """Nothing to close; pooch asks for it."""


def _download(folder: Path, file: File, progress: Progress | None) -> None:
    import pooch
    import requests

    pooch.get_logger().setLevel("ERROR")
    store = pooch.create(
        folder, "", registry={file.path: file.sha256}, urls={file.path: file.url}, retry_if_failed=RETRIES
    )
    meter, patience = _Meter(file, progress), (CONNECT_SECONDS, READ_SECONDS)
    fetch = pooch.HTTPDownloader(progressbar=meter, chunk_size=CHUNK, timeout=patience)
    try:
        Path(store.fetch(file.path, downloader=fetch)).chmod(0o644)
        return
    except requests.exceptions.HTTPError as error:
        reason = f"{file.url} answered {getattr(error.response, 'status_code', 'an error')}"
    except requests.exceptions.RequestException as error:
        reason = f"download from {urlsplit(file.url).netloc} failed ({_reason(error)})"
    except ValueError:
        reason = f"{file.url} sent another file (its SHA-256 or size is wrong)"
    except OSError as error:
        why = "is full" if error.errno in (errno.ENOSPC, errno.EDQUOT) else f"cannot be written to ({_reason(error)})"
        raise DatasetError(f"data folder {folder} {why}; make room there or name another with NRSFM_DATA") from None
    raise MissingData(_sorry(folder, file, reason))
