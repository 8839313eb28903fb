"""Labs and their grading: make the student version, run answers in a sandbox, judge them outside of it.

A solution notebook needs `question`, `number`, `expression` and `figure` from here. The rest are rooms of
the command `pendulab`; no module of the estimation side imports this package, and `selfcheck`, which
student notebooks import, needs NumPy and SciPy only, and SymPy where an answer is an expression.
"""

from pendulab.grading.cases import Question, expression, figure, number, question

__all__ = ["Question", "expression", "figure", "number", "question"]
