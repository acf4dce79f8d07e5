"""Downloads from a real server on this machine: what arrives, what does not, and the message then."""

from __future__ import annotations

import errno
import hashlib
import re
import signal
import socket
import subprocess
import sys
import threading
from collections import Counter
from collections.abc import Iterator
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path

import pytest

from nrsfm.datasets.errors import DatasetError, MissingData
from nrsfm.datasets.public import catalogue as sources
from nrsfm.datasets.public import download
from nrsfm.datasets.public.catalogue import ABSENT, CHANGED, PRESENT, File
from nrsfm.datasets.real import mocap
from nrsfm.harness.cli.main import main

CONTENT = bytes(range(256)) * 1000


class Handler(BaseHTTPRequestHandler):
    """/whole sends CONTENT, /half breaks off, /other sends another file, /long too much; /slow stops on its way."""

    requests: list[str]

    def log_message(self, *args: object) -> None:
        pass

    def do_HEAD(self) -> None:
        self.requests.append(f"HEAD {self.path}")
        self.send_response(200)
        self.end_headers()

    def do_GET(self) -> None:
        self.requests.append(f"GET {self.path}")
        body = {"/other": CONTENT[::-1], "/long": CONTENT * 20}.get(self.path, CONTENT)
        self.send_response(404 if self.path == "/gone" else 200)
        self.send_header("Content-Length", str(len(body)))
        self.end_headers()
        if self.path == "/slow":
            self.wfile.write(body[:100_000])
            self.wfile.flush()
            self.server.stopped.wait(30)  # type: ignore[attr-defined]
        elif self.path == "/half":
            self.wfile.write(body[: len(body) // 2])
        else:
            try:
                self.wfile.write(body)
            except ConnectionError:
                assert self.path == "/long"


class Server(ThreadingHTTPServer):
    daemon_threads = True

    def __init__(self) -> None:
        handler = type("Asked", (Handler,), {"requests": []})
        super().__init__(("127.0.0.1", 0), handler)
        self.requests: list[str] = handler.requests  # type: ignore[attr-defined]
        self.stopped = threading.Event()

    def file(self, what: str, name: str = "thing.mat", group: str = "group") -> File:
        url = f"http://127.0.0.1:{self.server_address[1]}/{what}"
        sha256 = hashlib.sha256(CONTENT).hexdigest()
        return File(f"{group}/{name}", url, sha256, len(CONTENT), "free", "this test", ("alias",))


@pytest.fixture
def server(monkeypatch: pytest.MonkeyPatch) -> Iterator[Server]:
    monkeypatch.setenv("NO_PROXY", "127.0.0.1")
    monkeypatch.setattr(download, "RETRIES", 0)
    with Server() as running:
        thread = threading.Thread(target=running.serve_forever, args=(0.02,))
        thread.start()
        yield running
        running.stopped.set()
        running.shutdown()
        thread.join()


@pytest.fixture
def closed_port() -> int:
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        return int(taken.getsockname()[1])


def catalogue(*files: File) -> dict[str, File]:
    return {file.path: file for file in files}


def one_line(error: BaseException | None) -> str:
    text = str(error)
    assert error is not None and "\n" not in text and len(text) < 400
    return text


def left(folder: Path) -> list[str]:
    return sorted(str(p.relative_to(folder)) for p in folder.rglob("*") if p.is_file())


# The catalogue


def test_catalogue_is_whole_and_pinned() -> None:
    for path, file in sources.CATALOGUE.items():
        assert path == file.path
        assert re.fullmatch(r"[0-9a-f]{64}", file.sha256)
        assert file.size > 0 and file.terms and file.source
        assert re.match(r"https://raw\.githubusercontent\.com/[^/]+/[^/]+/[0-9a-f]{40}/.+\.(mat|c3d)$", file.url)
    assert Counter(f.group for f in sources.CATALOGUE.values()) == {"mocap": 9, "c3d": 1, "hopkins155": 155}


def test_catalogue_holds_all_files_of_the_sequences() -> None:
    read = {mocap.file_of(name, motion) for name in mocap.SEQUENCES for motion in mocap.MOTIONS}
    assert read == {path for path, file in sources.CATALOGUE.items() if file.group == "mocap"}


@pytest.mark.data
def test_the_files_here_are_those_of_the_catalogue(data_folder: Path) -> None:
    assert {state for _, state in sources.verify(data_folder)} == {PRESENT}


@pytest.mark.parametrize(
    ("name", "paths"),
    [
        ("mocap/drink.mat", ["mocap/drink.mat"]),
        ("drink.mat", ["mocap/drink.mat"]),
        ("drink", ["mocap/drink.mat"]),
        ("shark", ["mocap/jaws.mat", "mocap/jaws_cameras.mat"]),
        ("three-cars", ["hopkins155/three-cars_truth.mat"]),
        ("mocap", [path for path in sources.CATALOGUE if path.startswith("mocap/")]),
    ],
)
def test_select_by_any_of_a_files_words(name: str, paths: list[str]) -> None:
    assert [file.path for file in sources.select([name])] == paths


def test_select_refuses_an_unknown_name() -> None:
    with pytest.raises(DatasetError, match="'foo' is no file of the catalogue"):
        sources.select(["drink", "foo"])


def test_a_new_group_needs_no_code(server: Server, tmp_path: Path) -> None:
    more = catalogue(*sources.CATALOGUE.values(), server.file("whole", "a.txt", "new"))
    [(file, error)] = download.get(tmp_path, ["new"], catalogue=more)
    assert error is None and (tmp_path / file.path).read_bytes() == CONTENT


# Checksums and states


def test_sha256_of_a_known_text_follows_changes(tmp_path: Path) -> None:
    path = tmp_path / "x"
    path.write_bytes(b"abc")
    known = "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad"
    assert sources.sha256(path) == sources.sha256(path) == known
    path.write_bytes(b"abcd")
    assert sources.sha256(path) == hashlib.sha256(b"abcd").hexdigest()


def test_sha256_reads_a_file_once(tmp_path: Path) -> None:
    path = tmp_path / "x"
    path.write_bytes(b"once")
    before = sources._sha256.cache_info()
    for _ in range(3):
        sources.sha256(path)
    after = sources._sha256.cache_info()
    assert (after.misses - before.misses, after.hits - before.hits) == (1, 2)


def test_sha256_of_what_cannot_be_read(tmp_path: Path) -> None:
    with pytest.raises(MissingData, match="nrsfm data get"):
        sources.sha256(tmp_path / "absent")
    with pytest.raises(DatasetError, match="cannot be read"):
        sources.sha256(tmp_path)


def test_states(server: Server, tmp_path: Path) -> None:
    files = [server.file("whole", name) for name in ("right", "damaged", "short", "folder", "absent")]
    entries = catalogue(*files)
    (tmp_path / "group").mkdir()
    (tmp_path / files[0].path).write_bytes(CONTENT)
    (tmp_path / files[1].path).write_bytes(CONTENT[::-1])
    (tmp_path / files[2].path).write_bytes(CONTENT[:-1])
    (tmp_path / files[3].path).mkdir()
    by_size = [state for _, state in sources.status(tmp_path, catalogue=entries)]
    by_checksum = [state for _, state in sources.verify(tmp_path, catalogue=entries)]
    assert by_size == [PRESENT, PRESENT, CHANGED, CHANGED, ABSENT]
    assert by_checksum == [PRESENT, CHANGED, CHANGED, CHANGED, ABSENT]


# Downloads


def test_get_fetches_what_is_absent_and_nothing_else(server: Server, tmp_path: Path) -> None:
    entries = catalogue(server.file("whole", "a"), server.file("whole", "b"))
    calls: list[tuple[str, int]] = []
    first = download.get(tmp_path, ["a"], lambda file, n: calls.append((file.path, n)), entries)
    assert [error for _, error in first] == [None]
    assert (tmp_path / "group/a").read_bytes() == CONTENT and left(tmp_path) == ["group/a"]
    assert calls[-1] == ("group/a", len(CONTENT)) and [n for _, n in calls] == sorted(n for _, n in calls)
    server.requests.clear()
    assert download.get(tmp_path, ["a"], catalogue=entries) == first
    assert server.requests == []
    download.get(tmp_path, catalogue=entries)
    assert left(tmp_path) == ["group/a", "group/b"]
    assert sum(line.startswith("GET") for line in server.requests) == 1


def test_get_replaces_a_damaged_file(server: Server, tmp_path: Path) -> None:
    file = server.file("whole")
    (tmp_path / "group").mkdir()
    (tmp_path / file.path).write_bytes(CONTENT[::-1])
    download.get(tmp_path, catalogue=catalogue(file))
    assert (tmp_path / file.path).read_bytes() == CONTENT


@pytest.mark.parametrize(
    ("what", "message"),
    [
        ("other", "sent another file"),
        ("long", "sent another file"),
        ("half", "the connection broke off"),
        ("gone", "answered 404"),
    ],
)
def test_a_failed_download_leaves_what_was_there(server: Server, tmp_path: Path, what: str, message: str) -> None:
    file = server.file(what)
    entries = catalogue(file, server.file("whole", "good"))
    (tmp_path / "group").mkdir()
    (tmp_path / file.path).write_bytes(b"before")
    (_, error), (_, fine) = download.get(tmp_path, catalogue=entries)
    assert isinstance(error, MissingData) and fine is None
    text = one_line(error)
    assert text.startswith(f"{file.path}: ") and message in text and "copy it into" in text
    assert left(tmp_path) == ["group/good", "group/thing.mat"]
    assert (tmp_path / file.path).read_bytes() == b"before"


def test_a_server_that_refuses_is_tried_once(closed_port: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    probes: list[str] = []
    probe = download._probe
    monkeypatch.setattr(download, "CONNECT_SECONDS", 600.0)

    def counted(url: str) -> str:
        probes.append(url)
        return probe(url)

    monkeypatch.setattr(download, "_probe", counted)
    url = f"http://127.0.0.1:{closed_port}/x"
    entries = catalogue(*(File(f"g/{k}", url, "0" * 64, 3, "free", "nobody") for k in range(20)))
    results = download.get(tmp_path / "new", catalogue=entries)
    assert probes == [url]
    assert len(results) == 20
    for file, error in results:
        assert file.path in one_line(error) and "connection refused" in one_line(error)
    assert not (tmp_path / "new").exists()


def test_a_server_that_does_not_answer_is_given_up(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(download, "CONNECT_SECONDS", 0.2)
    monkeypatch.setenv("NO_PROXY", "127.0.0.1")
    with socket.socket() as silent:
        silent.bind(("127.0.0.1", 0))
        silent.listen()
        url = f"http://127.0.0.1:{silent.getsockname()[1]}/x"
        [(_, error)] = download.get(tmp_path, catalogue=catalogue(File("g/x", url, "0" * 64, 3, "", "")))
    assert "it took too long" in one_line(error) or "no answer in" in one_line(error)


def test_a_name_that_is_not_known(tmp_path: Path) -> None:
    file = File("g/x", "http://nowhere.invalid/x", "0" * 64, 3, "", "")
    [(_, error)] = download.get(tmp_path, catalogue=catalogue(file))
    assert "nowhere.invalid cannot be reached" in one_line(error)


def test_a_broken_download_is_tried_again(server: Server, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(download, "RETRIES", 1)
    monkeypatch.setattr("pooch.core.time.sleep", lambda seconds: None)
    download.get(tmp_path, catalogue=catalogue(server.file("half")))
    assert server.requests.count("GET /half") == 2


def test_a_killed_download_leaves_no_wrong_file(server: Server, tmp_path: Path) -> None:
    file = server.file("slow")
    code = (
        "import sys\nfrom pathlib import Path\nfrom nrsfm.datasets.public.catalogue import File\n"
        "from nrsfm.datasets.public.download import get\n"
        f"file = {file!r}\n"
        "get(Path(sys.argv[1]), progress=lambda f, n: print(n, flush=True), catalogue={file.path: file})"
    )
    process = subprocess.Popen([sys.executable, "-c", code, str(tmp_path)], stdout=subprocess.PIPE)
    assert process.stdout is not None and int(process.stdout.readline()) > 0
    process.send_signal(signal.SIGKILL)
    process.wait(600)
    process.stdout.close()
    assert [state for _, state in sources.verify(tmp_path, catalogue=catalogue(file))] == [ABSENT]
    entries = catalogue(server.file("whole"))
    assert [error for _, error in download.get(tmp_path, catalogue=entries)] == [None]


def test_a_folder_that_cannot_be_written(server: Server, tmp_path: Path) -> None:
    (tmp_path / "file").write_text("in the way")
    with pytest.raises(DatasetError, match="cannot be written to") as caught:
        download.get(tmp_path / "file", catalogue=catalogue(server.file("whole")))
    assert "NRSFM_DATA" in one_line(caught.value)


@pytest.mark.parametrize(("code", "message"), [(errno.ENOSPC, "is full"), (errno.EROFS, "Read-only file system")])
def test_a_full_or_read_only_disk(
    server: Server, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, code: int, message: str
) -> None:
    def refuse(path: str) -> None:
        raise OSError(code, {errno.ENOSPC: "No space left", errno.EROFS: "Read-only file system"}[code])

    monkeypatch.setattr("pooch.core.make_local_storage", refuse)
    with pytest.raises(DatasetError, match=message) as caught:
        download.get(tmp_path, catalogue=catalogue(server.file("whole")))
    assert str(tmp_path) in one_line(caught.value)


# The verb


Said = tuple[int, str, str]


def say(capsys: pytest.CaptureFixture[str], folder: Path, *argv: str) -> Said:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("nrsfm.harness.config.compose.data_folder", lambda: folder)
        try:
            code = main(["data", *argv])
        except SystemExit as stop:
            code = int(stop.code or 0)
    out, err = capsys.readouterr()
    assert "Traceback" not in out + err
    return code, out, err


def test_verb_lists_every_file(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    code, out, _ = say(capsys, tmp_path, "list")
    assert code == 0
    for file in sources.CATALOGUE.values():
        line = next(line for line in out.splitlines() if line.startswith(file.path + " "))
        assert ABSENT in line and file.terms in line and file.source in line and "MB" in line


def test_verb_get_then_verify(
    server: Server, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(sources, "CATALOGUE", catalogue(server.file("whole", "a"), server.file("whole", "b", "other")))
    assert say(capsys, tmp_path, "verify")[0] == 2
    code, out, err = say(capsys, tmp_path, "get", "group")
    assert (code, err) == (0, "") and "group/a" in out and "other/b" not in out
    code, out, _ = say(capsys, tmp_path, "verify")
    assert code == 0 and "group/a  ok" in out and "1 files are not there" in out
    code, _, err = say(capsys, tmp_path, "verify", "other")
    assert code == 2 and "other/b" in err and "'nrsfm data get other' fetches them" in err
    assert say(capsys, tmp_path, "get")[0] == 0
    code, out, _ = say(capsys, tmp_path, "get")
    assert code == 0 and "all 2 files" in out
    (tmp_path / "group/a").write_bytes(CONTENT[::-1])
    code, _, err = say(capsys, tmp_path, "verify")
    assert code == 2 and "group/a is not the file of the catalogue" in err
    assert say(capsys, tmp_path, "get", "a")[0] == 0
    assert say(capsys, tmp_path, "verify")[0] == 0


def test_verb_get_says_what_could_not_be_had(
    server: Server,
    closed_port: int,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    absent = [File(f"g/{k}", f"http://127.0.0.1:{closed_port}/x", "0" * 64, 3, "", "") for k in range(5)]
    monkeypatch.setattr(sources, "CATALOGUE", catalogue(server.file("whole"), *absent))
    code, out, err = say(capsys, tmp_path, "get")
    assert code == 2 and "group/thing.mat" in out
    lines = err.splitlines()
    assert len(lines) == 2, "one line for the server, one for what follows"
    assert lines[0].startswith("g/0 and 4 more: ") and "connection refused" in lines[0]
    assert "5 of 6" in lines[1] and "experiment=dancers" in lines[1]


def test_verb_get_into_a_folder_that_cannot_be_written(
    server: Server, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(sources, "CATALOGUE", catalogue(server.file("whole", "a"), server.file("whole", "b")))
    (tmp_path / "file").write_text("in the way")
    code, _, err = say(capsys, tmp_path / "file", "get")
    assert code == 2 and err.count("\n") == 1


def test_verb_get_can_be_interrupted(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def interrupt(*args: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(download, "get", interrupt)
    code, _, err = say(capsys, tmp_path, "get")
    assert code == 2 and err.startswith("interrupted")


def test_verb_get_fetches_large_groups_on_request_alone(
    server: Server, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    entries = catalogue(server.file("whole", "a"), server.file("whole", "b", "hopkins155"))
    monkeypatch.setattr(sources, "CATALOGUE", entries)
    assert say(capsys, tmp_path, "get")[0] == 0
    assert left(tmp_path) == ["group/a"]
    code, out, _ = say(capsys, tmp_path, "verify")
    assert code == 0 and "'nrsfm data get hopkins155' fetches them" in out
    assert say(capsys, tmp_path, "get", "hopkins155")[0] == 0
    assert left(tmp_path) == ["group/a", "hopkins155/b"]


@pytest.mark.parametrize("set_to", ["here", "elsewhere", None])
def test_verb_where(
    set_to: str | None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.delenv("NRSFM_DATA", raising=False)
    if set_to:
        monkeypatch.setenv("NRSFM_DATA", str(tmp_path / set_to))
    code, out, _ = say(capsys, tmp_path / "here", "where")
    lines = out.splitlines()
    assert code == 0 and lines[0] == str(tmp_path / "here")
    assert lines[1].startswith("from NRSFM_DATA") == (set_to == "here")


@pytest.mark.parametrize("argv", [[], ["fetch"], ["get", "foo"], ["list", "--loud"], ["where", "x"]])
def test_verb_wrong_usage(argv: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    code, out, err = say(capsys, tmp_path, *argv)
    assert (code, out) == (3, "") and err.count("\n") == 1


@pytest.mark.parametrize("argv", [["--help"], ["get", "--help"]])
def test_verb_help(argv: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    code, out, _ = say(capsys, tmp_path, *argv)
    assert code == 0 and "usage: nrsfm data" in out
