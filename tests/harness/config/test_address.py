"""Tracker addresses: which are refused, what is shown of a login, and how long a sweep waits for a server."""

from __future__ import annotations

import os
import socket
import threading
import time
from collections.abc import Callable, Iterator
from functools import partial
from multiprocessing.connection import Connection
from pathlib import Path

import pytest

from nrsfm.harness.config.address import PASSWORD, USER, shown, split
from nrsfm.harness.record.outcome import Outcome
from nrsfm.harness.tracking import writer_process as writer
from nrsfm.harness.tracking.errors import explain
from nrsfm.harness.tracking.tracker import Tracker
from tests.shell import TINY, Shell, records

CANARY = "Canary"


TYPED = (
    f"http://anna:{CANARY}@127.0.0.1:9",
    f"https://{CANARY}@127.0.0.1:9",
    f"http://anna:${{oc.env:NONE,{CANARY}}}@127.0.0.1:9",
    f"http://anna:{CANARY}${{oc.env:HOME}}@127.0.0.1:9",
    f"postgresql://anna:{CANARY}@127.0.0.1/runs",
    f"[http://anna:{CANARY}@127.0.0.1:9",
)


@pytest.mark.parametrize(
    ("verb", "typed"),
    [*(("run", typed) for typed in TYPED), *((verb, TYPED[0]) for verb in ("plan", "sync", "ui", "report", "compare"))],
)
def test_a_typed_password_is_refused_in_words_without_it(nrsfm: Shell, tmp_path: Path, verb: str, typed: str) -> None:
    done = nrsfm(verb, f"tracking.uri={typed}")
    assert done.returncode == 3
    assert len(done.stderr.splitlines()) == 1
    assert CANARY not in done.stderr + done.stdout
    assert not (tmp_path / "out").exists()


def test_a_shown_configuration_has_no_password(nrsfm: Shell) -> None:
    here = {"MLFLOW_TRACKING_URI": f"http://anna:{CANARY}@127.0.0.1:9"}
    for more in ([], ["--resolve"]):
        done = nrsfm("run", "--cfg", "job", *more, "tracking=server", **here)
        assert (done.returncode, CANARY in done.stdout) == (0, False)
    assert "uri: http://127.0.0.1:9\n" in done.stdout
    done = nrsfm("run", "--cfg", "job", f"tracking.uri=http://anna:{CANARY}@127.0.0.1:9")
    assert "uri: http://127.0.0.1:9\n" in done.stdout


def test_a_login_becomes_the_variables_that_mlflow_reads() -> None:
    assert split("http://anna:a%40b%2F@host:5000/x") == ("http://host:5000/x", {USER: "anna", PASSWORD: "a@b/"})
    assert split("https://anna:a/b@c@host") == ("https://host", {USER: "anna", PASSWORD: "a/b@c"})
    for plain in ("http://host:5000", "sqlite:///a@b/mlflow.db"):
        assert split(plain) == (plain, {})
    assert shown("at http://anna:a/b@c@host/x: no") == "at http://host/x: no"


@pytest.mark.parametrize(
    ("said", "wanted"),
    [
        ("Caused by NewConnectionError('... [Errno 111] Connection refused')", "nothing answers there"),
        ("HTTPConnectionPool: Read timed out. (read timeout=20)", "did not answer in time"),
        ("failed with error code 401 != 200", "does not know this user"),
        ("Caused by ResponseError('too many 503 error responses')", "status 503"),
        ("(psycopg.OperationalError) connection to 10.0.0.1 failed: Connection refused", "psycopg.OperationalError"),
    ],
)
def test_what_a_server_says_in_plain_words(said: str, wanted: str) -> None:
    assert wanted in explain(RuntimeError(said), "http://host:5000")
    assert said in explain(RuntimeError(said), "sqlite:///mlflow.db")


