"""What the page on security says is so: no module can run what a file says; reading a log starts, sends and writes nothing."""

import ast
import json
import re
import subprocess
import sys
from pathlib import Path

import vsalog

TOP = Path(vsalog.__file__).parent
ROOT = TOP.parent
MODULES = sorted(TOP.rglob("*.py"))

# Modules that unpickle, run programs or code, or parse more than is asked for.
NEVER = {
    "pickle", "_pickle", "cloudpickle", "dill", "shelve", "marshal", "joblib", "subprocess", "pty", "commands", "runpy",
    "code", "codeop", "ctypes", "cffi", "yaml", "xml", "lxml", "socketserver", "http", "xmlrpc", "ftplib", "telnetlib", "smtplib",
    "requests", "urllib3", "importlib.util", "importlib.machinery", "imp", "zipimport",
}  # fmt: skip
BUILT_IN = {"eval", "exec", "compile", "__import__", "breakpoint", "input"}
OF_OS = re.compile(r"^(system|popen|exec[lv]|spawn|posix_spawn|fork|startfile)")
COPIES = ("readers/sandbox.py", "fork")
"""Where a copy of the process reads what may end it."""
WRITES_XML = "export/elements.py"
"""What makes XML of a rig; it has no parser."""
MAKING_XML = {"Element", "SubElement", "Comment", "indent", "tostring"}
READ_PICKLES = {"read_pickle", "extractall", "unsafe_load", "full_load"}
# Imports by a name that is no constant, and what the name comes from: tables and folders of vsalog's own, and installed packages.
IMPORTS = {
    "__init__.py": 1, "reproduce/catalogue.py": 1, "diagnosis/causes/__init__.py": 1, "estimators/registry.py": 1,
    "effects/__init__.py": 1, "checks/__init__.py": 1,
}  # fmt: skip


def calls(tree):
    for node in ast.walk(tree):
        if isinstance(node, ast.Call):
            yield node


def imported(tree):
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and not node.level:
            yield node.module or ""


def used_of(tree, name):
    return {n.attr for n in ast.walk(tree) if isinstance(n, ast.Attribute) and getattr(n.value, "id", "") == name}


def test_no_module_can_run_what_a_file_says():
    assert len(MODULES) > 200
    dynamic = {}
    for path in MODULES:
        tree, name = ast.parse(path.read_text(encoding="utf-8")), path.relative_to(TOP).as_posix()
        for module in imported(tree):
            if (name, module) == (WRITES_XML, "xml.etree"):
                assert used_of(tree, "ET") <= MAKING_XML
                continue
            parts = module.split(".")
            assert not {".".join(parts[: i + 1]) for i in range(len(parts))} & NEVER, (name, module)
        for call in calls(tree):
            called = call.func
            own = called.id if isinstance(called, ast.Name) else getattr(called, "attr", "")
            if isinstance(called, ast.Name):
                assert own not in BUILT_IN, (name, call.lineno, own)
            elif isinstance(called, ast.Attribute) and isinstance(called.value, ast.Name) and called.value.id == "os":
                assert not OF_OS.match(own) or (name, own) == COPIES, (name, call.lineno, own)
            assert own not in READ_PICKLES, (name, call.lineno, own)
            words = {word.arg: word.value for word in call.keywords}
            for flag in ("shell", "allow_pickle"):
                assert flag not in words or words[flag].value is False, (name, call.lineno)
            if (
                own == "load"
                and isinstance(called, ast.Attribute)
                and getattr(called.value, "id", "") in ("np", "numpy")
            ):
                assert "allow_pickle" in words, (name, call.lineno)
            if own == "import_module" and not isinstance(call.args[0], ast.Constant):
                dynamic[name] = dynamic.get(name, 0) + 1
    assert dynamic == IMPORTS


