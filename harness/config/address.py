"""Addresses of trackers: checks them, and keeps logins out of everything that is printed or stored."""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path
from urllib.parse import unquote

from nrsfm.harness.record.errors import UsageError

USER, PASSWORD = "MLFLOW_TRACKING_USERNAME", "MLFLOW_TRACKING_PASSWORD"  # as MLflow reads them
SECRETS = (USER, PASSWORD, "MLFLOW_TRACKING_TOKEN", "MLFLOW_TRACKING_URI")
SQLITE = "sqlite:///"
_SERVER = re.compile(r"https?://[^/\s]+")
_VARIABLE = r"\$\{oc\.env:\w+(,null)?\}"
_LOGIN_BY_VARIABLE = re.compile(rf"{_VARIABLE}[^@]*|\w+://({_VARIABLE}|[^:@$]+):{_VARIABLE}@[^@]*")


def is_server(uri: str) -> bool:
    """Whether an address is that of a server, not of a file."""
    return _SERVER.match(uri) is not None


def file_of(uri: str) -> Path | None:
    """The file of a SQLite store, None for a server: what follows ``sqlite:///`` is a path, whatever signs it has."""
    return Path(uri.removeprefix(SQLITE)) if uri.startswith(SQLITE) else None


def for_mlflow(uri: str) -> str:
    """The address as MLflow takes it, a file's path escaped; without the driver MLflow makes the escaped folder."""
    from sqlalchemy.engine import URL

    path = file_of(uri)
    return uri if path is None else URL.create("sqlite+pysqlite", database=str(path)).render_as_string()


def check(written: str, uri: str) -> None:
    """Refuse an address that MLflow cannot use, and one that holds a login in plain text.

    Parameters
    ----------
    written, uri : str
        The address as configured, with ``${oc.env:...}``, and as resolved.

    Raises
    ------
    UsageError
        If the address is refused. The message does not contain the login.
    """
    if "@" in uri and is_server(uri) and not _LOGIN_BY_VARIABLE.fullmatch(written):
        raise UsageError(f"tracking.uri holds a login; leave it out and set {USER} and {PASSWORD} in the environment")
    if file_of(uri) is None and not is_server(uri):
        raise UsageError(f"tracking.uri is {shown(uri)!r}, wanted sqlite:///FILE, or http://HOST:PORT of a server")


def split(uri: str) -> tuple[str, Mapping[str, str]]:
    """An address without its login, and the login as the environment variables that MLflow reads."""
    scheme, _, rest = uri.partition("://")
    login, at, place = rest.rpartition("@")
    if not (at and is_server(uri)):
        return uri, {}
    user, _, password = login.partition(":")
    return f"{scheme}://{place}", {USER: unquote(user), PASSWORD: unquote(password)}


def shown(text: str) -> str:
    """The text with the logins removed from all addresses in it; a file's address has none, though an @ perhaps."""
    return re.sub(r"(?<!sqlite)(://)[^\n]*@", r"\1", text)
