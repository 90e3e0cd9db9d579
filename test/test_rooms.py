"""Rooms lie one upon the other, and whoever needs another room looks down: imports within functions, too."""

import ast
import os
import subprocess
import sys
from pathlib import Path

import vpsci_ros

ROOT = Path(vpsci_ros.__file__).parent
HALL = ("errors", "documents", "parameters", "resources")
ROOMS = (
    *HALL, "runs", "safety", "world", "lockstep", "data", "policy", "cosim", "evaluation", "learning",
    "report", "wire", "bags", "generate", "view", "envs", "nodes", "exam", "cli", "extras",
)  # fmt: skip
"""From the ground up."""
BUDGETS = {
    "errors": 150, "documents": 300, "parameters": 300, "resources": 150, "runs": 1600, "safety": 1650,
    "world": 5150, "lockstep": 700, "data": 4650, "policy": 3050, "cosim": 900, "evaluation": 1600, "learning": 2900,
    "report": 600, "wire": 950, "bags": 2050, "generate": 1400, "view": 400, "envs": 750, "nodes": 3600,
    "exam": 4100, "cli": 2050, "extras": 11400,
}  # fmt: skip
"""Lines of each room, at most. A commit that raises one says why, and what went instead."""
COMPILED_ROOMS = ("safety", "world", "data", "cosim", "envs")
OF_ROS = {"rclpy", "vpsci_msgs", "rcl_interfaces", "builtin_interfaces", "launch", "launch_ros", "std_srvs"}


def room(path: Path) -> str:
    return path.relative_to(ROOT).parts[0].removesuffix(".py")


