"""The project keeps its layout: which crate may know which, what lies at the top, one version."""

import re
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

import lasergym

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

ROOT = Path(__file__).resolve().parents[2]

ALLOWED_CRATES: dict[str, set[str]] = {
    "geom": set(),
    "policy": set(),
    "toolpath": {"geom"},
    "batch": {"geom"},
    "ablation": {"geom", "batch"},
    "plan": {"geom", "toolpath", "ablation", "policy"},
    "milling": {"geom", "toolpath", "batch"},
    "galvo": {"geom", "toolpath"},
    "remote": {"geom", "toolpath"},
    "machine": {"geom", "toolpath", "ablation", "plan"},
}
"""The crates that each crate may depend on; the extension module may depend on all."""

TOP_LEVEL = {
    "CHANGELOG.md",
    "CITATION.cff",
    "Cargo.lock",
    "Cargo.toml",
    "LICENSE",
    "Makefile",
    "README.md",
    "crates",
    "docs",
    "pyproject.toml",
    "python",
    "tests",
    "training",
}

MANIFESTS = sorted(ROOT.glob("crates/*/Cargo.toml"))


def read_toml(path: Path) -> dict[str, Any]:
    return tomllib.loads(path.read_text(encoding="utf-8"))


def dependencies(manifest: dict[str, Any], *kinds: str) -> set[str]:
    tables = [manifest, *manifest.get("target", {}).values()]
    return {name for table in tables for kind in kinds for name in table.get(kind, {})}


@pytest.mark.parametrize("path", MANIFESTS, ids=lambda path: path.parent.name)
def test_crates_depend_only_on_those_below(path: Path) -> None:
    crate = path.parent.name
    manifest = read_toml(path)
    assert manifest["package"]["name"] == f"lasergym-{crate}"
    used = dependencies(manifest, "dependencies", "dev-dependencies", "build-dependencies")
    own = {name.removeprefix("lasergym-") for name in used if name.startswith("lasergym-")}
    assert own <= (set(ALLOWED_CRATES) if crate == "py" else ALLOWED_CRATES[crate])


@pytest.mark.parametrize("path", MANIFESTS, ids=lambda path: path.parent.name)
def test_python_appears_in_its_crate_only(path: Path) -> None:
    used = dependencies(read_toml(path), "dependencies", "dev-dependencies", "build-dependencies")
    assert ({"pyo3", "numpy"} <= used) == (path.parent.name == "py")
    assert path.parent.name == "py" or not {"pyo3", "numpy"} & used


@pytest.mark.parametrize("path", MANIFESTS, ids=lambda path: path.parent.name)
def test_crates_take_version_and_lints_from_the_workspace(path: Path) -> None:
    manifest = read_toml(path)
    assert manifest["package"]["version"] == {"workspace": True}
    assert manifest["lints"] == {"workspace": True}


def test_there_is_one_version() -> None:
    workspace = read_toml(ROOT / "Cargo.toml")["workspace"]
    version = workspace["package"]["version"]
    assert lasergym.__version__ == version
    for name, entry in workspace["dependencies"].items():
        if name.startswith("lasergym-"):
            assert entry["version"] == version
    project = read_toml(ROOT / "pyproject.toml")["project"]
    assert project["dynamic"] == ["version"]
    citation = (ROOT / "CITATION.cff").read_text(encoding="utf-8")
    assert re.search(rf'^version: "?{re.escape(version)}"?$', citation, re.MULTILINE)


def test_nothing_else_lies_at_the_top() -> None:
    git = shutil.which("git")
    if git is None or not (ROOT / ".git").exists():
        pytest.skip("needs a git checkout")
    listed = subprocess.run([git, "ls-files"], cwd=ROOT, capture_output=True, check=True, text=True)
    top = {line.split("/")[0] for line in listed.stdout.splitlines()}
    assert {name for name in top if not name.startswith(".")} <= TOP_LEVEL


@pytest.mark.parametrize("target", ["demo", "test", "lint", "bench"])
def test_make_explains_its_targets(target: str) -> None:
    makefile = (ROOT / "Makefile").read_text(encoding="utf-8")
    assert re.search(rf"^{target}:.*## .+", makefile, re.MULTILINE)


def test_the_check_before_a_change_runs_the_tests() -> None:
    script = ROOT / ".ci" / "run"
    assert script.stat().st_mode & 0o111
    assert re.search(r"^make .*\btest\b", script.read_text(encoding="utf-8"), re.MULTILINE)


def readme_commands() -> list[str]:
    """The commands of the README that take no more than seconds."""
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    blocks = re.findall(r"^```(?:sh|console)\n(.*?)^```", text, re.MULTILINE | re.DOTALL)
    lines = "".join(blocks).replace("\\\n", " ").splitlines()
    commands = (line.removeprefix("$ ") for line in lines)
    return [command for command in commands if re.match(r"lasergym (plan|envs|demo)\b", command)]


@pytest.mark.parametrize("command", readme_commands())
def test_a_command_of_the_readme_runs(command: str, tmp_path: Path) -> None:
    (tmp_path / "tests").symlink_to(ROOT / "tests")
    program = f"{sys.executable} -c 'from lasergym.cli import main; raise SystemExit(main())'"
    line = command.replace("lasergym", program, 1)
    subprocess.run(line, cwd=tmp_path, check=True, shell=True)
