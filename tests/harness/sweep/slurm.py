"""As much of Slurm as a job array needs, on this machine: ``sbatch``, ``srun``, ``sacct``, ``scontrol`` on the path.

``sbatch`` starts a controller that runs the array's tasks, so many at a time as it is told, each in a session of its
own with the variables that Slurm sets; ``scontrol requeue`` has a task that ends run again. As Slurm does, it writes
down the environment that a job is to have.
"""

from __future__ import annotations

import itertools
import os
import re
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from pathlib import Path

HOME = "FAKE_SLURM"  # the variable that names the folder of its state


def install(folder: Path) -> dict[str, str]:
    """Put the programs into a folder; the environment variables that have them found."""
    for name in ("sbatch", "srun", "sacct", "scontrol", "scancel"):
        path = folder / "bin" / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(f'#!/bin/sh\nexec "{sys.executable}" "{__file__}" {name} "$@"\n')
        path.chmod(0o755)
    (folder / "jobs").mkdir()
    return {HOME: str(folder), "PATH": f"{folder / 'bin'}{os.pathsep}{os.environ['PATH']}"}


def jobs() -> Path:
    return Path(os.environ[HOME]) / "jobs"


def sbatch(script: str) -> None:
    for number in itertools.count(1000):
        try:
            (jobs() / str(number)).mkdir()
            break
        except FileExistsError:
            continue
    (jobs() / str(number) / "script.sh").write_text(Path(script).read_text())
    (jobs() / str(number) / "environment").write_text("\n".join(f"{k}={v}" for k, v in os.environ.items()))
    subprocess.Popen(
        [sys.executable, __file__, "controller", str(number)],
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        start_new_session=True,
    )
    print(f"Submitted batch job {number}")


def controller(number: str) -> None:
    folder = jobs() / number
    array = re.search(r"^#SBATCH --array=0-(\d+)%(\d+)$", (folder / "script.sh").read_text(), re.MULTILINE)
    last, most = map(int, array.groups()) if array else (0, 1)
    waiting, running = list(range(last + 1)), dict[int, subprocess.Popen[bytes]]()
    while waiting or running:
        for task, process in list(running.items()):
            if process.poll() is not None:
                del running[task]
                again = folder / f"{task}.requeue"
                if again.exists():
                    again.unlink()
                    waiting.append(task)
                else:
                    (folder / f"{task}.state").write_text("FAILED" if process.returncode else "COMPLETED")
        while waiting and len(running) < most:
            task = waiting.pop(0)
            (folder / f"{task}.state").write_text("RUNNING")
            running[task] = subprocess.Popen(
                ["bash", str(folder / "script.sh")],
                env=os.environ | _variables(number, task, array),
                start_new_session=True,
            )
            with (folder / f"{task}.starts").open("a") as starts:
                starts.write("x")
        time.sleep(0.05)


def _variables(number: str, task: int, array: object) -> dict[str, str]:
    alone = {"SLURM_JOB_ID": number}
    one = {"SLURM_JOB_ID": f"{number}{task:03}", "SLURM_ARRAY_JOB_ID": number, "SLURM_ARRAY_TASK_ID": str(task)}
    shared = {"SLURM_NTASKS": "1", "SLURM_JOB_NUM_NODES": "1", "SLURM_JOB_NODELIST": "localhost"}
    return (one if array else alone) | shared


def srun(*arguments: str) -> None:
    words, streams = list(arguments), {}
    while words[0].startswith("--"):
        option = words.pop(0)
        if option in ("--output", "--error"):
            streams[option] = words.pop(0)
    job, task = os.environ.get("SLURM_ARRAY_JOB_ID", ""), os.environ.get("SLURM_ARRAY_TASK_ID", "")
    for handle, option in ((1, "--output"), (2, "--error")):
        path = streams[option].replace("%A", job).replace("%a", task).replace("%t", "0")
        path = path.replace("%j", os.environ["SLURM_JOB_ID"])
        os.dup2(os.open(path, os.O_WRONLY | os.O_CREAT | os.O_APPEND, 0o644), handle)
    os.environ.update(dict.fromkeys(("SLURM_PROCID", "SLURM_LOCALID", "SLURM_NODEID"), "0"))
    os.execvp(words[0], words)


def sacct(*_: str) -> None:
    print("JobID|State|NodeList")
    for path in sorted(jobs().glob("*/*.state")):
        print(f"{path.parent.name}_{path.stem}|{path.read_text()}|localhost")


def scontrol(verb: str, job: str) -> None:
    assert verb == "requeue"
    number, _, task = job.partition("_")
    (jobs() / number / f"{task or 0}.requeue").touch()


def scancel(*_: str) -> None:
    """Nothing here asks for it."""


PROGRAMS: dict[str, Callable[..., None]] = {f.__name__: f for f in (sbatch, controller, srun, sacct, scontrol, scancel)}


def main(words: Sequence[str]) -> None:
    PROGRAMS[words[0]](*words[1:])


if __name__ == "__main__":
    main(sys.argv[1:])
