"""The command line of every verb: its words, its options, and commands to learn it from. Loads nothing else.

Help and a shell's completion are answered from here alone, so neither waits for a numerical library.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path

from harness.arguments import FILES, Parser, Words

CODES = "exit codes: 0 ok, 1 worse than the baseline, 2 missing or failed, 3 usage"
SHELLS = ("bash", "zsh", "fish")
REPORTED = ("table1", "table2")  # the experiments that 'harness report' shows by default


def run() -> Parser:
    """Shows and completes what Hydra parses."""
    parser = Parser(
        "harness run",
        "Run one trial, a sweep, or an experiment. What is done already is not repeated.",
        """\
harness run  # one trial on generated bodies, by conf/config.yaml
harness run dataset=dance_yoga method=ours  # one trial on two real sequences
harness run dataset=procedural 'dataset.bodies=[person,face]' dataset.points=20 dataset.frames=40
harness run dataset=dance_yoga,face_yoga method=ours,edsc noise.level=0,0.02  # a sweep: 8 trials
harness run +experiment=table1  # what table 1 of the paper asks
harness run +experiment=table2 method=ours,bmm_ssc3d cameras=estimated  # the same table, changed
harness run +experiment=table1 rerun=failed workers=4  # what failed, on four processes
harness run +experiment=noise hydra/launcher=joblib  # workers of another launcher
harness run --cfg job method=edsc  # the configuration, and nothing runs""",
        "A group takes the name of one of its files, 'harness list' names them; a key takes a value: 'harness run\n"
        "--cfg job' shows all keys. A comma spans a sweep. HARNESS_OUTPUT names the folder to write to, NRSFM_DATA\n"
        "that of the real sequences. Values that hold brackets or spaces want quotes: 'dataset.placement=[3,0,0]'.\n\n"
        "run is a Hydra application: 'harness run --hydra-help' explains Hydra's own flags.\n\n"
        "exit codes: 0 every trial is ok, 2 one is missing or failed, 3 usage; then nothing has run",
    )
    parser.add_overrides()
    parser.add_argument("-m", "--multirun", action="store_true", help="a sweep; a comma in an override says it as well")
    parser.add_argument("-c", "--cfg", choices=["job", "hydra", "all"], help="show the configuration and run nothing")
    parser.add_argument("-p", "--package", metavar="KEY", help="with --cfg: show this part of it alone")
    parser.add_argument("--resolve", action="store_true", help="with --cfg: put values in the place of ${...}")
    parts = ("all", "config", "defaults", "defaults-tree", "plugins", "searchpath")
    text = f"show what Hydra has found of {', '.join(parts)}, and run nothing"
    parser.add_argument("-i", "--info", choices=parts, metavar="PART", help=text)
    parser.add_argument("-cd", "--config-dir", type=Path, metavar="FOLDER", help="add the files of a tree like conf/")
    parser.add_argument("--hydra-help", action="store_true", help="Hydra's own help")
    return parser