def imported(tree: ast.AST) -> list[tuple[int, str]]:
    """Return line and module of every import, wherever it stands; `from vpsci_ros import x` counts as vpsci_ros.x."""
    found = []
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            found += [(node.lineno, alias.name) for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            module = "vpsci_ros" if node.level else node.module or ""
            names = [f"{module}.{alias.name}" for alias in node.names] if module == "vpsci_ros" else [module]
            found += [(node.lineno, name) for name in names]
    return found


def upward(path: Path, tree: ast.AST) -> list[str]:
    """Return where a file looks up, one sentence each; it may look at its own room and at those below."""
    arrows, mine = [], ROOMS.index(room(path))
    for line, module in imported(tree):
        first, _, rest = module.partition(".")
        theirs = rest.partition(".")[0]
        if first == "vpsci_ros" and theirs in ROOMS and ROOMS.index(theirs) > mine:
            arrows.append(f"{path.relative_to(ROOT)}:{line} imports {module}, but {theirs} lies above {ROOMS[mine]}")
        if (
            (first in OF_ROS or first.endswith(("_msgs", "_interfaces")))
            and room(path) != "nodes"
            and path.name != "node.py"
        ):
            arrows.append(f"{path.relative_to(ROOT)}:{line} imports {module}, but only nodes knows ROS")
    return arrows


def at_import(tree: ast.Module) -> list[ast.stmt]:
    """Return the statements that run when a module is imported: not those for type checkers, nor those in functions."""
    for_types = [node for node in tree.body if isinstance(node, ast.If) and ast.unparse(node.test) == "TYPE_CHECKING"]
    return [node for node in tree.body if node not in for_types and not isinstance(node, ast.FunctionDef)]


def test_the_package_imports_none_of_its_rooms_and_touches_no_file(tmp_path: Path) -> None:
    tree = ast.parse((ROOT / "__init__.py").read_text(encoding="utf-8"))
    assert {module for node in at_import(tree) for _, module in imported(node)} == {"importlib", "typing"}
    code = "import os, sys, vpsci_ros; assert {*vpsci_ros.__all__} <= {*dir(vpsci_ros)}; "
    code += "print(*(name for name in sys.modules if name.startswith('vpsci_ros')))"
    environment = {name: value for name, value in os.environ.items() if name != "NUMBA_CACHE_DIR"}
    environment |= {"XDG_CACHE_HOME": str(tmp_path), "HOME": str(tmp_path), "PYTHONDONTWRITEBYTECODE": "1"}
    loaded = subprocess.run([sys.executable, "-c", code], env=environment, capture_output=True, text=True, check=True)
    assert loaded.stdout.split() == ["vpsci_ros"]
    assert list(tmp_path.iterdir()) == []


def test_what_runs_an_exam_knows_neither_its_report_nor_pages_environments_and_nodes() -> None:
    runner = [ROOT / "exam" / f"{name}.py" for name in ("exam", "run", "drivers", "process")]
    trees = {path.name: ast.parse(path.read_text(encoding="utf-8")) for path in runner}
    above = ("vpsci_ros.exam.report", "vpsci_ros.view", "vpsci_ros.envs", "vpsci_ros.nodes")
    arrows = [(name, module) for name, tree in trees.items()
              for node in at_import(tree) for _, module in imported(node) if module.startswith(above)]  # fmt: skip
    assert arrows == [
        ("run.py", "vpsci_ros.nodes.failures"),
        ("run.py", "vpsci_ros.nodes.status"),
        ("drivers.py", "vpsci_ros.envs.task"),
    ], "the last one of the driver's own observation, on its demand"


WATCH = """
import os, sys
ROOT, done = sys.argv[1], []
def watch(event, args):
    if event == "open":
        path, mode, flags = (*args, None)[:3]
        written = flags and flags & (os.O_WRONLY | os.O_RDWR | os.O_CREAT)
        data = str(path).startswith(ROOT) and not str(path).endswith((".py", ".pyc"))
        if written or data:
            done.append(f"{event} {path}")
    elif event in ("os.mkdir", "os.rename", "os.remove", "os.rmdir", "os.chmod", "os.link", "os.symlink"):
        done.append(f"{event} {args[0]}")
sys.addaudithook(watch)
for module in sys.argv[2:]:
    __import__(module)
print(*done, sep="\\n")
"""


def test_importing_the_compiled_rooms_reads_no_data_and_writes_nothing(tmp_path: Path) -> None:
    """Their kernels have a cache on disk, and scenes are drawn from recorded onsets; both wait for their first use."""
    files = sorted(path for name in COMPILED_ROOMS for path in (ROOT / name).rglob("*.py"))
    modules = [".".join(("vpsci_ros", *path.relative_to(ROOT).with_suffix("").parts)) for path in files]
    environment = {name: value for name, value in os.environ.items() if name != "NUMBA_CACHE_DIR"}
    environment |= {"XDG_CACHE_HOME": str(tmp_path), "HOME": str(tmp_path), "PYTHONDONTWRITEBYTECODE": "1"}
    command = [sys.executable, "-c", WATCH, str(ROOT), *modules]
    seen = subprocess.run(command, env=environment, capture_output=True, text=True, check=True)
    assert seen.stdout.split() == []
    assert list(tmp_path.iterdir()) == []


def test_every_room_has_its_place() -> None:
    files = {path for path in ROOT.rglob("*.py") if path != ROOT / "__init__.py"}
    assert {room(path) for path in files} == set(ROOMS)


def test_the_docstring_of_each_room_names_each_of_its_files() -> None:
    inits = [path for path in sorted(ROOT.rglob("__init__.py")) if path != ROOT / "__init__.py"]
    texts = {init.parent: ast.get_docstring(ast.parse(init.read_text(encoding="utf-8"))) or "" for init in inits}
    files = [path for folder in texts for path in sorted(folder.glob("*.py")) if not path.name.startswith("__")]
    unnamed = [str(path.relative_to(ROOT)) for path in files if f"`{path.stem}`" not in texts[path.parent]]
    assert not unnamed, "\n".join(unnamed)


def test_no_two_rooms_share_the_name_of_a_file_that_says_nothing() -> None:
    for stem in ("run", "config", "page", "utils", "helpers", "main"):
        assert len(list(ROOT.rglob(f"{stem}.py"))) <= 1, stem


def test_no_file_looks_up() -> None:
    files = sorted(path for path in ROOT.rglob("*.py") if path != ROOT / "__init__.py")
    arrows = [text for path in files for text in upward(path, ast.parse(path.read_text(encoding="utf-8")))]
    assert not arrows, "\n".join(arrows)


def test_no_branch_imports_another_one() -> None:
    arrows = []
    for path in sorted((ROOT / "extras").rglob("*/*.py")):
        mine = path.relative_to(ROOT).parts[1]
        for line, module in imported(ast.parse(path.read_text(encoding="utf-8"))):
            theirs = module.removeprefix("vpsci_ros.extras.").partition(".")[0]
            if module.startswith("vpsci_ros.extras.") and theirs != mine:
                arrows.append(f"{path.relative_to(ROOT)}:{line} imports {module}")
    assert not arrows, "\n".join(arrows)


def test_no_room_has_more_lines_than_its_budget() -> None:
    lines = dict.fromkeys(ROOMS, 0)
    for path in ROOT.rglob("*.py"):
        if path != ROOT / "__init__.py":
            lines[room(path)] += len(path.read_text(encoding="utf-8").splitlines())
    assert BUDGETS.keys() == lines.keys()
    assert {name: count for name, count in lines.items() if count > BUDGETS[name]} == {}
    assert [name for name, count in lines.items() if BUDGETS[name] - count >= 100] == [], "lower these"
