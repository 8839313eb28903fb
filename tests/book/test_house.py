"""The house itself: who imports whom, what files may say, and that the front page keeps its word."""

import ast
import re
import subprocess
import sys
from pathlib import Path

import pages
import pytest

ROOT = pages.ROOT
PACKAGE = ROOT / "src" / "pendulab"

# The way of the data. A room imports only from rooms to its left in this list; two rooms in one line may
# not know each other. A new room takes its place here on purpose.
ROOMS = [
    {"linalg"},
    {"angles", "codegen", "bound", "unroll"},
    {"gaussian", "lagrange"},
    {"system"},
    {"systems"},
    {"linear_model"},
    {"discretize", "sensors"},
    {"augment", "logarithms", "noise"},
    {"simulate"},
    {"sigma_points"},
    {"kalman"},
    {"ekf", "ukf"},
    {"cubature", "iterated_ekf", "square_root_ukf", "ukf_no_redraw"},
    {"timeline", "straight"},
    {"bias_states", "linearise", "particle"},
    {"grid"},
    {"likelihood"},
    {"adaptive"},
    {"track"},
    {"smooth", "observability", "chaos"},
    {"consistency", "bounds", "cost"},
    {"montecarlo", "recordings"},
    {"plotting", "animation", "page"},
    {"replications"},
]
WINGS = {"grading"}  # may import any room; no room imports it
FRONT = {"__init__"}  # the package's own list of names


def room(path: Path) -> str:
    return path.relative_to(PACKAGE).with_suffix("").parts[0]


