"""Statements of findings that trials share."""

from cc_mujoco.datasets._data_findings import DataFinding, statements, warning


def shaken(trial: str, off: float = 0.2) -> DataFinding:
    return warning(f"data/{trial}.csv, column time_s is off by {off} ms.", trial)


def test_equal_findings_of_several_trials_are_one_statement() -> None:
    given = [shaken("trial_0"), warning("All is well."), shaken("trial_1")]
    assert statements([*given, shaken("trial_2", 0.4)]) == (
        "data/trial_0.csv and 1 more, column time_s is off by 0.2 ms.",
        "All is well.",
        "data/trial_2.csv, column time_s is off by 0.4 ms.",
    )


def test_no_finding_is_lost_that_names_a_trial_without_its_file() -> None:
    given = [warning(f"{name} is short.", name) for name in ("a1", "b1")]
    assert statements(given) == ("a1 is short.", "b1 is short.")
