"""The command line: ``harness VERB ...``. Thin: every verb lives in a module of its own."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from harness.experiments import Settings

USAGE = """\
usage: harness VERB ...

  run [-m] [OVERRIDES]     one trial, a sweep, or an experiment (a Hydra application; every Hydra flag works)
  solve FILE --bodies N    tracks of your own in (.npz .mat .csv .c3d), structure, labels and a 3D view out
  plan [OVERRIDES]         what run would do: trials done, missing and failed, expected time and memory
  report [TABLES] [OVERRIDES]  rebuild the paper's tables from the tracker; runs no method
  compare [OVERRIDES]      measured against a blessed baseline or the published numbers; exit code 1 when worse
  bless NAME --reason ...  record what was measured as a baseline
  list [methods|datasets|experiments]
  new method|dataset NAME  write a method or dataset of your own: module, configuration and test, which run at once
  data list|get|verify|where
  sync                     bring every trial record into the tracker
  ui                       open the MLflow interface on the store
  doctor [OVERRIDES]       what of this installation works, and the remedy for what does not
  completion bash|zsh|fish print a shell's completion

  harness run dataset=dance_yoga method=ours
  harness run -m dataset=dance_yoga,face_yoga method=ours,edsc noise.level=0,0.02
  harness run +experiment=table1 && harness report table1
  harness solve tracks.npz --bodies 2

'harness VERB --help' says more. Exit codes: 0 ok, 1 worse than the baseline, 2 missing or failed, 3 usage, 130 interrupted.
"""


def main(argv: Sequence[str] | None = None) -> int:
    """Run one verb; returns its exit code. No error of the user's ends in a traceback."""
    arguments = list(sys.argv[1:] if argv is None else argv)
    if not arguments or arguments[0] in ("-h", "--help"):
        print(USAGE, end="")
        return 0 if arguments else 3
    if arguments[0] == "--version":
        from importlib import metadata

        print(f"nrsfm-harness {metadata.version('nrsfm-harness')}")
        return 0
    verb, rest = arguments[0], arguments[1:]
    if verb not in VERBS:
        print(f"harness: {verb[:40]!a} is not a verb; they are {', '.join(VERBS)}", file=sys.stderr)
        return 3
    from datasets.errors import DatasetError
    from harness.address import shown
    from harness.parsers import PARSERS
    from harness.record import UsageError
    from reports.text import printable

    try:
        if verb in PARSERS and not {"-h", "--help"}.isdisjoint(rest):
            PARSERS[verb]().read(rest)  # which ends here, before anything slow is loaded
        return VERBS[verb](rest)
    except UsageError as error:
        print(f"harness {verb}: {printable(shown(str(error)))}", file=sys.stderr)
        return 3
    except DatasetError as error:
        print(f"harness {verb}: {printable(error)}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        print(f"harness {verb}: interrupted; what was finished is kept", file=sys.stderr)
        return 128 + signal.SIGINT
    except BrokenPipeError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 128 + signal.SIGPIPE
    except OSError as error:
        if error.filename is None and error.errno is None:
            raise
        print(f"harness {verb}: {printable(error.filename or 'output')}: {error.strerror}", file=sys.stderr)
        return 2


def _run(argv: list[str]) -> int:
    from harness.run import main as run

    return run(argv)


def _solve(argv: list[str]) -> int:
    from harness.solving import main as solving

    return solving(argv)


def _plan(argv: list[str]) -> int:
    from harness.plan import main as plan

    return plan(argv)


def _report(argv: list[str]) -> int:
    from harness.report import main as report

    return report(argv)


def _compare(argv: list[str]) -> int:
    from harness.gate import compare_main

    return compare_main(argv)


def _bless(argv: list[str]) -> int:
    from harness.gate import bless_main

    return bless_main(argv)


def _list(argv: list[str]) -> int:
    from harness.listing import main as listing

    return listing(argv)


def _new(argv: list[str]) -> int:
    from harness.new import main as new

    return new(argv)


def _data(argv: list[str]) -> int:
    from harness.configurations import data_folder
    from harness.data import main as data

    return data(argv, data_folder())


def _sync(argv: list[str]) -> int:
    from harness import parsers
    from harness.tracking import Tracker
    from reports.text import printable

    settings = _settings(parsers.sync().read(argv).overrides)
    tracker = Tracker(settings.tracking_uri, settings.output)
    written, trouble = tracker.sync(settings.trials)
    print(f"{written} run{'' if written == 1 else 's'} written to {tracker.uri}")
    for line in trouble:
        print(f"harness sync: {printable(line)}", file=sys.stderr)
    return 2 if trouble else 0


def _ui(argv: list[str]) -> int:
    from harness import parsers
    from harness.address import is_server
    from harness.tracking import Tracker

    given = parsers.ui().read(argv)
    settings = _settings(given.overrides)
    tracker = Tracker(settings.tracking_uri, settings.output)
    if is_server(tracker.uri):
        print(tracker.uri)
        return 0
    _ = tracker.client
    command = [sys.executable, "-m", "mlflow", "ui", "--backend-store-uri", tracker.uri]
    command += ["--host", given.host, "--port", str(given.port)]
    print(f"http://{given.host}:{given.port} shows {tracker.uri}; Ctrl-C stops it", flush=True)
    return subprocess.call(command)


def _doctor(argv: list[str]) -> int:
    from harness.doctor import main as doctor

    return doctor(argv)


def _completion(argv: list[str]) -> int:
    from harness.completion import main as completion

    return completion(argv)


def _settings(overrides: Sequence[str]) -> Settings:
    from harness.configurations import compose_config
    from harness.experiments import read

    return read(compose_config(overrides))[1]


VERBS: dict[str, Callable[[list[str]], int]] = {
    "run": _run,
    "solve": _solve,
    "plan": _plan,
    "report": _report,
    "compare": _compare,
    "bless": _bless,
    "list": _list,
    "new": _new,
    "data": _data,
    "sync": _sync,
    "ui": _ui,
    "doctor": _doctor,
    "completion": _completion,
}
