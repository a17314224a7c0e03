"""Guarantees of the page: existing tests protect every row."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

FOLDER = Path(__file__).parent
PAGE = (FOLDER.parents[1] / "cc_mujoco/hardware/README.md").read_text("utf-8")
SECTION = PAGE.partition("\n## What is guaranteed\n")[2].partition("\n## ")[0]
SUBJECTS = re.findall(r"^\| ([\w ]+) \|", SECTION, re.M)[1:]
PROTECTED_BY = {
    "limits": {"loop": "whatever_the_controller_returns the_limiter_keeps_its_limits"},
    "late cycles": {"loop": "a_late_host_skips_cycles"},
    "soft start": {
        "loop": "the_share_of_the_controller_grows",
        "links": "the_first_command commands_are_enabled_once",
    },
    "stop": {"loop": "require_stopped", "links": "commands_are_enabled_once"},
    "stop signals": {
        "loop": "a_stop_always_wins",
        "command": "an_interruption_takes the_first_signal_counts the_return_key",
    },
    "stop reasons": {
        "loop": "a_silent_rig late_too_long is_no_number beyond_its_limit "
        "takes_the_torque_away never_gives_torque a_controller_that_raises "
        "gives_no_number a_log_that_cannot_be_written raises_for_good",
        "links": "a_peer_that_is_killed only_corrupt_packets",
        "can": "takes_nothing cannot_be_read is_off now_and_then",
    },
    "motor drives": {
        "drives": "enabled_once_it_was_read a_host_that_is_silent a_fault_of_the_drive"
    },
    "bad packets": {
        "links": "the_newest_reading_counts packets_of_others a_run_goes_on",
        "packet": "any_bit_turned",
        "can": "frames_of_others",
    },
    "frozen sensors": {
        "loop": "frozen_sensors one_frozen_encoder a_motor_at_rest_do_not"
    },
    "torque sensor": {
        "torque_sensor": "a_faulty_torque_sensor one_that_works that_of_a_device"
    },
    "clock": {"loop": "a_step_of_the_rigs_clock clock_that_drifts"},
    "twist": {"loop": "go_apart"},
    "tension": {"loop": "a_cable_that_carries_too_much that_another_joint_winds"},
    "refusals": {
        "settings": "what_is_wrong_is_said cannot_be_given",
        "axes": "wrong_with_axes_is_said left_out_is_missed identifiers_of_their_own",
    },
    "axes": {
        "axes": "amiss_on_one_axis_stops_all takes_nothing_on_one_axis "
        "no_torque_of_each_stops_all before_all_are_heard its_own_torque stops_both"
    },
    "log": {"command": "the_death_of_the_host lacks_less_than_a_block never_replaced"},
    "full disk": {
        "command": "a_full_disk_leaves a_full_disk_is_exit_code_3 "
        "full_before_the_first_row",
        "loop": "a_log_that_cannot_be_written",
    },
    "exit codes": {
        "command": "leaves_its_log a_model_is_refused a_lost_rig the_return_key "
        "the_first_signal_counts"
    },
}
"""Words in the names of tests by the suffix of their file, by subject of a promise."""


def test_every_promise_of_the_page_is_protected() -> None:
    assert sorted(SUBJECTS) == sorted(PROTECTED_BY)


@pytest.mark.parametrize("subject", PROTECTED_BY)
def test_a_promise_names_tests_that_are_there(subject: str) -> None:
    for suffix, names in PROTECTED_BY[subject].items():
        text = (FOLDER / f"test_{suffix}.py").read_text("utf-8")
        for name in names.split():
            assert re.search(rf"^def \w*{name}\w*\(", text, re.M), name