@pytest.fixture
def stuck() -> Iterator[Callable[[float], str]]:
    """Starts a server that takes every connection and sends one byte of an answer each so many seconds."""
    listener = socket.create_server(("127.0.0.1", 0))

    def answer(taken: socket.socket, seconds: float) -> None:
        with taken:
            try:
                taken.sendall(b"HTTP/1.1 200 OK\r\nX-Patience: ")
                while True:
                    time.sleep(seconds)
                    taken.sendall(b"x")
            except OSError:
                return

    def serve(seconds: float) -> None:
        while True:
            try:
                taken, _ = listener.accept()
            except OSError:
                return
            threading.Thread(target=answer, args=(taken, seconds), daemon=True).start()

    def start(seconds: float) -> str:
        threading.Thread(target=serve, args=(seconds,), daemon=True).start()
        return f"http://127.0.0.1:{listener.getsockname()[1]}"

    yield start
    listener.close()


@pytest.mark.parametrize("pace", [600.0, 0.2], ids=["silent", "trickling"])
def test_a_server_that_does_not_get_done_is_given_up(
    nrsfm: Shell, stuck: Callable[[float], str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, pace: float
) -> None:
    monkeypatch.setattr(writer, "RETRY_AFTER", 0.5)
    monkeypatch.setattr(writer, "SILENCE", 4.0)
    address, since = stuck(pace), time.monotonic()
    done = nrsfm("run", *TINY, "tracking=server", f"tracking.uri={address}")
    assert time.monotonic() - since < 600
    assert done.returncode == 2
    (line,) = [line for line in done.stderr.splitlines() if line.startswith("tracker ")]
    assert line.startswith(f"tracker {address}")
    assert "it took no trial for 4 s" in line
    assert f"'nrsfm sync tracking=server tracking.uri={address}' brings them in" in line
    assert [r["status"] for r in records(tmp_path).values()] == ["ok"]


def test_swept_values_may_stand_before_the_trackers_address(nrsfm: Shell) -> None:
    done = nrsfm("plan", *TINY, "noise.level=0,0.02", "tracking=server", "tracking.uri=http://127.0.0.1:9")
    assert done.returncode == 0, done.stderr
    assert "2 trials" in done.stdout


@pytest.mark.slow
@pytest.mark.parametrize("lost", [False, True], ids=["damaged", "deadly"])
def test_trials_that_no_tracker_takes_keep_none_of_the_others_away(
    nrsfm: Shell, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, lost: bool
) -> None:
    """Two trials have a damaged file; or the writer's process dies of one trial."""
    monkeypatch.setattr(writer, "RETRY_AFTER", 0.5)
    assert nrsfm("run", "-m", *TINY, "dataset.seed=range(5)").returncode == 0
    for path in (tmp_path / "out").glob("mlflow.db*"):
        path.unlink()
    damaged = sorted((tmp_path / "out/trials").glob("*/arrays.npz"))[: 1 if lost else 2]
    for path in damaged:
        path.write_bytes(b"no archive")
    if lost:
        monkeypatch.setattr(writer, "_serve", partial(dying, damaged[0].parent.name))
    done = nrsfm("run", "-m", *TINY, "dataset.seed=range(5)")
    assert done.returncode == 2
    assert "the trials are safe" in done.stderr
    held = {t.outcome.key for t in Tracker(f"sqlite:///{tmp_path}/out/mlflow.db", tmp_path / "out").outcomes()}
    assert held == records(tmp_path).keys() - {path.parent.name for path in damaged}


def dying(deadly: str, pipe: Connection) -> None:
    """The writer's process, which ends when it is to write one trial."""

    def log(tracker: Tracker, outcome: Outcome, folder: Path) -> str:
        if outcome.key == deadly:
            os._exit(1)
        return written(tracker, outcome, folder)

    written, serve = Tracker.log, writer._serve
    pytest.MonkeyPatch().setattr(Tracker, "log", log)
    serve(pipe)
