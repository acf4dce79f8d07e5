"""The command ``nrsfm VERB ...``: calls the module of the verb, and turns errors into one line and an exit code."""

from __future__ import annotations

import os
import signal
import sys
from collections.abc import Sequence

from nrsfm.harness.cli import surroundings, verbs


def main(argv: Sequence[str] | None = None) -> int:
    """Run one verb; returns its exit code. Errors of usage, data and files are one line, without a traceback."""
    if "_ARGCOMPLETE" in os.environ:
        from nrsfm.harness.cli.completion import Finder

        Finder().answer()
    surroundings.prepare()
    arguments = list(sys.argv[1:] if argv is None else argv)
    if not arguments or arguments[0] in ("-h", "--help"):
        print(verbs.usage(), end="")
        return 0 if arguments else 3
    if arguments[0] == "--version":
        from importlib import metadata

        print(f"nrsfm {metadata.version('nrsfm')}")
        return 0
    verb, rest = arguments[0], arguments[1:]
    if verb not in verbs.VERBS:
        from nrsfm.harness.record.text import did_you_mean

        known = f"{', '.join(verbs.VERBS)}{did_you_mean(verb[:40], verbs.VERBS)}"
        print(f"nrsfm: {verb[:40]!a} is not a verb; they are {known}", file=sys.stderr)
        return 3
    from nrsfm.datasets.errors import DatasetError
    from nrsfm.harness.config.address import shown
    from nrsfm.harness.record.errors import UsageError
    from nrsfm.harness.record.imports import import_late
    from nrsfm.harness.record.text import printable

    import_late()
    try:
        module = verbs.module(verb)
        if not {"-h", "--help"}.isdisjoint(rest):
            module.command_line().read(rest)  # prints the help and exits, before anything slow is loaded
        return int(module.main(rest))
    except UsageError as error:
        print(f"nrsfm {verb}: {printable(shown(str(error)))}", file=sys.stderr)
        return 3
    except DatasetError as error:
        print(f"nrsfm {verb}: {printable(error)}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        print(f"nrsfm {verb}: interrupted; what was finished is kept", file=sys.stderr)
        return 128 + signal.SIGINT
    except BrokenPipeError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 128 + signal.SIGPIPE
    except OSError as error:
        if error.filename is None and error.errno is None:
            return _unexpected(verb, error)
        print(f"nrsfm {verb}: {printable(error.filename or 'output')}: {error.strerror}", file=sys.stderr)
        return 2
    except Exception as error:
        return _unexpected(verb, error)


def _unexpected(verb: str, error: Exception) -> int:
    from nrsfm.harness.record.text import one_line, printable

    what = printable(f"{type(error).__name__}: {one_line(error, 300)}")
    print(f"nrsfm {verb}: unexpected {what}; the traceback is in {surroundings.keep_traceback()}", file=sys.stderr)
    return 2
