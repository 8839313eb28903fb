"""What the book needs beyond Jupyter Book, as one small Sphinx extension.

1. `mirror_labs`    copies labs/ into the source folder, where Sphinx must find it (book/labs is not tracked).
2. `drop_old_runs`  drops from the execution cache what the package or its pins have outdated: the cache's own
                    key is the cells of a page only.
3. `bring_mathjax`  lets the site carry its own MathJax, so that pages open from disk and without a network.
4. `drop_thebe`     removes an extension that Jupyter Book always loads and that loads a script from outside.
5. `ByName`         lists the bibliography by author, each entry under the name and year that the text cites.
"""

import filecmp
import hashlib
import json
import shutil
from importlib.util import find_spec
from pathlib import Path

from jupyter_cache import get_cache
from pybtex.plugin import register_plugin
from pybtex.style.formatting.unsrt import Style
from pybtex.style.labels import BaseLabelStyle

MATHJAX = "static/mathjax/tex-svg-full.js"
EVERY_RUN_DEPENDS_ON = ("src/pendulab/**/*", "requirements.txt")
# What only some pages run: their cells name it.
SOME_RUNS_DEPEND_ON = {
    "replications": ("src/pendulab/replications/**/*", "book/replications.json"),
    "bench": ("tests/bench/*.py", "book/bench.json"),
}
NO_PAGE_RUNS = {"__pycache__", "grading"}


def mirror_labs(app, config):
    source, mirror = Path(app.srcdir).parent / "labs", Path(app.srcdir) / "labs"
    wanted = {path.name: path for path in sorted(source.glob("*.ipynb"))}
    mirror.mkdir(exist_ok=True)
    for path in mirror.iterdir():
        if path.is_file() and path.name not in wanted:
            path.unlink()
    for name, path in wanted.items():
        if not (mirror / name).exists() or not filecmp.cmp(path, mirror / name, shallow=False):
            shutil.copyfile(path, mirror / name)


def fingerprint(root, patterns, but=frozenset()):
    """One hash of files; of those in a folder, or with a stem, that `but` names, nothing counts."""
    digest = hashlib.sha256()
    for pattern in patterns:
        for path in sorted(root.glob(pattern)):
            if path.is_file() and not (NO_PAGE_RUNS | but) & {*path.relative_to(root).parts, path.stem}:
                content = hashlib.sha256(path.read_bytes()).hexdigest()
                digest.update(f"{path.relative_to(root).as_posix()} {content}\n".encode())
    return digest.hexdigest()


def fingerprints(root):
    """What the output of a page depends on beside its own cells: of every page "", of some by their word."""
    some = {word: fingerprint(root, patterns) for word, patterns in SOME_RUNS_DEPEND_ON.items()}
    return {"": fingerprint(root, EVERY_RUN_DEPENDS_ON, but=set(some)), **some}


def drop_old_runs(app, config):
    runs = Path(config.nb_execution_cache_path or Path(app.outdir).parent / ".jupyter_cache")
    forget_old_runs(runs, Path(app.srcdir).parent)


def forget_old_runs(runs, root):
    """Drop from the execution cache `runs` the pages that what they depend on has outdated, and note it."""
    stamp, current = runs.with_name("runs_depend_on"), fingerprints(root)
    try:
        before = json.loads(stamp.read_text())
    except (OSError, ValueError):
        before = {}
    changed = {word for word, value in current.items() if before.get(word) != value}
    if "" in changed:
        shutil.rmtree(runs, ignore_errors=True)
    elif changed and runs.exists():
        cache = get_cache(runs)
        for record in cache.list_cache_records():
            cells = " ".join(cell.source for cell in cache.get_cache_bundle(record.pk).nb.cells)
            if any(word in cells for word in changed):
                cache.remove_cache(record.pk)
    runs.parent.mkdir(parents=True, exist_ok=True)
    stamp.write_text(json.dumps(current))


def bring_mathjax(app, exception):
    if exception is None and app.builder.format == "html":
        package = Path(find_spec("sphinx-mathjax-offline").submodule_search_locations[0])
        target = Path(app.outdir) / "_static" / app.config.mathjax_path
        target.parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(package / MATHJAX, target)


def drop_thebe(app):
    for listeners in app.events.listeners.values():
        listeners[:] = [one for one in listeners if not one.handler.__module__.startswith("sphinx_thebe")]
    app.registry.css_files[:] = [css for css in app.registry.css_files if "thebe" not in str(css[0])]


class NameAndYear(BaseLabelStyle):
    def format_labels(self, entries):
        labels = [self.label(entry) for entry in entries]
        for i, label in enumerate(labels):  # of several works of a year, the second is b
            earlier = labels[:i].count(label)
            yield label + (chr(ord("a") + earlier) if labels.count(label) > 1 else "")

    def label(self, entry):
        first, *others = entry.persons["author"]
        name = " ".join([*first.prelast_names, *first.last_names])
        if len(others) == 1:
            name += " and " + " ".join(others[0].last_names)
        elif others:
            name += " et al."
        return f"{name.strip('{}')} {entry.fields['year']}"


class ByName(Style):
    default_sorting_style = "author_year_title"
    default_label_style = NameAndYear


def setup(app):
    register_plugin("pybtex.style.formatting", "by_name", ByName)
    drop_thebe(app)
    app.connect("config-inited", mirror_labs, priority=1)
    app.connect("config-inited", drop_old_runs, priority=1)
    app.connect("build-finished", bring_mathjax)
    return {"version": "1", "parallel_read_safe": True, "parallel_write_safe": True}
