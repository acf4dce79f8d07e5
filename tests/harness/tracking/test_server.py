"""A tracking server in place of a SQLite file: what is written to it, and what happens while it is away."""

from __future__ import annotations

import re
import signal
from collections import Counter
from collections.abc import Collection, Iterator
from pathlib import Path
from tempfile import TemporaryDirectory
from urllib.parse import quote

import numpy as np
import pytest
from mlflow import MlflowClient

from nrsfm.harness.record.curves import thinned
from nrsfm.harness.tracking.tracker import EXPERIMENT, Tracker
from tests.harness.tracking.servers import Postgres, Server
from tests.shell import ODD, TINY, Shell, records, started, until

pytestmark = [pytest.mark.slow, pytest.mark.timeout(1800)]
STORES = ["on_file", pytest.param("on_database", marks=pytest.mark.postgres)]
every_store = pytest.mark.parametrize("server", STORES, indirect=True)
on_postgres = pytest.mark.postgres
CANARY = "hunter2-Canary+pass"


@pytest.fixture(scope="module")
def postgres() -> Iterator[Postgres]:
    with TemporaryDirectory(prefix="postgres-") as folder:
        database = Postgres(Path(folder), CANARY)
        yield database
        database.stop()


@pytest.fixture(scope="module")
def on_database(postgres: Postgres, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Server]:
    """An MLflow server on PostgreSQL."""
    server = Server(tmp_path_factory.mktemp("server"), postgres.uri)
    yield server
    server.kill()


@pytest.fixture(scope="module")
def on_file(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Server]:
    """An MLflow server on a SQLite file."""
    folder = tmp_path_factory.mktemp("server")
    server = Server(folder, f"sqlite:///{folder}/server.db")
    yield server
    server.kill()


@pytest.fixture
def server(request: pytest.FixtureRequest) -> Server:
    server: Server = request.getfixturevalue(request.param)
    return server


def through(server: Server) -> tuple[str, str]:
    return "tracking=server", f"tracking.uri={server.address}"


def sweep(server: Server, n: int, seed: int) -> tuple[str, ...]:
    """The command line of a sweep: trials of one second each, two at a time, which no other test has."""
    words = ("run", "-m", *ODD, "+method.how=slow", f"dataset.seed={seed}", "noise.level=0.01")
    return (*words, f"noise.repeat=range({n})", "workers=2", *through(server))


def runs(server: Server, keys: Collection[str]) -> Counter[str]:
    """The number of runs of each trial on the server, complete or not."""
    client = MlflowClient(server.address)
    experiment = client.get_experiment_by_name(EXPERIMENT)
    if experiment is None:
        return Counter()
    everything = client.search_runs([experiment.experiment_id], max_results=5000)
    return Counter(run.data.tags["trial_key"] for run in everything if run.data.tags["trial_key"] in keys)


def all_there_once(server: Server, tmp_path: Path, n: int) -> None:
    """Check that the server has one complete run of each record in the folder."""
    kept = records(tmp_path)
    assert runs(server, kept) == dict.fromkeys(kept, 1)
    assert len(kept) == n
    outcomes = [t.outcome for t in Tracker(server.address, tmp_path / "elsewhere").outcomes()]
    assert {o.key: o.finished for o in outcomes if o.key in kept} == {k: r["finished"] for k, r in kept.items()}


@every_store
def test_the_report_is_rebuilt_from_a_server_alone(shell: Shell, server: Server, tmp_path: Path) -> None:
    words = (*through(server), "dataset.points=8", "dataset.frames=12", "noise.level=0")
    methods = "method=edsc,bmm_ssc3d"
    assert shell("run", "experiment=quick", *words, methods).returncode == 0
    elsewhere = {"NRSFM_OUTPUT": str(tmp_path / "elsewhere")}  # no trial folder here
    reports = []
    for variables in ({}, elsewhere):
        done = shell("report", "quick", *words, methods, "--quiet", **variables)
        assert done.returncode == 0, done.stderr
        folder = Path(variables.get("NRSFM_OUTPUT", tmp_path / "out")) / "report"
        reports.append({path.name: path.read_bytes() for path in folder.iterdir()})
    assert reports[0] == reports[1]
    page = reports[1]["index.html"].decode()
    assert re.search(rf'"link":"{re.escape(server.address)}/#/', page)
    assert '"view":' in page  # the arrays came from the server's artifacts


