"""A class is graded in a small part of the time that nbgrader's autograder takes.

`make bench-grading` takes a class of 1,000 and prints the table; here are a few, so that the start of the
program counts for much, and processor time, so that a busy machine does not decide.
"""

import grading


def test_a_notebook_costs_a_small_part_of_nbgraders_time(bubblewrap):
    """Whole runs, one behind the other; of ours the start and every report, of theirs the grading alone."""
    found = grading.measure(many=24, few=2)
    print("\n" + grading.table(found))
    assert found["processor_ratio"] > 10
    assert found["peak_MB"] < 300