def imports(path: Path) -> set[str]:
    """Rooms of the package that a module imports, however it writes it."""
    here = ["pendulab", *path.relative_to(PACKAGE).parent.parts]
    rooms = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            modules = [alias.name.split(".") for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            base = here[: len(here) + 1 - node.level] if node.level else []
            start = [*base, *(node.module or "").split(".")] if node.module else base
            modules = [start] if len(start) > 1 else [[*start, alias.name] for alias in node.names]
        else:
            continue
        rooms |= {module[1] for module in modules if module[0] == "pendulab" and len(module) > 1}
    return rooms


MODULES = sorted(path for path in PACKAGE.rglob("*.py") if room(path) not in FRONT)


@pytest.mark.parametrize("path", MODULES, ids=lambda path: path.relative_to(PACKAGE).as_posix())
def test_imports_go_from_right_to_left(path):
    place = {name: number for number, names in enumerate(ROOMS) for name in names}
    own, known = room(path), imports(path)
    assert own in place or own in WINGS, (
        f"{own} has no place yet: give it one in ROOMS ({Path(__file__).name})"
    )
    strangers = known - set(place) - WINGS - {own} - _plain_names()
    assert not strangers, f"{own} imports {strangers}, which has no place in ROOMS"
    if own not in WINGS:
        assert not known & WINGS, f"{own} belongs to the estimation side and must not know of {known & WINGS}"
        wrong = {other for other in known if other in place and other != own and place[other] >= place[own]}
        assert not wrong, f"{own} imports {wrong}, which stands beside it or to its right"


def _plain_names():
    """`from pendulab import Gaussian` is a name of the front door, not a room."""
    rooms = {path.stem for path in PACKAGE.glob("*.py")} | {
        path.name for path in PACKAGE.iterdir() if path.is_dir()
    }
    tree = ast.parse((PACKAGE / "__init__.py").read_text(encoding="utf-8"))
    exported = {
        alias.asname or alias.name
        for node in ast.walk(tree)
        if isinstance(node, ast.ImportFrom)
        for alias in node.names
    }
    return exported - rooms


def test_imports_are_seen_however_they_are_written(tmp_path, monkeypatch):
    monkeypatch.setattr(sys.modules[__name__], "PACKAGE", tmp_path)
    (tmp_path / "systems").mkdir()
    module = tmp_path / "systems" / "one.py"
    module.write_text(
        "from ..gaussian import Gaussian\nfrom .. import linalg\nfrom .two import x\n"
        "import pendulab.ekf\nfrom pendulab.ukf import predict\nfrom pendulab import track\nimport numpy\n"
    )
    assert imports(module) == {"gaussian", "linalg", "systems", "ekf", "ukf", "track"}


def tracked() -> list[Path]:
    listed = subprocess.run(
        ["git", "ls-files", "-z", "--cached", "--others", "--exclude-standard"],
        cwd=ROOT,
        capture_output=True,
        text=True,
    )
    if listed.returncode:
        pytest.skip("not a git checkout, so there is no list of the project's files")
    return [path for name in sorted(listed.stdout.split("\0")) if name and (path := ROOT / name).is_file()]


# Where somebody's machine shows: home folders, job folders, and this checkout's own place.
MACHINE = re.compile(
    r"/(?:home|Users)/\w+|(?<![\w.])/(?:work|root|workspace|builds)/\w|[A-Z]:\\\\?Users\b|/tmp/\w+[./]\w"
)


def test_no_file_names_a_machine():
    here = str(ROOT.parent)
    named = []
    for path in tracked():
        try:
            text = path.read_text(encoding="utf-8")
        except UnicodeDecodeError:
            continue
        for number, line in enumerate(text.splitlines(), start=1):
            if path == Path(__file__).resolve():
                continue
            if MACHINE.search(line) or (len(Path(here).parts) > 2 and here in line):
                named.append(f"{path.relative_to(ROOT)}, line {number}: {line.strip()[:100]}")
    assert not named, "paths of one machine do not belong in the project:\n" + "\n".join(named)


def test_machine_paths_are_recognised():
    assert (
        MACHINE.search('open("/home/ada/data.csv")')
        and MACHINE.search("file:///root/x")
        and MACHINE.search("/builds/x")
    )
    assert not MACHINE.search("src/pendulab/builds/flow") and not MACHINE.search(
        "https://example.org/homework/"
    )


def test_no_large_file_is_tracked():
    large = [path.relative_to(ROOT) for path in tracked() if path.stat().st_size > 1_000_000]
    assert not large, f"over 1 MB: {large}"


def test_readme_fits_two_screens():
    lines = (ROOT / "README.md").read_text(encoding="utf-8").splitlines()
    assert len(lines) <= 110
    assert max(map(len, lines)) <= 120


@pytest.mark.parametrize(
    "name", ["README.md", "CONTRIBUTING.md", "book/index.md", "book/installing.md", "book/checked.md"]
)
def test_commands_exist(name):
    """Every `make ...` that a reader is told to type is a target, and every file it points at is there."""
    text = (ROOT / name).read_text(encoding="utf-8")
    blocks = re.findall(r"^```(?:bash|text)\n(.*?)^```", text, re.M | re.S)
    code = "\n".join([*blocks, *re.findall(r"`([^`\n]+)`", text)])
    targets = set(re.findall(r"^([a-z-]+):", (ROOT / "Makefile").read_text(encoding="utf-8"), re.M))
    told = set(re.findall(r"^make (?:[A-Z]+=\S+ )*([a-z-]+)", code, re.M))
    assert told, f"{name} tells no command"
    assert told <= targets, f"{name} tells of {told - targets}, which the Makefile does not have"
    links = [link for link in re.findall(r"\]\(([^)#]+)\)|src=\"([^\"]+)\"", text)]
    files = [one or two for one, two in links if not re.match(r"https?:|mailto:", one or two)]
    gone = [
        file
        for file in files
        if not ((ROOT / name).parent / file).exists() and not ((ROOT / name).parent / f"{file}.md").exists()
    ]
    assert not gone, f"{name} points at {gone}"


def test_code_of_the_front_page_runs():
    (code,) = re.findall(r"```python\n(.*?)```", (ROOT / "README.md").read_text(encoding="utf-8"), re.S)
    names = {}
    exec(code, names)
    assert names["result"].mean.shape == names["truth"].shape


def test_style_of_the_code():
    said = subprocess.run(
        [sys.executable, "-m", "ruff", "check", "."], cwd=ROOT, capture_output=True, text=True
    )
    assert said.returncode == 0, said.stdout + said.stderr


def test_tests_run_what_they_should():
    """The package under test is this checkout's, and so is the interpreter's environment."""
    import pendulab

    assert Path(pendulab.__file__).resolve().parent == PACKAGE
    assert sys.prefix != sys.base_prefix, "run the tests in the project's environment: make test"
