"""The instructors' edition: the students' book and one part more, from the same sources and the same runs.

    python book/_ext/pendulab_edition.py FOLDER

writes FOLDER/_toc.yml and FOLDER/_config.yml for `jupyter-book build`. What only instructors may read never
gets into the students' site, because its table of contents does not name it.
"""

import sys
from pathlib import Path

import yaml

BOOK = Path(__file__).resolve().parents[1]
CAPTION = "For instructors"


def table_of_contents() -> dict:
    """The students' table of contents, and before the appendices the part for instructors."""
    toc = yaml.safe_load((BOOK / "_toc.yml").read_text(encoding="utf-8"))
    at = next(i for i, part in enumerate(toc["parts"]) if part["caption"] == "Appendices")
    toc["parts"].insert(at, {"caption": CAPTION, "chapters": chapters()})
    return toc


def chapters() -> list[dict]:
    """The general pages, then one for each lab with its solution below it."""
    first = yaml.safe_load((BOOK / "instructors" / "_pages.yml").read_text(encoding="utf-8"))
    labs = [
        {"file": f"instructors/{path.stem[:5]}", "sections": [{"file": f"instructors/solutions/{path.stem}"}]}
        for path in sorted((BOOK.parent / "solutions").glob("*.ipynb"))
    ]
    return [{"file": f"instructors/{name}"} for name in first] + labs


def configuration() -> dict:
    """The students' configuration with another title, the same execution cache, and the labs' secrets."""
    config = yaml.safe_load((BOOK / "_config.yml").read_text(encoding="utf-8"))
    config["title"] += ": instructors' edition"
    config["execute"]["cache"] = str(BOOK / "_build" / ".jupyter_cache")
    config["execute"]["exclude_patterns"].append("instructors/solutions/*")  # they hold their outputs
    local = {name: str(BOOK / folder) for name, folder in config["sphinx"]["local_extensions"].items()}
    config["sphinx"]["local_extensions"] = local | {"pendulab_instructors": str(BOOK / "_ext")}
    return config


def main(folder: Path) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    for name, content in (("_toc.yml", table_of_contents()), ("_config.yml", configuration())):
        text = yaml.safe_dump(content, sort_keys=False, allow_unicode=True)
        (folder / name).write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main(Path(sys.argv[1]))