def test_libraries_that_files_may_end_read_in_the_sandbox():
    """scipy's reader of MATLAB files, which is compiled and believes what it reads, and HDF5's library."""
    read = [p for p in MODULES if re.search("loadmat|h5py.File", p.read_text(encoding="utf-8"))]
    assert [p.relative_to(TOP).as_posix() for p in read] == [
        "readers/matlab_v73.py",
        "readers/matlab_variables.py",
        "simulation/samples.py",  # our own sample
    ]
    assert all("sandboxed(" in p.read_text(encoding="utf-8") for p in read[:2])


PLAY = """
import importlib, json, os, sys, tempfile, warnings
sys.path[:0] = [sys.argv[1] + "/fuzz", sys.argv[1] + "/readers"]
names = ("mcap", "messages", "rosbag1", "sqlite", "table", "parquet", "matlab")
targets = [importlib.import_module("fuzz_" + name) for name in names]
inputs = [(target, bytes([0x08]) + seed[1:]) for target in targets for seed in list(target.seeds())[::2]]
for target, data in inputs[::3]:
    target.one(data)  # what is only imported and compiled when it is used
allowed = os.path.realpath(tempfile.gettempdir()), "/dev/shm"
found, watching = [], [False]
SENT = ("socket.connect", "socket.bind", "socket.getaddrinfo", "urllib.Request", "ftplib.connect", "smtplib.connect")
RUN = ("subprocess.Popen", "os.system", "os.exec", "os.posix_spawn", "os.fork", "os.forkpty", "pty.spawn", "pickle.find_class",
       "marshal.loads", "code.__new__", "ctypes.dlopen", "sqlite3.enable_load_extension", "sqlite3.load_extension")
AT = ("os.remove", "os.rmdir")  # whose last argument is the folder that a name is relative to
CHANGED = ("os.remove", "os.rename", "os.rmdir", "os.mkdir", "os.chmod", "os.link", "os.symlink", "os.truncate", "shutil.move")

def hook(event, args):
    if not watching[0]:
        return
    if event == "open" and isinstance(args[0], (str, bytes)):
        writes = args[2] & (os.O_WRONLY | os.O_RDWR | os.O_CREAT | os.O_TRUNC) if isinstance(args[2], int) else 0
        path = os.path.realpath(os.fsdecode(args[0]))
        if writes and not path.startswith(allowed) and "__pycache__" not in path:
            found.append([event, path])
    elif event in CHANGED and isinstance(args[0], (str, bytes)):
        beside = f"/proc/self/fd/{args[-1]}" if isinstance(args[-1], int) and args[-1] >= 0 and event in AT else ""
        path = os.path.realpath(os.path.join(beside, os.fsdecode(args[0])))
        if not path.startswith(allowed) and "__pycache__" not in path:
            found.append([event, path])
    elif event in SENT + RUN:
        depth = sys._getframe(1)
        while depth is not None and "/numba/" not in depth.f_code.co_filename and "importlib" not in depth.f_code.co_filename:
            depth = depth.f_back
        copies = event == "os.fork" and sys._getframe(1).f_code.co_filename.endswith("readers/sandbox.py")
        if depth is None and not copies:  # neither numba's cache nor an import of ours
            found.append([event, str(args)[:200]])

sys.addaudithook(hook)
for target, data in inputs:
    watching[0] = True
    target.one(data)
    watching[0] = False
print(json.dumps([len(inputs), found]))
"""


def test_reading_starts_sends_and_writes_nothing():
    """Watched by the interpreter's own audit events, over logs of every format."""
    command = [sys.executable, "-W", "ignore", "-c", PLAY, str(Path(__file__).parent)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=200)
    assert done.returncode == 0, done.stderr
    count, found = json.loads(done.stdout)
    assert count > 50
    assert found == []


def test_the_note_names_tests_that_are_there():
    text = (ROOT / "docs" / "explanation" / "security.md").read_text(encoding="utf-8")
    folder = ROOT
    named = re.findall(r"`((?:tests/)?[\w/]*test_\w+\.py)`", text)
    assert len(named) > 10
    for name in named:
        if "/" in name:
            folder = (ROOT / name).parent
        assert (folder / Path(name).name).is_file(), name
