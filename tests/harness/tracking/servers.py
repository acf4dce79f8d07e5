"""A PostgreSQL server and an MLflow server on this machine's loopback, to be killed, stopped and started again."""

from __future__ import annotations

import os
import shutil
import signal
import socket
import subprocess
import sys
import time
import urllib.request
from collections.abc import Mapping
from pathlib import Path
from typing import Any


def postgres_folder() -> Path | None:
    """The folder of PostgreSQL's programs, the newest that is on the path or where Debian and Red Hat install it."""
    program = shutil.which("initdb")
    places = [Path(program).resolve().parent] if program else []
    for pattern in ("lib/postgresql/*/bin", "pgsql-*/bin"):
        places += sorted(Path("/usr").glob(pattern), key=lambda p: float(p.parent.name.split("-")[-1]), reverse=True)
    return next((place for place in places if (place / "initdb").is_file()), None)


def free_port() -> int:
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        return int(free.getsockname()[1])


def wait_for(address: str, process: subprocess.Popen[bytes], seconds: float = 600) -> None:
    """Wait until an MLflow server answers."""
    end = time.monotonic() + seconds
    while True:
        try:
            with urllib.request.urlopen(f"{address}/health", timeout=10):
                return
        except OSError:
            assert time.monotonic() < end
            assert process.poll() is None
            time.sleep(0.1)


class Postgres:
    """A PostgreSQL server for one test module.

    Parameters
    ----------
    folder : Path
        An empty folder that any user may enter: as root, which PostgreSQL refuses to run as, the user is ``nobody``.
    password : str
        Password of its user ``postgres``.
    """

    def __init__(self, folder: Path, password: str) -> None:
        self.port, self._folder, self._password = free_port(), folder, password
        programs = postgres_folder()
        assert programs is not None
        self.programs = programs
        secret = folder / "password"
        secret.write_text(password)
        if os.getuid() == 0:
            for path in (folder, secret):
                shutil.chown(path, "nobody")
        self._call(
            "initdb", f"--pgdata={folder}/data", "--username=postgres", "--auth=scram-sha-256", f"--pwfile={secret}"
        )
        self.start()

    @property
    def uri(self) -> str:
        return f"postgresql://postgres:{self._password}@127.0.0.1:{self.port}/postgres"

    @property
    def variables(self) -> dict[str, str]:
        """Its address and login, as PostgreSQL's programs read them from the environment."""
        place = {"PGHOST": "127.0.0.1", "PGPORT": str(self.port)}
        return place | {"PGUSER": "postgres", "PGPASSWORD": self._password}

    def start(self) -> None:
        options = f"-p {self.port} -h 127.0.0.1 -k {self._folder} -F"
        self._call(
            "pg_ctl", "start", "--wait", f"--pgdata={self._folder}/data", f"--log={self._folder}/log", "-o", options
        )

    def stop(self) -> None:
        self._call("pg_ctl", "stop", "--mode=immediate", f"--pgdata={self._folder}/data")

    def dump(self) -> str:
        """All its contents as text."""
        return self._call("pg_dump", f"--dbname={self.uri}")

    def _call(self, name: str, *arguments: str) -> str:
        user: dict[str, Any] = {"user": "nobody", "group": "nogroup", "extra_groups": []} if os.getuid() == 0 else {}
        done = subprocess.run(
            [str(self.programs / name), *arguments],
            cwd=self._folder,
            stdout=subprocess.DEVNULL if name == "pg_ctl" else subprocess.PIPE,  # the server would keep a pipe open
            stderr=subprocess.DEVNULL if name == "pg_ctl" else subprocess.PIPE,
            text=True,
            check=True,
            **user,
        )
        return done.stdout or ""


#: No telemetry, and no workers for background jobs.
LEAN = {"MLFLOW_DISABLE_TELEMETRY": "true", "MLFLOW_SERVER_ENABLE_JOB_EXECUTION": "false"}


class Server:
    """An MLflow server; its workers are in its process group.

    Parameters
    ----------
    folder : Path
        Holds its artifacts and its log.
    store : str
        Address of its database.
    options : str
        Further options of ``mlflow server``.
    variables : str
        Further environment variables.
    """

    def __init__(self, folder: Path, store: str, *options: str, **variables: str) -> None:
        self.port, self.folder = free_port(), folder
        place = ["--backend-store-uri", store, "--artifacts-destination", f"{folder}/kept", "--workers", "1"]
        self._command = [sys.executable, "-m", "mlflow", "server", *place, *options]
        self._variables: Mapping[str, str] = variables
        self.start()

    @property
    def address(self) -> str:
        return f"http://127.0.0.1:{self.port}"

    def start(self) -> None:
        with (self.folder / "server.log").open("ab") as log:
            self._process = subprocess.Popen(
                [*self._command, "--host", "127.0.0.1", "--port", str(self.port)],
                env={**os.environ, **LEAN, **self._variables},
                cwd=self.folder,
                stdout=log,
                stderr=log,
                start_new_session=True,
            )
        try:
            wait_for(self.address, self._process)
        except AssertionError:
            raise AssertionError((self.folder / "server.log").read_text()) from None

    def signal(self, sign: signal.Signals) -> None:
        """Signal all its processes; after SIGSTOP it takes connections and never answers."""
        os.killpg(self._process.pid, sign)

    def kill(self) -> None:
        self.signal(signal.SIGKILL)
        self._process.wait()
