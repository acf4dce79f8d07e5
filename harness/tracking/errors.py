"""Errors of a tracker, SQLite's or a server's, on one line with the remedy."""

from __future__ import annotations

import re
import sqlite3

from nrsfm.harness.config.address import PASSWORD, USER, is_server, shown

_ANEW = "move the file away, and 'nrsfm sync' makes a new one from the trials"

_SQLITE = (  # part of SQLite's message, explanation
    ("not a database", f"the file is not a SQLite database; {_ANEW}"),
    ("malformed", f"the file is damaged; {_ANEW}"),
    ("no such table", f"it is not an MLflow store; {_ANEW}"),
    ("no such column", f"it is not an MLflow store; {_ANEW}"),
    ("locked", "another process has locked it; run 'nrsfm sync' when that has ended"),
    ("disk is full", "No space left on device; make room and run 'nrsfm sync'"),
    ("disk I/O error", "the disk did not take it; make room and run 'nrsfm sync'"),
    ("readonly", "it is read-only; make it writable and run 'nrsfm sync'"),
    ("unable to open", "the file cannot be opened; tracking.uri=sqlite:///FILE names another"),
)

_SERVER = (  # pattern in the message of the server's client, explanation
    (r"NewConnectionError.*refused", "nothing answers there; is the server running?"),
    (r"NameResolutionError|NoSuchHost", "there is no host of this name"),
    (r"[Tt]imed out|[Tt]imeout", "it did not answer in time; MLFLOW_HTTP_REQUEST_TIMEOUT allows more seconds"),
    (r"RemoteDisconnected|Connection aborted|ConnectionReset|ProtocolError", "it broke off the connection"),
    (r"error code 401|401 Client Error", f"it does not know this user; set {USER} and {PASSWORD}"),
    (r"too many (5\d\d)", "it answers with an error of its own (status {}); see its log"),
)


def explain(error: BaseException, uri: str) -> str:
    """What is wrong with the tracker at ``uri``, on one line, with the remedy where it is known and without a login."""
    if sqlite := _sqlite_message(error):
        return next((text for part, text in _SQLITE if part in sqlite), " ".join(sqlite.split())[:300])
    message = shown(" ".join(str(error).split()))
    for pattern, text in _SERVER if is_server(uri) else ():
        if match := re.search(pattern, message):
            return text.format(*match.groups())
    return f"{type(error).__name__}: {message[:300]}"


def _sqlite_message(error: BaseException) -> str:
    """The SQLite error among the causes of an MLflow error; "" if there is none."""
    text = str(error)
    cause: BaseException | None = error
    while cause is not None and not isinstance(cause, sqlite3.Error):
        cause = getattr(cause, "orig", None) or cause.__cause__ or cause.__context__
    if cause is None:
        return text if "(sqlite3." in text else ""  # MLflow may drop the cause and keep its text
    return f"{type(cause).__name__}: {cause}"
