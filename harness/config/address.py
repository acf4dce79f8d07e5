"""A tracker's address, whose login is kept apart and never shown."""

from __future__ import annotations

import re
from collections.abc import Mapping
from urllib.parse import unquote

from nrsfm.harness.record.errors import UsageError

USER, PASSWORD = "MLFLOW_TRACKING_USERNAME", "MLFLOW_TRACKING_PASSWORD"  # as MLflow reads them
SECRETS = (USER, PASSWORD, "MLFLOW_TRACKING_TOKEN", "MLFLOW_TRACKING_URI")
_SERVER = re.compile(r"https?://[^/\s]+")
_VARIABLE = r"\$\{oc\.env:\w+(,null)?\}"
_UNTOLD = re.compile(rf"{_VARIABLE}[^@]*|\w+://({_VARIABLE}|[^:@$]+):{_VARIABLE}@[^@]*")  # how a login may be written


def is_server(uri: str) -> bool:
    """Whether an address is a server's and not a file's."""
    return _SERVER.match(uri) is not None


def check(written: str, uri: str) -> None:
    """Refuse an address that no tracker has, and one whose login stands in it for everybody to read.

    Parameters
    ----------
    written, uri : str
        As configured, ``${oc.env:...}`` and all, and as resolved.

    Raises
    ------
    UsageError
        In words without the login.
    """
    if "@" in uri and is_server(uri) and not _UNTOLD.fullmatch(written):
        raise UsageError(f"tracking.uri holds a login; leave it out and set {USER} and {PASSWORD} in the environment")
    if not (uri.startswith("sqlite:///") or is_server(uri)):
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
    """A text, of one line or more, without the logins of its addresses."""
    return re.sub(r"(?<=://)[^\n]*@", "", text)
