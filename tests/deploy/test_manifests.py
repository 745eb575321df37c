"""The files of docs/deploy/: Kubernetes' own schemas, and what must agree with wdpm and among themselves."""

from __future__ import annotations

import re
import shlex
import shutil
import subprocess
from pathlib import Path
from typing import Any

import pytest

from wdpm.cli.main import make_parser
from wdpm.exit_codes import EXIT_BAD_INPUT

FOLDER = Path(__file__).parents[2] / "docs" / "deploy"
MANIFESTS = FOLDER / "kubernetes.yaml"

Manifest = dict[str, Any]


@pytest.fixture(scope="module")
def manifests() -> dict[str, Manifest]:
    """By kind."""
    yaml = pytest.importorskip("yaml", reason="PyYAML comes with wdpm's extra test")
    return {each["kind"]: each for each in yaml.safe_load_all(MANIFESTS.read_text())}


def pod(manifest: Manifest) -> Manifest:
    return manifest["spec"]["template"]["spec"]


def container(manifest: Manifest) -> Manifest:
    [only] = pod(manifest)["containers"]
    return only


def test_kubernetes_own_schemas_hold(manifests: dict[str, Manifest]) -> None:
    validate = pytest.importorskip("kubernetes_validate", reason="kubernetes-validate comes with wdpm's extra test")
    assert list(manifests) == ["Service", "Job", "Deployment"]
    for manifest in manifests.values():
        validate.validate(manifest, validate.latest_version(), strict=True)
    with pytest.raises(validate.ValidationError):
        validate.validate({**manifests["Job"], "specs": {}}, validate.latest_version(), strict=True)


@pytest.mark.parametrize("kind", ["Job", "Deployment"])
def test_containers_run_commands_that_there_are(kind: str, manifests: dict[str, Manifest]) -> None:
    make_parser().parse_args(container(manifests[kind])["args"])


def test_slaves_find_the_master(manifests: dict[str, Manifest]) -> None:
    service, job, deployment = manifests["Service"], manifests["Job"], manifests["Deployment"]
    [port] = service["spec"]["ports"]
    ports = {each["name"]: each["containerPort"] for each in container(job)["ports"]}
    assert f"tcp://{service['metadata']['name']}:{port['port']}" in container(deployment)["args"]
    assert f"--bind=tcp://0.0.0.0:{ports[port['targetPort']]}" in container(job)["args"]
    assert f"--metrics=0.0.0.0:{ports['metrics']}" in container(job)["args"]
    assert service["spec"]["selector"] == job["spec"]["template"]["metadata"]["labels"]
    labels = deployment["spec"]["template"]["metadata"]["labels"]
    assert deployment["spec"]["selector"]["matchLabels"] == labels != service["spec"]["selector"]


@pytest.mark.parametrize("kind", ["Job", "Deployment"])
def test_containers_may_do_nothing_that_they_need_not(kind: str, manifests: dict[str, Manifest]) -> None:
    user = re.search(r"^USER (\d+):(\d+)$", (FOLDER / "Dockerfile").read_text(), re.MULTILINE)
    assert user is not None
    of_pod, of_container = pod(manifests[kind])["securityContext"], container(manifests[kind])["securityContext"]
    assert (of_pod["runAsNonRoot"], of_pod["runAsUser"], of_pod["runAsGroup"]) == (True, int(user[1]), int(user[2]))
    assert of_container == {
        "allowPrivilegeEscalation": False,
        "readOnlyRootFilesystem": True,
        "capabilities": {"drop": ["ALL"]},
    }
    mounted = {each["name"]: each for each in container(manifests[kind])["volumeMounts"]}
    assert set(mounted) == {each["name"] for each in pod(manifests[kind])["volumes"]}
    assert mounted["keys"]["readOnly"]
    assert f"--keys={mounted['keys']['mountPath']}" in container(manifests[kind])["args"]
    assert f"WARP_CACHE_PATH={mounted['cache']['mountPath']} " in (FOLDER / "Dockerfile").read_text()


def test_bad_input_is_not_tried_again(manifests: dict[str, Manifest]) -> None:
    rules = manifests["Job"]["spec"]["podFailurePolicy"]["rules"]
    assert rules[0]["onExitCodes"]["values"] == [EXIT_BAD_INPUT]
    assert f"RestartPreventExitStatus={EXIT_BAD_INPUT}\n" in (FOLDER / "wdpm-slave.service").read_text()


def test_the_service_runs_a_command_that_there_is() -> None:
    command = re.search(r"^ExecStart=(.*)$", (FOLDER / "wdpm-slave.service").read_text(), re.MULTILINE)
    assert command is not None
    program, *words = shlex.split(command[1])
    assert Path(program).name == "wdpm"
    make_parser().parse_args(words)


@pytest.mark.skipif(shutil.which("systemd-analyze") is None, reason="systemd-analyze is not there")
def test_systemd_understands_the_service(tmp_path: Path) -> None:
    text = (FOLDER / "wdpm-slave.service").read_text().replace("/opt/wdpm/bin/wdpm", "/bin/true")
    unit = tmp_path / "wdpm-slave.service"
    unit.write_text(text.replace("User=wdpm\n", "User=root\n"))
    told = subprocess.run(["systemd-analyze", "verify", unit], capture_output=True, text=True, check=False)
    assert (told.returncode, told.stdout + told.stderr) == (0, "")


def test_the_image_is_built_of_all_that_is_installed() -> None:
    kept = {line[1:] for line in (FOLDER / "Dockerfile.dockerignore").read_text().splitlines() if line.startswith("!")}
    assert all((FOLDER.parents[1] / name).exists() for name in kept)
    assert {"wdpm", "cluster", "kernels", "scenes", "pyproject.toml", "README.md", "LICENSE"} == kept