@every_store
def test_two_sweeps_at_once_write_each_trial_once(environment: dict[str, str], server: Server, tmp_path: Path) -> None:
    words = ("run", "-m", "dataset.points=8", "dataset.frames=12", "dataset.seed=7", *through(server))
    more = ("method=ours,edsc", "noise.level=0.01", "noise.repeat=0,1,2")
    both = [started(environment, tmp_path, *words, *more) for _ in range(2)]
    ended = [process.communicate(timeout=600) for process in both]
    assert [process.returncode for process in both] == [0, 0], ended
    all_there_once(server, tmp_path, 6)
    client = MlflowClient(server.address)
    kept = records(tmp_path)
    held = [t for t in Tracker(server.address, tmp_path / "out").outcomes() if t.outcome.key in kept]
    (one,) = [t for t in held if (t.outcome.method, t.outcome.repeat) == ("ours", 1)]
    run = client.get_run(one.run_id)
    assert run.info.status == "FINISHED"
    assert (run.data.params["method.l1"], run.data.params["dataset.seed"]) == ("0.003", "7")
    assert run.data.metrics["e_3d"] == one.outcome.metrics["e_3d"] == kept[one.outcome.key]["metrics"]["e_3d"]
    with np.load(tmp_path / "out/trials" / one.outcome.key / "arrays.npz") as arrays:
        steps, values = thinned(arrays)["residual_shape"]
    curve = client.get_metric_history(one.run_id, "residual_shape")
    assert [(point.step, point.value) for point in curve] == list(zip(steps, values, strict=True))
    assert len(curve) > 50
    assert {"sweep", "dataset", "method", "level", "repeat", "folder"} <= run.data.tags.keys()
    assert {f.path for f in client.list_artifacts(one.run_id)} >= {"result.json", "arrays.npz"}
    stored = Path(client.download_artifacts(one.run_id, "arrays.npz", str(tmp_path)))
    assert stored.read_bytes() == (tmp_path / "out/trials" / one.outcome.key / "arrays.npz").read_bytes()


@every_store
def test_two_folders_that_run_a_trial_at_one_moment_leave_one_run(
    environment: dict[str, str], server: Server, tmp_path: Path
) -> None:
    words = sweep(server, 4, seed=51)
    places = [environment | {"NRSFM_OUTPUT": str(tmp_path / name)} for name in "ab"]
    both = [started(place, tmp_path, *words) for place in places]
    ended = [process.communicate(timeout=600) for process in both]
    assert [process.returncode for process in both] == [0, 0], ended
    keys = {folder.name for folder in (tmp_path / "a/trials").iterdir()}
    assert runs(server, keys) == dict.fromkeys(keys, 1)
    assert len(keys) == 4


@on_postgres
@pytest.mark.parametrize("who", ["mlflow", "postgres"])
@pytest.mark.parametrize("back", ["during", "after"])
def test_a_server_that_goes_away_costs_nothing(
    shell: Shell,
    environment: dict[str, str],
    on_database: Server,
    postgres: Postgres,
    tmp_path: Path,
    who: str,
    back: str,
) -> None:
    """kill -9 of the server and its workers, or of its database alone, amid a sweep."""
    n = 60 if back == "during" else 6
    words = sweep(on_database, n, seed=len(who + back))
    stop, start = (on_database.kill, on_database.start) if who == "mlflow" else (postgres.stop, postgres.start)
    process = started(environment, tmp_path, *words)
    until(lambda: runs(on_database, records(tmp_path)))
    stop()
    try:
        if back == "during":
            before = len(records(tmp_path))
            until(lambda: len(records(tmp_path)) > before + 3)
            start()
        out, err = process.communicate(timeout=600)
        assert len(records(tmp_path)) == n
        assert {r["status"] for r in records(tmp_path).values()} == {"ok"}
        if back == "after":
            assert process.returncode == 2
            (line,) = [line for line in err.splitlines() if line.startswith("tracker ")]
            assert on_database.address in line
            assert "the trials are safe" in line
            start()
            command = re.search("'nrsfm (sync .*)' brings them in", line)
            assert command
            done = shell(*command[1].split())
            assert re.fullmatch(r"\d+ runs? written to .*\n", done.stdout), done.stdout
            assert "0 runs written" in shell(*command[1].split()).stdout
        else:
            assert (process.returncode, f"{n} trials: {n} run. " in out) == (0, True), (out, err)
    finally:
        if process.poll() is None:
            process.kill()
    all_there_once(on_database, tmp_path, n)


@on_postgres
def test_a_server_that_never_answers_holds_a_sweep_up_for_a_while_only(
    shell: Shell, environment: dict[str, str], on_database: Server, tmp_path: Path
) -> None:
    """It takes connections, as a machine out of memory does, and that is all."""
    process = started(environment | {"MLFLOW_HTTP_REQUEST_TIMEOUT": "5"}, tmp_path, *sweep(on_database, 6, seed=11))
    until(lambda: runs(on_database, records(tmp_path)))
    on_database.signal(signal.SIGSTOP)
    try:
        until(lambda: len(records(tmp_path)) == 6)
        _, err = process.communicate(timeout=600)  # it does not wait for ever
        assert process.returncode == 2
        assert "it did not answer in time; MLFLOW_HTTP_REQUEST_TIMEOUT allows more seconds; the trials are safe" in err
    finally:
        on_database.signal(signal.SIGCONT)
    assert shell("sync", *through(on_database)).returncode == 0
    all_there_once(on_database, tmp_path, 6)


