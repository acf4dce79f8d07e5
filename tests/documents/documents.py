"""The commands and Python snippets of the documents, and how a test tries each of them.

A command is a line of a ``sh`` block, a line of an indented block that starts with a program, or such a line between
single backquotes. Of :data:`RULES` the first that fits a command counts, and a command that none fits fails the test.
"""

from __future__ import annotations

import re
import shlex
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

ROOT = Path(__file__).parents[2]
CONF = ROOT / "src/nrsfm/conf"
PAGES = sorted(path.relative_to(ROOT).as_posix() for path in (*ROOT.glob("*.md"), *(ROOT / "docs").rglob("*.md")))
PAGES += ["examples/nrsfm-example/README.md"]
PROGRAMS = (
    "nrsfm",
    "eval",
    "make",
    "pip",
    "pytest",
    "python",
    "sbatch",
    "srun",
    "mlflow",
    "docker",
    "git",
    "ssh",
    "ray",
    "createuser",
    "createdb",
    "export",
)
#: Fences by language: what runs, and what is only shown.
RUN, SHOWN = ("sh", "python"), ("text", "yaml", "toml", "json", "math", "{toctree}", "{eval-rst}")


@dataclass(frozen=True)
class Command:
    """A command as it is written on a page, without its comment."""

    page: str
    line: int
    text: str

    @cached_property
    def words(self) -> list[str]:
        return shlex.split(self.text)

    def __str__(self) -> str:
        return f"{self.page}:{self.line}: {self.text}"


@dataclass(frozen=True)
class Block:
    """Lines of one kind: ``sh``, ``python``, another fence's language, ``indented``, or ``prose``."""

    kind: str
    line: int
    lines: tuple[str, ...]


def blocks(text: str) -> list[Block]:
    """Split a Markdown document into blocks."""
    result: list[Block] = []
    pending: list[str] = []
    kind, start = "prose", 1

    def close(after: str, number: int) -> None:
        nonlocal kind, start
        if pending:
            result.append(Block(kind, start, tuple(pending)))
        pending.clear()
        kind, start = after, number

    blank, fence = True, ""
    for number, line in enumerate(text.splitlines(), 1):
        mark = re.match(r"\s*(```+)(.*)", line)
        if fence:
            if mark and mark[1] == fence and not mark[2]:
                close("prose", number + 1)
                fence, blank = "", True
            else:
                pending.append(line)
            continue
        if mark:
            fence = mark[1]
            close(mark[2].split()[0] if mark[2].split() else "text", number + 1)
            continue
        indented = line.startswith("    ") and (blank or kind == "indented")
        if indented != (kind == "indented") and line.strip():
            close("indented" if indented else "prose", number)
        pending.append(line)
        blank = not line.strip()
    close("prose", 0)
    return result


def commands(page: str) -> list[Command]:
    """Every command of a page, in order."""
    found = []
    for block in blocks((ROOT / page).read_text(encoding="utf-8")):
        if block.kind == "prose":
            found += [Command(page, line, text) for line, text in _spans(block) if not _is_mention(text)]
        elif block.kind in ("sh", "indented"):
            for number, line in _joined(block):
                for part in re.split(r"\s+&&\s+", _uncommented(line)):
                    if part and (block.kind == "sh" or part.partition(" ")[0] in PROGRAMS):
                        found.append(Command(page, number, part))
    return found


def mentions(page: str) -> list[Command]:
    """Commands that a page's prose only mentions: a verb alone, or one with NAMES in the place of words."""
    every = [b for b in blocks((ROOT / page).read_text(encoding="utf-8")) if b.kind == "prose"]
    return [Command(page, line, text) for block in every for line, text in _spans(block) if _is_mention(text)]


def _spans(block: Block) -> list[tuple[int, str]]:
    """Line and text of code between backquotes that starts with a program."""
    text = "\n".join(block.lines)
    spans = [
        (text[: m.start()].count("\n"), " ".join(m[1].split())) for m in re.finditer(r"(?<!`)`([^`]+)`(?!`)", text)
    ]
    return [(block.line + line, code) for line, code in spans if code.partition(" ")[0] in PROGRAMS and " " in code]


