"""The page on clusters: its script runs, and the cluster that it describes lets nobody in without a certificate."""

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from tests.test_comparison_executors import address_in, dask_process

ROOT = Path(__file__).parent.parent
PAGE = ROOT / "docs" / "comparison.md"


@pytest.mark.drawn(1, of="cluster")
def test_the_script_of_the_page_runs(tmp_path: Path) -> None:
    """The script, with one problem and one worker, compares planners on its own cluster and says what each solves."""
    pytest.importorskip("distributed")
    blocks = re.findall(r"```python\n(.*?)```", PAGE.read_text(encoding="utf-8"), re.DOTALL)
    (script,) = (block for block in blocks if "LocalCluster" in block)
    few = script.replace('"open-space", 4', '"open-space", 1').replace("n_workers=2", "n_workers=1")
    assert len(few) == len(script)
    assert few != script
    (tmp_path / "on_a_cluster.py").write_text(few, encoding="utf-8")
    done = subprocess.run(
        [sys.executable, "-W", "ignore", "on_a_cluster.py"],
        cwd=tmp_path,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert re.search(r"^nlp: 1 of 1, \d+% to 100%$", done.stdout, re.MULTILINE)
    assert re.search(r"^hill-climbing: \d of 1, ", done.stdout, re.MULTILINE)
    assert len((tmp_path / "runs" / "on-a-cluster" / "journal.jsonl").read_text().splitlines()) == 2


DOUBLES = """
import sys
from ccm_opt.core.executors import DaskWorkers, completed
from tests.comparison_tasks import double
print(sorted(completed(DaskWorkers(sys.argv[1], timeout=60.0), double, [1, 2])))
"""
"""A client of a cluster, which is a process of its own: Dask reads the variables of its certificates when loaded."""


@pytest.mark.drawn(1, of="cluster")
@pytest.mark.skipif(shutil.which("openssl") is None, reason="makes its certificates with openssl")
def test_with_certificates_the_cluster_works_and_without_nobody_is_let_in(tmp_path: Path) -> None:
    """The options and variables that the page names make a cluster that asks for certificates."""
    pytest.importorskip("distributed")
    own_authority(tmp_path)
    tls = ["--tls-ca-file", "ca.pem", "--tls-cert", "one.pem", "--tls-key", "one-key.pem"]
    scheduler = dask_process(tmp_path, "scheduler", "--protocol", "tls", "--host", "127.0.0.1", "--port", "0", *tls)
    worker = None
    try:
        address = address_in(tmp_path / "scheduler.json")
        assert address.startswith("tls://")
        worker = dask_process(tmp_path, "worker", "--nthreads", "1", "--no-nanny", *tls)
        assert "ProblemError: no Dask scheduler answers" in client(tmp_path, address).stderr
        held = {
            "DASK_DISTRIBUTED__COMM__TLS__CA_FILE": "ca.pem",
            "DASK_DISTRIBUTED__COMM__TLS__CLIENT__CERT": "one.pem",
            "DASK_DISTRIBUTED__COMM__TLS__CLIENT__KEY": "one-key.pem",
            "DASK_DISTRIBUTED__COMM__REQUIRE_ENCRYPTION": "true",
        }
        done = client(tmp_path, address, **held)
        assert done.stdout == "[(1, 2), (2, 4)]\n", done.stderr
    finally:
        for process in (scheduler, worker):
            if process is not None:
                process.kill()
                process.wait()


def client(folder: Path, address: str, **variables: str) -> "subprocess.CompletedProcess[str]":
    """A client that doubles two numbers on a cluster."""
    return subprocess.run(
        [sys.executable, "-W", "ignore", "-c", DOUBLES, address],
        cwd=folder,
        env={**os.environ, "PYTHONPATH": str(ROOT), **variables},
        capture_output=True,
        text=True,
        check=False,
    )


def own_authority(folder: Path) -> None:
    """An authority's certificate, and one that it signed, as PEM files."""
    new_key = ["-newkey", "rsa:2048", "-nodes", "-days", "2"]
    openssl(folder, "req", "-x509", *new_key, "-subj", "/CN=authority", "-keyout", "ca-key.pem", "-out", "ca.pem")
    openssl(folder, "req", *new_key[:3], "-subj", "/CN=one", "-keyout", "one-key.pem", "-out", "one.csr")
    signing = ["-CA", "ca.pem", "-CAkey", "ca-key.pem", "-CAcreateserial", "-days", "2"]
    openssl(folder, "x509", "-req", "-in", "one.csr", *signing, "-out", "one.pem")


def openssl(folder: Path, *options: str) -> None:
    """One command of openssl."""
    command = shutil.which("openssl")
    assert command is not None
    subprocess.run([command, *options], cwd=folder, check=True, capture_output=True)
