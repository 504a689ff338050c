"""The page on clusters: its script runs, and the cluster that it describes lets nobody in without a certificate."""

import os
import re
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from ccm_opt.core.errors import ProblemError
from ccm_opt.core.executors import DaskWorkers, completed
from tests.comparison_tasks import double
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


@pytest.mark.drawn(1, of="cluster")
@pytest.mark.filterwarnings("ignore")
@pytest.mark.skipif(shutil.which("openssl") is None, reason="makes its certificates with openssl")
def test_with_certificates_the_cluster_works_and_without_nobody_is_let_in(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The options and variables that the page names make a cluster that asks for certificates."""
    pytest.importorskip("distributed")
    import dask

    own_authority(tmp_path)
    tls = ["--tls-ca-file", "ca.pem", "--tls-cert", "one.pem", "--tls-key", "one-key.pem"]
    scheduler = dask_process(tmp_path, "scheduler", "--protocol", "tls", "--host", "127.0.0.1", "--port", "0", *tls)
    worker = None
    try:
        address = address_in(tmp_path / "scheduler.json")
        assert address.startswith("tls://")
        worker = dask_process(tmp_path, "worker", "--nthreads", "1", "--no-nanny", *tls)
        with pytest.raises(ProblemError, match="no Dask scheduler answers"):
            list(completed(DaskWorkers(address, timeout=3.0), double, [1]))
        monkeypatch.setenv("DASK_DISTRIBUTED__COMM__TLS__CA_FILE", str(tmp_path / "ca.pem"))
        monkeypatch.setenv("DASK_DISTRIBUTED__COMM__TLS__CLIENT__CERT", str(tmp_path / "one.pem"))
        monkeypatch.setenv("DASK_DISTRIBUTED__COMM__TLS__CLIENT__KEY", str(tmp_path / "one-key.pem"))
        monkeypatch.setenv("DASK_DISTRIBUTED__COMM__REQUIRE_ENCRYPTION", "true")
        # Dask reads the variables when it is loaded.
        with dask.config.set(dict(named(dask.config.collect_env()))):
            found = dict(completed(DaskWorkers(address, timeout=60.0), double, [1, 2]))
        assert found == {1: 2, 2: 4}
    finally:
        for process in (scheduler, worker):
            if process is not None:
                process.kill()
                process.wait()


def named(settings: dict[str, object], before: str = "") -> Iterator[tuple[str, object]]:
    """Settings of Dask by their full names."""
    for key, value in settings.items():
        name = f"{before}.{key}" if before else key
        if isinstance(value, dict):
            yield from named(value, name)
        else:
            yield name, value


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
