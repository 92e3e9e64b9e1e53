import pytest

from runs.pace import Pace


def let_through(rate_hz, stamps_s):
    pace = Pace(rate_hz)
    kept = [stamp_s for stamp_s in stamps_s if pace.due(round(stamp_s * 1e9))]
    assert pace.dropped == len(stamps_s) - len(kept)
    return kept


def test_without_a_rate_every_frame_is_due():
    assert let_through(None, [0.0, 0.001, 0.0]) == [0.0, 0.001, 0.0]


def test_rate_is_kept_on_average_where_frames_do_not_fit_it():
    kept = let_through(4.0, [0.1 * count for count in range(101)])
    assert len(kept) == pytest.approx(41, abs=2)


def test_after_a_hole_the_rate_does_not_catch_up():
    assert let_through(1.0, [0.0, 5.0, 5.3, 5.6, 6.0]) == [0.0, 5.0, 5.6]


def test_frames_out_of_order_are_old():
    assert let_through(1.0, [3.0, 2.9, 1.0, 4.0]) == [3.0, 4.0]
