"""Labs and their grading: make the student version, run answers in a sandbox, judge them outside of it.

A solution notebook needs `question` and `number` from here. The rest are rooms of the command
`pendulab`; no module of the estimation side imports this package, and `selfcheck`, which student
notebooks import, needs NumPy and SciPy only.
"""

from pendulab.grading.cases import Question, number, question

__all__ = ["Question", "number", "question"]