def solve() -> Parser:
    parser = Parser(
        "harness solve",
        "Reconstruct tracks of your own in 3D, and tell the bodies apart. No tracker is needed.",
        """\
harness solve tracks.npz --bodies 2  # arrays: tracks (F, 2, P) or W (2F, P); NaN is not observed
harness solve tracks.mat --bodies 3 --method bmm_ssc3d
harness solve tracks.csv --bodies auto  # a line for each observation: frame,track,x,y[,label][,visible]
harness solve wide.csv --bodies 2  # a line for each frame: x_A,y_A,x_B,y_B,... or A.x,A.y,B.x,B.y,...
harness solve take.c3d  # markers in 3D, seen by a camera that circles; the truth is known
harness solve tracks.npz --bodies 2 --rank 7  # cameras from the tracks, which deform in 7 shapes
harness solve tracks.npz --bodies 2 method.max_iter=300 limits.memory_gb=16""",
        """\
fields of .npz and .mat, all but the tracks optional (rows of a frame stand together):
  tracks or W     (F, 2, P) or (2F, P), rows x, y      visible     (F, P), 1 where a track is observed
  cameras, R, Rs  (F, 2, 3) or (2F, 3), orthonormal    labels, s   (P,), the true body of each track
  structure or S  (F, 3, P) or (3F, P), the truth

written into the folder: reconstruction.npz, structure.csv, labels.csv, cameras.csv, affinity.csv, summary.txt,
result.json, ply/frame_0000.ply and so on, and view.html (3D, for any browser, no network).

exit codes: 0 solved, 2 the file cannot be used or the method failed, 3 wrong usage""",
    )
    parser.add_words("file", _path, help="tracks: .npz, .mat, .csv or .c3d")
    parser.add_overrides(
        only=("method.", "cameras.", "limits.", "threads="), more="; of the method, the cameras, memory or threads"
    )
    words = "how many bodies there are, or auto to have them counted, which is seldom right"
    parser.add_argument("--bodies", metavar="N", help=f"{words}; left out, the number of the file's labels")
    parser.add_words("--method", _choices("method"), default="ours", help="any of 'harness list methods' (ours)")
    parser.add_argument(
        "--cameras", choices=("auto", "known", "estimated"), default="auto", help="the file's, if it has some"
    )
    parser.add_argument("--rank", type=int, metavar="K", help="shapes that the estimation of cameras allows (11)")
    parser.add_argument("--out", type=Path, metavar="FOLDER", help="where to write (solve/NAME in HARNESS_OUTPUT)")
    parser.add_argument("--open", action="store_true", help="open the 3D view in a browser")
    return parser


def plan() -> Parser:
    parser = Parser(
        "harness plan",
        "Say what 'harness run' would do with the same overrides. Trials done, missing and failed are told apart, "
        "with the time, the memory and the disk that they will take.",
        """\
harness plan +experiment=table1
harness plan method=ours,edsc noise.level=0,0.02 workers=4
harness plan +experiment=noise rerun=failed  # what 'harness run' would repeat
harness plan +experiment=noise --all  # every trial, not methods and states
harness plan +experiment=noise --json  # for machines
harness plan +experiment=dense_full limits.memory_gb=4  # what does not fit is refused before it runs""",
        "Time is that of past trials of the method and size; where there are none, of the nearest size, scaled. What\n"
        "it rests on stands beside it.\n\n"
        "exit codes: 0 nothing failed for good and nothing is in the way, 2 otherwise, 3 usage",
    )
    parser.add_overrides()
    parser.add_argument("-m", "--multirun", action="store_true", help="as of 'harness run'; changes nothing here")
    parser.add_argument("--all", action="store_true", help="a row for every trial, however many there are")
    parser.add_argument("--json", action="store_true", help="every trial and the sums, for machines")
    return parser


def report() -> Parser:
    parser = Parser(
        "harness report",
        "Rebuild tables, figures and claims from what was run; no method runs. Written are index.html, the tables as "
        "md, tex (as in the paper, and for audit), html, csv and json, and the paper's claims.",
        """\
harness report  # tables 1 and 2, here and in outputs/report
harness report --claims  # the paper's claims, held or not
harness report table1 noise convergence --figures  # figures as svg, pdf and png as well
harness report table1 dataset.motion=native 'dataset.placement=[3,0,0]'
harness report table1 table2 --into README.md --quiet  # renew the tables of a document""",
        "exit codes: 0 every cell has its number, 2 a trial is missing or failed, 3 usage",
    )
    parser.add_overrides("words", "TABLE|OVERRIDE", f"; or an experiment by its name ({' '.join(REPORTED)} by default)")
    parser.offers["words"] = _choices("experiment")
    parser.add_argument("--folder", type=Path, help="where to write; OUTPUT/report by default")
    parser.add_argument("--claims", action="store_true", help="print the paper's claims in place of the tables")
    parser.add_argument("--figures", action="store_true", help="also draw the figures: svg, pdf and png")
    parser.add_argument(
        "--into", type=Path, metavar="FILE", help="also renew the tables between <!-- TABLE --> and <!-- end TABLE -->"
    )
    parser.add_argument("--quiet", action="store_true", help="write the files, print no tables")
    return parser