def _is_mention(text: str) -> bool:
    return text.startswith("nrsfm ") and (text.count(" ") == 1 or bool(re.search(r"\b[A-Z]{4,}\b|\w\|\w", text)))


def _joined(block: Block) -> list[tuple[int, str]]:
    """A block's lines with their numbers; a line that ends in a backslash is joined with the next."""
    found: list[tuple[int, str]] = []
    goes_on = False
    for number, line in enumerate(block.lines, block.line):
        if goes_on:
            found[-1] = (found[-1][0], found[-1][1] + line.strip())
        else:
            found.append((number, line))
        goes_on = line.endswith("\\")
        if goes_on:
            found[-1] = (found[-1][0], found[-1][1].removesuffix("\\"))
    return found


def _uncommented(line: str) -> str:
    return re.sub(r"(^|\s+)#.*", "", line).strip()


def snippets(page: str) -> list[str]:
    """The Python of a page."""
    return ["\n".join(b.lines) for b in blocks((ROOT / page).read_text(encoding="utf-8")) if b.kind == "python"]


@dataclass(frozen=True)
class Rule:
    """How the commands that a pattern fits are tried.

    Every command is composed: its options are known, its configuration is made, its experiments are there. Beyond that,
    ``never`` says why it cannot run on a test machine. All others truly run, page by page, in ``make validate``; those
    marked ``quick`` also in ``make test``.

    Parameters
    ----------
    pattern : str
        Of the whole command.
    part : str
        Words that are added when it runs, so that it takes seconds: one scene of many, few points, few iterations.
    codes : tuple of int
        Exit codes that it may have.
    data : bool
        Whether it needs the real sequences (NRSFM_DATA).
    quick : bool
    never : str
    """

    pattern: str
    part: str = ""
    codes: tuple[int, ...] = (0,)
    data: bool = False
    quick: bool = False
    never: str = ""


