"""What only the instructors' edition shows, read from the solutions, so that it is what the grader does.

`{lab-overview}`      all labs: questions, points of the judge and of a person, mistakes known by name
`{lab-rubric} lab`    the questions that a person marks: model answer, points, rubric
`{lab-mistakes} lab`  every question of the judge: points, each mistake it knows, the message it sends
"""

import shutil
from functools import cache
from pathlib import Path

import nbformat
from docutils import nodes
from docutils.statemachine import StringList
from sphinx.util.docutils import SphinxDirective


def mirror_solutions(app, config):
    """Copy the solutions to where Sphinx must find its pages (that folder is not tracked)."""
    source, mirror = Path(app.srcdir).parent / "solutions", Path(app.srcdir) / "instructors" / "solutions"
    shutil.rmtree(mirror, ignore_errors=True)
    mirror.mkdir(parents=True)
    for path in sorted(source.glob("*.ipynb")):
        notebook = nbformat.read(path, as_version=4)
        notebook.cells[0].source = notebook.cells[0].source.replace("# ", "# Solved: ", 1)
        nbformat.write(notebook, mirror / path.name)


@cache
def _lab(path):
    import matplotlib

    matplotlib.use("agg")  # a lab draws its figures while it is read
    from pendulab.grading.lab import load

    return load(path)


class OfLab(SphinxDirective):
    """A directive whose argument is the name of a lab."""

    required_arguments = 1

    def solution(self) -> Path:
        path = Path(self.env.srcdir).parent / "solutions" / f"{self.arguments[0]}.ipynb"
        if not path.is_file():
            raise self.error(f"there is no solution {path.name}")
        self.env.note_dependency(str(path))
        return path

    def markdown(self, text: str) -> list[nodes.Node]:
        holder = nodes.container()
        self.state.nested_parse(StringList(text.splitlines(), self.arguments[0]), 0, holder)
        return holder.children


class Rubric(OfLab):
    def run(self):
        found = []
        for cell in nbformat.read(self.solution(), as_version=4).cells:
            if "rubric" in cell.metadata.get("tags", []):
                found += self.markdown(cell.source.replace(" (not in the student version)", ""))
            elif cell.cell_type == "markdown" and cell.metadata.get("nbgrader", {}).get("grade"):
                answer = cell.source.replace("### BEGIN SOLUTION\n", "").replace("\n### END SOLUTION", "")
                fence = "::::"
                found += self.markdown(f"{fence}{{admonition}} A model answer\n{answer}\n{fence}")
        if not found:
            raise self.error(f"{self.arguments[0]} has no question that a person marks")
        return found


class Mistakes(OfLab):
    def run(self):
        return [node for question in _lab(self.solution()).questions for node in self.of(question)]

    def of(self, question):
        title = nodes.paragraph()
        title += [nodes.literal(text=question.name), nodes.Text(f", {question.points:g} points")]
        listed = nodes.bullet_list()
        for message in dict.fromkeys(known.message for known in question.mistakes):
            listed += nodes.list_item("", nodes.paragraph(text=message))
        for law in dict.fromkeys(law.message for law in question.laws):
            listed += nodes.list_item("", nodes.paragraph(text=f"A law: {law}"))
        return [title, listed] if len(listed) else [title]


class Overview(SphinxDirective):
    """A table of all labs."""

    header = ("lab", "questions of the judge", "its points", "your points", "mistakes it knows by name")

    def run(self):
        solutions = sorted((Path(self.env.srcdir).parent / "solutions").glob("*.ipynb"))
        table = nodes.table()
        group = nodes.tgroup(cols=len(self.header))
        group += [nodes.colspec(colwidth=3 if k == 0 else 1) for k in range(len(self.header))]
        group += nodes.thead("", self.row(self.header))
        group += nodes.tbody("", *(self.row(self.numbers(_lab(path))) for path in solutions))
        table += group
        return [table]

    def numbers(self, lab):
        by_person = sum(m.points for m in lab.manual)
        known = sum(len(q.mistakes) for q in lab.questions)
        return lab.title, f"{len(lab.questions)}", f"{lab.points:g}", f"{by_person:g}", f"{known}"

    def row(self, cells):
        return nodes.row("", *(nodes.entry("", nodes.paragraph(text=text)) for text in cells))


def setup(app):
    app.add_directive("lab-overview", Overview)
    app.add_directive("lab-rubric", Rubric)
    app.add_directive("lab-mistakes", Mistakes)
    app.connect("config-inited", mirror_solutions, priority=1)
    return {"version": "1", "parallel_read_safe": True, "parallel_write_safe": True}