def compare() -> Parser:
    parser = Parser(
        "harness compare",
        "Hold measured runs against a blessed baseline, which blocks, and the published numbers, which inform.",
        """\
harness compare +experiment=quick
harness compare +experiment=table1 compare.baseline=tables
harness compare +experiment=table2 compare.baseline=tables --strict
harness compare +experiment=table2 compare.against=published
harness compare +experiment=quick --markdown gate.md --junit gate.xml  # for a CI's summary and test report""",
        CODES,
    )
    parser.add_overrides(more="; +experiment=quick when none is named")
    parser.add_argument("--all", action="store_true", help="show cells that pass, too")
    parser.add_argument("--strict", action="store_true", help="the published numbers block as well, not only inform")
    for name in ("markdown", "junit", "json"):
        parser.add_argument(f"--{name}", type=Path, metavar="FILE", help=f"also write the comparison as {name}")
    return parser


def bless() -> Parser:
    parser = Parser(
        "harness bless",
        "Record measured runs as a baseline, with the reason why they are right.",
        """\
harness bless quick --reason 'exact E-step' +experiment=quick
harness bless tables --reason 'scipy 1.17 finds the eigenvectors to more digits' +experiment=tables
harness bless my_lab.json --reason 'first measured' +experiment=quick method=ours  # a file of your own""",
        "'harness compare +experiment=quick compare.baseline=my_lab.json' holds later runs against it.\n\n"
        "exit codes: 0 written, 3 usage: nothing to bless, or no reason",
    )
    parser.add_words("name", _baselines, help="one of reports/baselines, or a path that ends in .json")
    parser.add_overrides(more="; +experiment=NAME when none is named")
    parser.add_argument("--reason", required=True, help="why these numbers are right; kept in the file")
    return parser


def listing() -> Parser:
    parser = Parser(
        "harness list",
        "Methods, datasets and experiments, one line each. What installed packages bring is named with the package.",
        "harness list\nharness list methods\nharness list experiments",
        "What is wrong with an installed package goes to standard error, a line each.",
    )
    parser.add_argument("what", nargs="?", choices=["methods", "datasets", "experiments"], help="all, if left out")
    return parser


def new() -> Parser:
    parser = Parser(
        "harness new",
        "Write a method or a dataset of your own. Its module, configuration and test run at once. "
        "In a checkout of the harness they go into its folders, elsewhere into a package to install.",
        """\
harness new method my_method  # then: harness run +experiment=quick method=my_method
harness new dataset my_scenes
harness new method other --package my-package  # into a package, made if it is missing""",
        "exit codes: 0 written, 3 usage: a name that is taken or cannot be one, a file that is there already",
    )
    parser.add_argument("kind", choices=["method", "dataset"], help="what to write")
    parser.add_argument("name", help="lower case letters, digits and _")
    parser.add_argument("--package", type=Path, metavar="FOLDER", help="write into this package, made if it is missing")
    return parser


def data() -> Parser:
    """Its four verbs have parsers of their own."""
    from datasets import sources

    parser = Parser(
        "harness data",
        "List, fetch and check the public data, and say where it is kept.",
        """\
harness data list  # every file of the catalogue: state, size, terms, source
harness data get  # fetch what the paper's tables need and is absent
harness data get hopkins155  # the 155 motion segmentation scenes (27 MB)
harness data get drink shark  # the files of two sequences
harness data verify  # check what is there against its SHA-256
NRSFM_DATA=~/nrsfm harness data where""",
        "exit codes: 0 fine, 2 a file is missing or wrong, 3 wrong usage\n"
        "The folder is NRSFM_DATA where that is set. Without any files the procedural scenes stand in for the real\n"
        "sequences, and every page says so.",
    )
    verbs = parser.add_subparsers(dest="verb", metavar="{list,get,verify,where}", required=True)
    names = "a group (mocap, hopkins155, c3d), a file (mocap/drink.mat, drink) or a sequence (shark); {} by default"
    for verb, text in (
        ("list", "every file: state, size, terms, source"),
        (
            "get",
            "fetch the files that are absent or damaged; a file is put in its place only once its SHA-256 is right",
        ),
        ("verify", "check the SHA-256 of what is there; files that are named must be there"),
    ):
        default = f"all but {', '.join(sorted(sources.ON_REQUEST))}" if verb == "get" else "all"
        parsed = verbs.add_parser(verb, help=text, description=text)
        parsed.add_words("names", _files, nargs="*", metavar="NAME", help=names.format(default))
    text = "print the data folder, and whether it comes from NRSFM_DATA"
    verbs.add_parser("where", help=text, description=text)
    return parser


