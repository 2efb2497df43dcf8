"""Files for GitHub, the citation and the package index, by the schemas and checks of those who read them."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

pytest.importorskip("check_jsonschema", reason="check-jsonschema is not installed: `make interop` installs it")

ROOT = Path(__file__).parents[2]
FILES = {
    "CITATION.cff": "citation-file-format",
    ".github/dependabot.yml": "dependabot",
    ".github/ISSUE_TEMPLATE/config.yml": "github-issue-config",
    ".github/ISSUE_TEMPLATE/fault.yml": "github-issue-forms",
    ".github/ISSUE_TEMPLATE/wish.yml": "github-issue-forms",
    ".github/workflows/ci.yml": "github-workflows",
    ".github/workflows/ros.yml": "github-workflows",
    ".github/workflows/wheels.yml": "github-workflows",
}


def module(*arguments: str | Path, folder: Path = ROOT) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", *map(str, arguments)]
    return subprocess.run(command, cwd=folder, capture_output=True, text=True)


@pytest.mark.parametrize(("file", "schema"), FILES.items())
def test_the_schema_of_a_file(file, schema, tmp_path):
    done = module("check_jsonschema", "--builtin-schema", f"vendor.{schema}", file)
    assert done.returncode == 0, done.stdout
    wrong = tmp_path / Path(file).name
    wrong.write_text((ROOT / file).read_text(encoding="utf-8") + "\nno_such_key: 1\n", encoding="utf-8")
    assert module("check_jsonschema", "--builtin-schema", f"vendor.{schema}", wrong).returncode == 1


def test_every_file_of_github_is_looked_at():
    there = {file.relative_to(ROOT).as_posix() for file in (ROOT / ".github").rglob("*.yml")}
    assert there | {"CITATION.cff"} == set(FILES)


def test_the_package_index_takes_the_archive(tmp_path):
    """``twine check --strict``: a long description that renders, and metadata without a warning."""
    built = module("build", "--sdist", "--no-isolation", "--outdir", tmp_path)
    assert built.returncode == 0, built.stdout + built.stderr
    [archive] = tmp_path.glob("*.tar.gz")
    done = module("twine", "check", "--strict", archive)
    assert done.returncode == 0 and "PASSED" in done.stdout, done.stdout


def test_cibuildwheel_takes_its_configuration():
    for machine in ("x86_64", "aarch64"):
        done = module("cibuildwheel", "--platform", "linux", "--archs", machine, "--print-build-identifiers", ROOT)
        assert done.returncode == 0, done.stderr
        named = set(done.stdout.split())
        assert {f"cp3{minor}-manylinux_{machine}" for minor in range(10, 15)} <= named
        assert all(name.startswith(tuple(f"cp3{minor}-" for minor in range(10, 15))) for name in named)