@on_postgres
def test_words_that_the_database_does_not_take_are_written_all_the_same(
    nrsfm: Shell, on_database: Server, tmp_path: Path, naughty_package: Path
) -> None:
    """PostgreSQL refuses NUL, nobody encodes half a surrogate pair, and a tag has 8000 characters."""
    for seed, how in enumerate(("a\\0b", "a\\ud800b", "\\u4e2d" * 3000)):
        (naughty_package / "odd_words.py").write_text(
            "from naughty import Naughty\nclass Odd(Naughty):\n    def reconstruct(self, observations, n_bodies):\n"
            "        raise RuntimeError(self.how.encode('ascii').decode('unicode_escape'))\n"
        )
        info = naughty_package / "odd_words-1.0.dist-info"
        info.mkdir(exist_ok=True)
        (info / "METADATA").write_text("Metadata-Version: 2.1\nName: odd-words\nVersion: 1.0\n")
        (info / "entry_points.txt").write_text("[nrsfm.methods]\nodd_words = odd_words:Odd\n")
        words = [*ODD[:-2], "method.algorithm=odd_words", "method.name=odd_words", f"+method.how='{how}'"]
        done = nrsfm("run", *words, f"dataset.seed={20 + seed}", *through(on_database))
        assert (done.returncode, "the trials are safe" in done.stderr) == (2, False), (
            done.stderr
        )  # it fails, and is there
    all_there_once(on_database, tmp_path, 3)


@pytest.fixture
def guarded(postgres: Postgres, tmp_path: Path) -> Iterator[Server]:
    """An MLflow server that wants a login, on the same database."""
    folder = tmp_path / "guarded"
    folder.mkdir()
    config = folder / "auth.ini"
    config.write_text(
        f"[mlflow]\ndefault_permission = READ\ndatabase_uri = sqlite:///{folder}/auth.db\nadmin_username = anna\n"
        f"admin_password = {CANARY}\nauthorization_function = mlflow.server.auth:authenticate_request_basic_auth\n"
    )
    variables = {"MLFLOW_AUTH_CONFIG_PATH": str(config), "MLFLOW_FLASK_SERVER_SECRET_KEY": "of this test"}
    server = Server(folder, postgres.uri, "--app-name", "basic-auth", **variables)
    yield server
    server.kill()


@on_postgres
@pytest.mark.parametrize(
    ("way", "launcher"), [("variables", "basic"), ("address", "submitit_local"), ("interpolation", "joblib")]
)
def test_a_password_goes_to_the_server_and_nowhere_else(
    shell: Shell, guarded: Server, postgres: Postgres, tmp_path: Path, way: str, launcher: str
) -> None:
    place, escaped = guarded.address.removeprefix("http://"), quote(CANARY, safe="")

    def login(password: str) -> dict[str, str]:
        return {
            "variables": {"MLFLOW_TRACKING_USERNAME": "anna", "MLFLOW_TRACKING_PASSWORD": password},
            "address": {"MLFLOW_TRACKING_URI": f"http://anna:{quote(password, safe='')}@{place}"},
            "interpolation": {"SECRET": password},
        }[way]

    words = {
        "variables": through(guarded),
        "address": ("tracking=server",),
        "interpolation": ("tracking=server", f"tracking.uri=http://anna:${{oc.env:SECRET}}@{place}"),
    }[way]
    trials = (*TINY, "noise.level=0,0.02", f"dataset.seed={len(way + launcher)}")
    output: list[str] = []

    def call(code: int, *arguments: str, password: str = CANARY) -> str:
        done = shell(*arguments, *words, **login(password))
        output.extend((done.stdout, done.stderr))
        assert done.returncode == code, (arguments, done.stdout, done.stderr)
        return done.stderr

    call(0, "run", "-m", *trials, f"hydra/launcher={launcher}", "hydra.output_subdir=.hydra", "workers=2")
    call(0, "plan", *trials)
    call(0, "ui")
    call(2, "report", "quick")
    call(2, "compare", "experiment=quick", "compare.baseline=quick")
    for flags in (("--cfg", "all"), ("--cfg", "job", "--resolve"), ("--info", "config")):
        call(0, "run", *flags)
    remedy = "it does not know this user; set MLFLOW_TRACKING_USERNAME and MLFLOW_TRACKING_PASSWORD"
    for code, arguments in ((2, ("run", *TINY, "dataset.seed=3")), (3, ("report", "quick")), (3, ("sync",))):
        assert remedy in call(code, *arguments, password=f"not-{CANARY}")
    call(0, "sync")

    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("MLFLOW_TRACKING_USERNAME", "anna")
        patch.setenv("MLFLOW_TRACKING_PASSWORD", CANARY)
        all_there_once(guarded, tmp_path, 3)
    output.append(postgres.dump())
    files = [path for path in (tmp_path / "out").rglob("*") if path.is_file()]
    assert len(files) > 20
    for secret in (CANARY, escaped):
        assert not [path for path in files if secret.encode() in path.read_bytes()]
        assert not [text for text in output if secret in text]
