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
    *HALL, "runs", "safety", "world", "data", "policy", "cosim", "evaluation", "learning",
    "report", "wire", "bags", "generate", "view", "envs", "nodes", "exam", "cli", "extras",
)  # fmt: skip
"""From the ground up, as `vpsci_ros/` lies in DESIGN."""
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
    code = "import os, sys, vpsci_ros; print(*(name for name in sys.modules if name.startswith('vpsci_ros')))"
    environment = {name: value for name, value in os.environ.items() if name != "NUMBA_CACHE_DIR"}
    environment |= {"XDG_CACHE_HOME": str(tmp_path), "HOME": str(tmp_path), "PYTHONDONTWRITEBYTECODE": "1"}
    loaded = subprocess.run([sys.executable, "-c", code], env=environment, capture_output=True, text=True, check=True)
    assert loaded.stdout.split() == ["vpsci_ros"]
    assert list(tmp_path.iterdir()) == []


def test_every_room_has_its_place() -> None:
    files = {path for path in ROOT.rglob("*.py") if path != ROOT / "__init__.py"}
    assert {room(path) for path in files} == set(ROOMS)


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