ANY = r"(?: .*)?"
CLUSTER = "it needs a cluster, or a server: test_cluster.py runs it with programs that stand in for those"
RULES = (
    # what cannot run on a test machine
    Rule(r"make [\w-]+", never="it makes an environment of its own, or is the tests themselves"),
    Rule(r"pip install --constraint constraints.txt .*", never="it fills the environment that it is typed in"),
    Rule(r"nrsfm data get" + ANY, never="it downloads"),
    Rule(r"git clone .*", never="it needs the address that the page was found at"),
    Rule(r"python -m tests.fuzz.coverage .*", never="it takes as many minutes as there are readers, and an extra"),
    Rule(r"nrsfm ui" + ANY, never="it serves until it is stopped"),
    Rule(r"nrsfm (run|report|sync)\b.* (hydra/launcher=\w+ \S+|tracking)=.*", never=CLUSTER),
    Rule(r"(pip install '.*'|createuser|createdb|export|mlflow)" + ANY, never=CLUSTER),
    # whole experiments: one scene of them
    Rule(r"nrsfm run experiment=dense_full\w*", "dataset.points=60 dataset.frames=10 method.max_iter=5"),
    Rule(r"nrsfm run experiment=dense", "dataset.points=[60,60] dataset.frames=12 method.max_iter=5"),
    Rule(r"nrsfm run experiment=scaling", "dataset.points=100 dataset.frames=10"),
    Rule(r"nrsfm run experiment=noise .*dataset=.*", "method=edsc noise.level=0.02"),
    Rule(r"nrsfm run experiment=noise method=.*", "dataset=face_yoga noise.level=0.02 noise.repeat=0"),
    Rule(r"nrsfm run experiment=noise", "dataset=face_yoga noise.level=0.02 noise.repeat=0 method=edsc,adaptive"),
    Rule(r"nrsfm run experiment=cleaning", "dataset=face_yoga corruption=outliers_05 method=bmm_ssc3d_share70"),
    Rule(r"nrsfm run experiment=gaps", "dataset=face_yoga gaps.share=0.1 method=edsc"),
    Rule(r"nrsfm run experiment=(hopkins155|count_hopkins155)", "dataset.scene=1R2RC", data=True),
    Rule(r"nrsfm run experiment=table[12] .*", "dataset=face_yoga"),
    Rule(r"nrsfm run experiment=(table1|table2|tables)", "dataset=face_yoga method=edsc,adaptive"),
    Rule(r"nrsfm run experiment=dancers", "method=edsc"),
    Rule(r"nrsfm run experiment=ours_search", "dataset=face_yoga setting=short method.max_iter=5"),
    Rule(r"nrsfm run experiment=adaptive_search", "dataset=face_yoga noise.level=0 method.l1=[0.1,0.5]"),
    Rule(r"nrsfm run experiment=cameras", "dataset=face_yoga noise.level=0 cameras=refined"),
    Rule(r"nrsfm run experiment=smoothing", "dataset=face_yoga noise.level=0 method.smoothing=30"),
    Rule(r"nrsfm run experiment=ablation", "dataset=face_yoga noise.level=0 cameras=known method=adaptive"),
    Rule(r"nrsfm run experiment=table3", "dataset.take=p2_free_2 method=edsc", codes=(2,)),  # its files are absent
    Rule(r"nrsfm run experiment=table4", "dataset.face=1", codes=(2,)),  # its files are absent
    Rule(r"nrsfm run experiment=two_person", "dataset.take=salsa_01 cameras=known method=edsc", data=True),
    Rule(r"nrsfm run experiment=count_bodies", "dataset.bodies=[dance,yoga],[stretch,dance,yoga] method=edsc"),
    Rule(r"nrsfm run experiment=intersecting", "dataset=face_yoga method=edsc"),
    Rule(r"nrsfm run experiment=three_bodies", "method=edsc"),
    Rule(r"nrsfm run experiment=single_body", "dataset.body=shark"),
    Rule(r"nrsfm run experiment=leaderboard\w*", "dataset.body=pickup method=pta,organic"),
    Rule(r"nrsfm run experiment=scene_study", "dataset=face_yoga scene=default,native method=edsc", data=True),
    Rule(r"nrsfm run experiment=rank_study", "dataset=face_yoga method.rank=6,null", data=True),
    Rule(r"nrsfm run experiment=rotation_ablation", "dataset.body=shark change=none,rigid"),
    # tracks of one's own: the test puts files there
    Rule(r"nrsfm solve .*"),
    Rule(r"nrsfm run (-m )?dataset=tracks .*"),
    # single trials and small sweeps: as they are
    Rule(r"nrsfm run dataset=procedural method=adaptive", "dataset.points=8 dataset.frames=12", quick=True),
    Rule(r"nrsfm run .*"),
    # what reads: after a part of an experiment the rest is missing, which is exit code 2
    Rule(r"nrsfm plan dataset\.points=.*"),
    Rule(r"nrsfm plan .*", codes=(0, 2)),
    Rule(r"nrsfm report" + ANY, codes=(0, 2)),
    Rule(r"nrsfm compare experiment=table.*", codes=(2,)),
    Rule(r"nrsfm compare .*"),
    Rule(r"nrsfm bless .*"),
    Rule(r"nrsfm doctor" + ANY, codes=(0, 2)),  # it finds what a machine lacks
    Rule(r'eval "\$\(nrsfm completion bash\)"'),
    Rule(r"nrsfm list" + ANY, quick=True),
    Rule(r"nrsfm data (list|where|example)", quick=True),
    Rule(r"nrsfm data verify", codes=(0, 2)),
    Rule(r"nrsfm sync"),
    Rule(r"nrsfm new .* --package .*", quick=True),
    Rule(r"nrsfm new .*"),
    # what the shell story puts in their place: see test_documents.py
    Rule(r"pip install --editable [\w-]+"),
    Rule(r"pytest .*"),
)


def rule(command: Command) -> Rule | None:
    """The first rule that fits a command, or None."""
    return next((rule for rule in RULES if re.fullmatch(rule.pattern, command.text)), None)
