"""What is wrong with a SQLite store, in one line with the remedy."""

from __future__ import annotations

import sqlite3

ANEW = "move the file away, and 'nrsfm sync' makes a new one from the trials"


_SAID = (  # SQLite's words, ours
    ("not a database", f"the file is no SQLite database; {ANEW}"),
    ("malformed", f"the file is damaged; {ANEW}"),
    ("no such table", f"it is no store of MLflow's; {ANEW}"),
    ("no such column", f"it is no store of MLflow's; {ANEW}"),
    ("locked", "another process holds it; 'nrsfm sync' brings the trials in when that has ended"),
    ("disk is full", "No space left on device; make room, and 'nrsfm sync' brings the trials in"),
    ("disk I/O error", "the disk did not take it; make room, and 'nrsfm sync' brings the trials in"),
    ("readonly", "it is read-only; with leave to write it 'nrsfm sync' brings the trials in"),
    ("unable to open", "the file cannot be opened; tracking.uri=sqlite:///FILE names another"),
)


def words(error: BaseException | None) -> str:
    """What SQLite says, wherever in the causes of an error of MLflow's it stands; "" where it says nothing."""
    told = str(error) if "(sqlite3." in str(error) else ""  # where MLflow keeps no cause
    while error is not None and not isinstance(error, sqlite3.Error):
        error = getattr(error, "orig", None) or error.__cause__ or error.__context__
    text = told if error is None else f"{type(error).__name__}: {error}"
    return next((said for word, said in _SAID if word in text), " ".join(text.split())[:300])
