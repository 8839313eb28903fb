"""What a cell finds in its box: no process of an earlier cell, no package but the lab's."""


def test_a_cells_processes_end_with_it(grade, student):
    leave = "import os, time\nif os.fork() == 0:\n    os.setsid()\n    time.sleep(1000)"
    look = """
import os
def running():
    pids = [p for p in os.listdir('/proc') if p.isdigit()]
    return [p for p in pids if open(f'/proc/{p}/stat').read().split()[2] not in 'XZ']
for _ in range(1000):  # one that was killed may take a moment to go
    if len(running()) == 2: break
assert len(running()) == 2, running()
"""
    assert not grade(student(before=[leave, look]))[0].notes


def test_packages_beside_the_interpreter_are_not_in_the_box(grade, student):
    look = """
import importlib.util, os, sys
beside = os.path.join(os.path.dirname(os.__file__), 'site-packages')
assert not [name for name in ('pip', 'setuptools') if os.path.exists(os.path.join(beside, name))]
assert not [name for name in ('pip', 'nbgrader', 'filterpy', 'IPython') if importlib.util.find_spec(name)]
"""
    assert not grade(student(before=[look]))[0].notes
