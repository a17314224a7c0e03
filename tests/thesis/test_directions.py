"""Claims of section 3.2.2 on unknown directions of motion."""

from __future__ import annotations

import numpy as np
import pytest

from thesis._directions import CONDITIONS
from thesis._experiments import directions


@pytest.mark.parametrize("condition", CONDITIONS)
def test_wrong_directions_lie_after_the_sensor(condition: str) -> None:
    found = directions.sensor_votes(directions.CABLE, condition, 400)
    before, after = directions.side_means(np.mean(found.wrong, axis=0))
    assert after > 0.01
    assert before < 0.4 * after
    error = found.own.tension - found.moment.tension
    inner, outer = directions.side_means(np.mean(error**2, axis=0))
    assert outer > 1.4 * inner


def test_sides_take_the_segment_behind_the_sensor_for_after() -> None:
    wrong = np.zeros((4, 3))
    wrong[1, 1] = 1.0
    before, after = directions.side_means(wrong)
    assert before == 0.0 and after > 0.0
    wrong = np.zeros((4, 3))
    wrong[1, 0] = 1.0
    before, after = directions.side_means(wrong)
    assert before > 0.0 and after == 0.0


def test_leaving_out_sensors_biases_and_one_matrix_does_not() -> None:
    agreeing, shared, consensus = directions.bias(
        directions.CABLE, "towards distal", 1500, 0.5
    )
    assert consensus < 1e-3
    assert agreeing[0] > 6.0 * agreeing[1]
    assert abs(shared[0]) < 4.0 * shared[1]


def test_all_readings_at_once_beat_the_vote_in_time() -> None:
    output, _ = directions.simulate_run(seconds=2.0)
    assert output["at once"] < 0.8 * directions.RUN_NOISE < output["vote"]
    assert output["known"] < output["at once"]
