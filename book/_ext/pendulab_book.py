"""What the book needs beyond Jupyter Book, as one small Sphinx extension.

1. `mirror_labs`    copies labs/ into the source folder, where Sphinx must find it (book/labs is not tracked).
2. `drop_old_runs`  empties the execution cache when the package or its pins changed: the cache's own key
                    is the cells of a page only.
3. `bring_mathjax`  lets the site carry its own MathJax, so that pages open from disk and without a network.
4. `drop_thebe`     removes an extension that Jupyter Book always loads and that loads a script from outside.
5. `ByName`         lists the bibliography by author, each entry under the name and year that the text cites.
"""

import filecmp
import hashlib
import shutil
from importlib.util import find_spec
from pathlib import Path

from pybtex.plugin import register_plugin
from pybtex.style.formatting.unsrt import Style
from pybtex.style.labels import BaseLabelStyle

MATHJAX = "static/mathjax/tex-svg-full.js"
RUNS_DEPEND_ON = ("src/pendulab/**/*", "requirements.txt", "tests/bench/*.py", "book/bench.json")


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


def fingerprint(root):
    """One hash of everything that a page's output depends on beside its own cells."""
    digest = hashlib.sha256()
    for pattern in RUNS_DEPEND_ON:
        for path in sorted(root.glob(pattern)):
            if path.is_file() and not {"__pycache__", "grading"} & {*path.parts, path.stem}:  # no page's
                content = hashlib.sha256(path.read_bytes()).hexdigest()
                digest.update(f"{path.relative_to(root).as_posix()} {content}\n".encode())
    return digest.hexdigest()


def drop_old_runs(app, config):
    runs = Path(config.nb_execution_cache_path or Path(app.outdir).parent / ".jupyter_cache")
    forget_old_runs(runs, Path(app.srcdir).parent)


def forget_old_runs(runs, root):
    """Empty the execution cache `runs` if what its runs depend on has changed, and note what that is now."""
    stamp, current = runs.with_name("runs_depend_on"), fingerprint(root)
    if not stamp.exists() or stamp.read_text() != current:
        shutil.rmtree(runs, ignore_errors=True)
    runs.parent.mkdir(parents=True, exist_ok=True)
    stamp.write_text(current)


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
