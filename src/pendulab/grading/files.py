"""Files that other people's names and programs may try to abuse."""

import hashlib
import os
import re
import tempfile
import unicodedata
from pathlib import Path


def write_atomically(path: Path, data: bytes) -> None:
    """Write a file so that a reader sees the old one or the new one, never a part."""
    handle, temporary = tempfile.mkstemp(dir=path.parent, prefix=".writing-")
    try:
        with os.fdopen(handle, "wb") as file:
            file.write(data)
            file.flush()
            os.fsync(file.fileno())
        os.chmod(temporary, 0o644)
        os.replace(temporary, path)
    except BaseException:
        os.unlink(temporary)
        raise


def write_if_new(path: Path, data: bytes) -> bool:
    """Write a file, and the folders above it, unless it holds these bytes; whether it was written."""
    if path.is_file() and path.read_bytes() == data:
        return False
    path.parent.mkdir(parents=True, exist_ok=True)
    write_atomically(path, data)
    return True


def hash_of(*parts: bytes) -> str:
    """SHA-256 of some bytes, in 32 hexadecimal digits."""
    digest = hashlib.sha256()
    for part in parts:
        digest.update(len(part).to_bytes(8, "big") + part)
    return digest.hexdigest()[:32]


def safe_name(name: str) -> str:
    """A file name without surprises for any name; two names never share one, whatever the file system.

    Lower-case letters, digits, dot, dash and underscore stay as they are; a name with anything else, or
    one that looks like the result of this, is shortened to those and told apart by a piece of its hash.
    """
    if re.fullmatch(r"[a-z0-9][a-z0-9._-]{0,99}", name) and not re.search(r"-[0-9a-f]{16}$", name):
        return name
    kept = re.sub(r"[^A-Za-z0-9_-]+", "-", name).strip("-")[:60]
    digest = hashlib.sha256(name.encode("utf-8", "surrogateescape")).hexdigest()[:16]
    return f"{kept or 'student'}-{digest}"


def plain_text(text: str, most: int = 300) -> str:
    """Text for a table or a page: no control characters, no broken Unicode, not longer than `most`."""
    text = text.encode("utf-8", "replace").decode("utf-8")
    text = "".join(c if c.isprintable() else " " for c in text)
    return text if len(text) <= most else text[: most - 1] + "…"


def spreadsheet_text(text: str) -> str:
    """Text that a spreadsheet shows and never runs as a formula."""
    text = plain_text(text)
    first = unicodedata.normalize("NFKC", text.lstrip())[:1]  # a spreadsheet may take ＝ or ﹦ for =
    return "'" + text if first and first in "=+-−@|%;,\t" else text
