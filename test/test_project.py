"""What a project has beside its code: the page on the package index, the citation, the command as a module."""

from __future__ import annotations

import ast
import json
import re
import subprocess
import sys
from pathlib import Path

import pytest
import yaml
from test_package import PACKAGE_XML, SETUP

ROOT = Path(__file__).parents[1]


def test_the_module_is_the_command():
    run = [[sys.executable, "-m", name, "--help"] for name in ("tire_dynamics", "tire_dynamics.cli.main")]
    first, second = (subprocess.run(command, capture_output=True, text=True) for command in run)
    assert first.returncode == second.returncode == 0
    assert first.stdout == second.stdout and "replay" in first.stdout
    refused = subprocess.run([sys.executable, "-m", "tire_dynamics", "nothing"], capture_output=True, text=True)
    assert refused.returncode == 2 and "Traceback" not in refused.stderr


def test_the_page_on_the_index_is_the_readme_with_links_that_lead_there():
    page, readme = SETUP["long_description"], (ROOT / "README.md").read_text(encoding="utf-8")
    assert SETUP["long_description_content_type"] == "text/markdown"
    [repository] = [url.text for url in PACKAGE_XML.findall("url") if url.get("type") == "repository"]
    links, own = (re.findall(r"\]\(([^)\s]+)", text) for text in (page, readme))
    assert len(links) == len(own) > 20
    for link, before in zip(links, own, strict=True):
        if before.startswith(("https:", "http:", "#")):
            assert link == before
        else:
            kind = "raw" if before.endswith(".png") else "blob"
            assert link == f"{repository}/{kind}/main/{before}"
            assert (ROOT / before.partition("#")[0]).exists()
    assert re.sub(r"\]\([^)\s]+", "](", page) == re.sub(r"\]\([^)\s]+", "](", readme)


def test_addresses_stand_once():
    urls = {url.get("type"): url.text for url in PACKAGE_XML.findall("url")}
    assert SETUP["url"] == urls["website"]
    assert SETUP["project_urls"]["Source"] == urls["repository"]
    assert SETUP["project_urls"]["Issues"] == urls["bugtracker"]
    citation = yaml.safe_load((ROOT / "CITATION.cff").read_text(encoding="utf-8"))
    assert (citation["url"], citation["repository-code"]) == (urls["website"], urls["repository"])
    assert citation["version"] == PACKAGE_XML.findtext("version") and citation["license"] == "Apache-2.0"
    assert citation["authors"][0]["email"] == PACKAGE_XML.find("maintainer").get("email")


def test_the_paper_is_cited_as_the_model_has_it():
    [paper] = yaml.safe_load((ROOT / "CITATION.cff").read_text(encoding="utf-8"))["references"]
    model = (ROOT / "docs" / "model.md").read_text(encoding="utf-8")
    told = " ".join(model.split())
    assert f"*{paper['title']}*" in told
    assert f"{paper['volume']}({paper['issue']}), {paper['year']}, {paper['start']}-{paper['end']}" in told
    for author in paper["authors"]:
        assert f"{author['given-names']} {author['family-names']}" in told


def test_the_classifiers_are_those_of_what_is_built():
    minors = [each.rpartition(".")[2] for each in SETUP["classifiers"] if re.search(r":: 3\.\d+$", each)]
    built = re.search(r'^build = "(.*)"', (ROOT / "pyproject.toml").read_text(encoding="utf-8"), re.MULTILINE)[1]
    assert [f"cp3{minor}-*" for minor in minors] == built.split()
    assert (ROOT / "tire_dynamics" / "py.typed").is_file()  # "Typing :: Typed"


@pytest.mark.parametrize("workflow", sorted((ROOT / ".github" / "workflows").glob("*.yml")), ids=lambda path: path.stem)
def test_a_workflow_names_files_that_are_there(workflow):
    text = workflow.read_text(encoding="utf-8")
    for file in re.findall(r"\btest/test_\w+\.py\b|\.ci/run\b", text):
        assert (ROOT / file).is_file()
    makefile = (ROOT / "Makefile").read_text(encoding="utf-8")
    jobs = yaml.safe_load(text)["jobs"].values()
    assert all("timeout-minutes" in job for job in jobs)
    for step in (step for job in jobs for step in job["steps"]):
        if step.get("run", "").startswith("make "):
            assert re.search(rf"^{step['run'].split()[1]}:", makefile, re.MULTILINE)


def test_the_workflows_run_what_ci_runs():
    texts = {path.stem: path.read_text(encoding="utf-8") for path in (ROOT / ".github" / "workflows").glob("*.yml")}
    assert {"ci", "ros", "wheels"} <= set(texts)
    assert "run: .ci/run" in texts["ci"]
    assert "ros:jazzy" in texts["ros"] and "ros-tooling/action-ros-ci" in texts["ros"]
    assert "pypa/cibuildwheel" in texts["wheels"] and all("-arm" in text for text in texts.values())


def test_the_container_runs_the_demonstration():
    steps = [line.split(" ", 1) for line in (ROOT / "Dockerfile").read_text().splitlines() if re.match("[A-Z]+ ", line)]
    assert steps[0][0] == "FROM" and ast.literal_eval(dict(steps)["CMD"]) == ["make", "run"]
    container = json.loads((ROOT / ".devcontainer" / "devcontainer.json").read_text(encoding="utf-8"))
    assert container["postCreateCommand"] == "make run"
    assert (ROOT / ".devcontainer" / container["build"]["dockerfile"]).resolve() == ROOT / "Dockerfile"


def test_the_hooks_are_targets_of_make():
    hooks = yaml.safe_load((ROOT / ".pre-commit-config.yaml").read_text(encoding="utf-8"))["repos"][0]["hooks"]
    assert [hook["entry"] for hook in hooks] == ["make lint", "make types"]