def sync() -> Parser:
    parser = Parser(
        "harness sync",
        "Bring every trial record into the tracker. For after it was away or lost, and for another one.",
        """\
harness sync
harness sync output=elsewhere  # the trials of another folder, into its own store
harness sync tracking=server tracking.uri=http://127.0.0.1:5000  # into an MLflow server""",
        "A trial's record in outputs/trials is the truth; the tracker can be rebuilt from it at any time.",
    )
    parser.add_overrides()
    return parser


def ui() -> Parser:
    parser = Parser(
        "harness ui",
        "Open the MLflow interface on the store. It shows parameters, metrics and residual curves of every run.",
        """\
harness ui
harness ui --port 5001 output=elsewhere
harness ui tracking=server tracking.uri=http://127.0.0.1:5000  # prints the server's address""",
        "Without a server it runs until Ctrl-C, for this machine alone; --host lets others in.",
    )
    parser.add_argument("--port", type=int, default=5000, help="of this machine; %(default)s by default")
    parser.add_argument("--host", default="127.0.0.1", help="address to listen on; %(default)s by default")
    parser.add_overrides()
    return parser


def doctor() -> Parser:
    parser = Parser(
        "harness doctor",
        "Say what of this installation works and what does not, each problem with its remedy.",
        """\
harness doctor
harness doctor workers=8 threads=2  # would a run with these fit this machine?
harness doctor tracking=server tracking.uri=http://127.0.0.1:5000  # does the server answer?
harness doctor --json > doctor.json  # to send along; holds no passwords""",
        "exit codes: 0 usable, 2 a problem stands in the way, 3 usage",
    )
    parser.add_overrides()
    parser.add_argument("--json", action="store_true", help="print the findings as JSON")
    return parser


def completion() -> Parser:
    parser = Parser(
        "harness completion",
        "Print a shell's completion of verbs, options, configuration groups, their choices, and keys.",
        """\
eval "$(harness completion bash)"  # this shell; in ~/.bashrc every shell
eval "$(harness completion zsh)"  # in ~/.zshrc, too
harness completion fish | source  # in ~/.config/fish/config.fish, too""",
        "What installed packages bring is completed as well. Try: harness run method=<TAB>",
    )
    parser.add_argument("shell", choices=SHELLS, help="the shell that is to complete")
    return parser


#: By verb, in the order of the usage.
PARSERS: Mapping[str, Callable[[], Parser]] = {
    "run": run,
    "solve": solve,
    "plan": plan,
    "report": report,
    "compare": compare,
    "bless": bless,
    "list": listing,
    "new": new,
    "data": data,
    "sync": sync,
    "ui": ui,
    "doctor": doctor,
    "completion": completion,
}


def _choices(group: str) -> Words:
    def offers() -> Mapping[str, str]:
        from harness.extensions import choices

        return {name: line for name, (line, _) in choices(group).items()}

    return offers


def _path() -> Mapping[str, str]:
    return {FILES: ""}


def _baselines() -> Mapping[str, str]:
    from importlib import resources

    names = (file.name for file in resources.files("reports.baselines").iterdir())
    return {name.removesuffix(".json"): "" for name in sorted(names) if name.endswith(".json")}


def _files() -> Mapping[str, str]:
    from datasets import sources

    return {word: file.source for file in sources.select() for word in sorted(file.words)}
