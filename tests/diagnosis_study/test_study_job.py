"""A study of the diagnosis keeps the same records wherever its cases run."""

from __future__ import annotations

from importlib.util import find_spec
from typing import Any

import pytest
import study_job
from diagnose_benchmark import cases

from cc_mujoco.errors import CableError


@pytest.fixture
def quick(monkeypatch: pytest.MonkeyPatch) -> None:
    """Cases that are not diagnosed, but say what they were asked."""

    def run(case: dict[str, Any], with_bic: bool) -> dict[str, Any]:
        return {**case, "bic": with_bic, "drawn": 0.1 * case["seed"]}

    monkeypatch.setattr(study_job, "run", run)


def by_seed(records: Any) -> list[dict[str, Any]]:
    return sorted(records, key=lambda record: record["seed"])


@pytest.mark.usefixtures("quick")
@pytest.mark.skipif(find_spec("distributed") is None, reason="Dask is not here")
@pytest.mark.filterwarnings("ignore")  # of Dask and Tornado, none of ours
def test_records_are_the_same_on_a_cluster() -> None:
    import distributed

    wanted = list(cases("development", 1, [2.0], ["none", "pair"]))
    here = by_seed(study_job.records(wanted, True, jobs=1))
    assert [record["seed"] for record in here] == [case["seed"] for case in wanted]
    with distributed.LocalCluster(
        n_workers=1, processes=False, protocol="tcp://", dashboard_address=None
    ) as cluster:
        address = cluster.scheduler_address
        there = by_seed(study_job.records(wanted, True, scheduler=address))
    assert there == here


def test_what_makes_a_record_includes_the_rigs() -> None:
    files = study_job.Study().made_by()["files"]
    assert {"rig/engine.py", "diagnose_benchmark.py", "study_job.py"} <= files.keys()


@pytest.mark.usefixtures("quick")
def test_a_cluster_that_is_not_there_is_one_sentence() -> None:
    with pytest.raises(CableError, match=r"no Dask scheduler answers|needs Dask"):
        list(study_job.records([{"seed": 1}], scheduler="nowhere"))
