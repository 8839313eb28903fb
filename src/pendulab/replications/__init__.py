"""One file a document: what it prints, where that is wrong or left open, and what its numbers come from.

A file is named after its author (or title) and year as in the book's bibliography. The filters in this room
are replicas: each says what is wrong with it and which function of the package does the same thing right.
Nothing else in the package imports them.
"""

from . import muzaffari2024, ukfslides

__all__ = ["muzaffari2024", "ukfslides"]
