"""Student versions of solution notebooks, byte for byte the same on every machine.

nbgrader does the work: its validator refuses a notebook whose marks are broken, its preprocessor
`ClearSolutions` takes the solution regions out, and `ClearOutput` the outputs. Cells tagged `hidden` go,
and every cell gets an id from its lab and place.
"""

import hashlib
import re
from pathlib import Path

import nbformat
from nbgrader.nbgraderformat import MetadataValidator, ValidationError
from nbgrader.preprocessors import ClearOutput, ClearSolutions
from traitlets.config import Config

from pendulab.grading.files import write_atomically
from pendulab.grading.lab import CODE_STUB, HIDDEN, TEXT_STUB

LEFTOVERS = re.compile(
    r"(BEGIN|END) SOLUTION|pendulab\.grading import .*(question|number|expression|figure)"
    r"|\.rehearse\("
)
KERNEL = {
    "kernelspec": {"display_name": "Python 3 (ipykernel)", "language": "python", "name": "python3"},
    "language_info": {"name": "python"},
}


def student_version(solution: nbformat.NotebookNode, name: str) -> nbformat.NotebookNode:
    """The notebook a student gets. The solution is left as it was.

    Raises
    ------
    ValueError : a solution region outside of a cell that nbgrader marks as one, markers that do not
        pair up, or something of the solution that would remain
    """
    lab = nbformat.from_dict(solution)
    lab.cells = [cell for cell in lab.cells if HIDDEN not in cell.metadata.get("tags", [])]
    config = Config()
    config.ClearSolutions.code_stub = {"python": CODE_STUB}
    config.ClearSolutions.text_stub = TEXT_STUB
    resources = {"unique_key": name}
    try:
        MetadataValidator().validate_nb(lab)
        for preprocessor in (ClearSolutions, ClearOutput):
            lab, resources = preprocessor(config=config).preprocess(lab, resources)
    except (RuntimeError, ValidationError) as error:
        raise ValueError(f"{name}: {error}") from error
    for place, cell in enumerate(lab.cells):
        if LEFTOVERS.search(cell.source):
            raise ValueError(f"{name}: something of the solution would remain in: {cell.source[:200]}")
        cell.id = hashlib.sha256(f"{name}/{place}".encode()).hexdigest()[:12]
        kept = {key: cell.metadata[key] for key in ("nbgrader", "tags") if cell.metadata.get(key)}
        cell.metadata = nbformat.from_dict(kept)
    lab.metadata = nbformat.from_dict(KERNEL | {"pendulab": {"lab": name}})
    lab.nbformat, lab.nbformat_minor = 4, 5
    nbformat.validate(lab)
    return lab


def render(path: Path) -> bytes:
    """The student version of a solution file, as the bytes of its file: UTF-8, LF, one at the end."""
    solution = nbformat.read(path, as_version=4)
    text = nbformat.writes(student_version(solution, path.stem), version=nbformat.NO_CONVERT)
    return (text.rstrip("\n") + "\n").encode("utf-8")


def stale(solutions: Path, labs: Path) -> list[Path]:
    """Files in `labs` that are missing, differ from what `solutions` generates, or have no source."""
    wanted = {path.name: render(path) for path in sorted(solutions.glob("*.ipynb"))}
    different = [
        labs / name
        for name, data in wanted.items()
        if not (labs / name).is_file() or (labs / name).read_bytes() != data
    ]
    return different + sorted(path for path in labs.glob("*.ipynb") if path.name not in wanted)


def release(solutions: Path, labs: Path) -> list[Path]:
    """Write every student version that is not current; return what was written.

    A notebook in `labs` without a source stays, because it may be somebody's work; `stale` names it.
    """
    labs.mkdir(parents=True, exist_ok=True)
    written = []
    for path in stale(solutions, labs):
        if (source := solutions / path.name).is_file():
            write_atomically(path, render(source))
            written.append(path)
    return written
