"""Each fault does what it says, where it says, the same for the same seed; the copy is a session again."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import yaml

from maps.errors import InputError
from runs.faults.kinds import FAULTS, chosen_fault, corrupted, fault_span
from runs.faults.recording import Span, read_recording
from runs.faults.writing import write_recording
from runs.session import read_session
from vision.images import read_image

S = 10**9


@pytest.fixture(scope="module")
def recording(sample):
    """The sample's first quarter of a minute: enough of everything, and quick."""
    whole = read_recording(sample)
    frames = tuple(frame for frame in whole.session.frames if frame.stamp_ns < 15 * S)
    odometry = whole.session.odometry
    kept = odometry.stamps_ns < 15 * S
    odometry = replace(
        odometry,
        stamps_ns=odometry.stamps_ns[kept],
        arrivals_ns=odometry.arrivals_ns[kept],
        values=odometry.values[kept],
    )
    session = replace(whole.session, frames=frames, odometry=odometry)
    return replace(whole, session=session, edits=whole.edits[: len(frames)])


def done(recording, kind, seed=1, at_s=None, for_s=None):
    span = fault_span(recording, chosen_fault(kind), at_s, for_s)
    return corrupted(recording, kind, span, seed), span


def written(recording, changed, out):
    write_recording(recording, changed, out, {"kind": "test"}, lambda *_: None)
    return read_session(out)


@pytest.mark.parametrize("kind", FAULTS)
def test_every_kind_changes_something_and_leaves_a_session(recording, kind, tmp_path):
    changed, _ = done(recording, kind)
    session = written(recording, changed, tmp_path / "out")
    before = recording.session
    stamps = [(frame.stamp_ns, frame.arrival_ns, frame.filename) for frame in session.frames]
    same = (
        stamps == [(frame.stamp_ns, frame.arrival_ns, frame.filename) for frame in before.frames]
        and np.array_equal(session.odometry.values, before.odometry.values)
        and np.array_equal(session.wire_map.endpoints, before.wire_map.endpoints)
    )
    assert not same


@pytest.mark.parametrize("kind", ["late", "blocked", "map-moved", "map-missing", "doubled"])
def test_a_seed_gives_the_same_fault_and_another_gives_another(recording, kind):
    def told(seed):
        changed, _ = done(recording, kind, seed, 2.0, 10.0)
        frames = [(frame.arrival_ns, frame.filename) for frame in changed.session.frames]
        return frames, changed.session.odometry.values.tolist(), changed.document.model_dump()

    assert told(1) == told(1)
    assert told(1) != told(2) or told(1) != told(3)


@pytest.mark.parametrize(
    ("kind", "low", "high"), [("blackout", 0, 20), ("whiteout", 235, 255)]
)  # fmt: skip
def test_pictures_of_the_span_alone_are_covered(recording, kind, low, high, tmp_path):
    changed, span = done(recording, kind, at_s=4.0, for_s=5.0)
    session = written(recording, changed, tmp_path / "out")
    for before, after in zip(recording.session.frames, session.frames, strict=True):
        if span.start_ns <= before.stamp_ns < span.end_ns:
            assert low <= read_image(after.path).min() <= read_image(after.path).max() <= high
        else:
            assert after.path.read_bytes() == before.path.read_bytes()
            assert after.filename == before.filename


def test_blur_takes_the_edges_and_leaves_the_light(recording):
    changed, _ = done(recording, "blur", at_s=0.0, for_s=100.0)
    image = read_image(recording.session.frames[0].path)
    blurred = changed.edits[0](image)
    assert blurred.mean() == pytest.approx(image.mean(), abs=1.0)
    assert np.abs(np.diff(blurred.astype(float))).mean() < 0.5 * np.abs(np.diff(image.astype(float))).mean()


def test_the_occluder_covers_half(recording):
    changed, _ = done(recording, "occluder", at_s=0.0, for_s=100.0)
    image = read_image(recording.session.frames[0].path)
    covered = changed.edits[0](image)
    flat = covered == np.bincount(covered.ravel()).argmax()
    assert flat.mean() == pytest.approx(0.5, abs=0.05)
    assert (covered == image).mean() == pytest.approx(0.5, abs=0.06)


def test_a_bumped_camera_sees_everything_one_degree_aside(recording):
    camera = recording.session.camera
    assert camera is not None
    changed, _ = done(recording, "bumped", at_s=0.0)
    dots = np.zeros((camera.height, camera.width), np.uint8)
    places = [(120, 160), (240, 320), (330, 500)]
    for row, column in places:
        dots[row - 2 : row + 3, column - 2 : column + 3] = 255
    seen = changed.edits[0](dots)
    rows, columns = np.nonzero(seen > 128)
    for row, column in places:
        near = np.hypot(rows - row, columns - column) < 40
        found = np.array([[columns[near].mean(), rows[near].mean()], [column, row]], float)
        rays = np.column_stack([camera.undistort(found), np.ones(2)])
        rays /= np.linalg.norm(rays, axis=1)[:, None]
        turn_deg = np.degrees(np.arccos(np.clip(rays[0] @ rays[1], -1.0, 1.0)))
        # A turn about the line of sight moves less.
        assert turn_deg < 1.05
    rotations = [done(recording, "bumped", seed)[0].edits[-1](dots) for seed in range(4)]
    assert any(not np.array_equal(rotations[0], other) for other in rotations[1:])


def test_slip_adds_half_a_metre_to_both_wheels(recording):
    changed, span = done(recording, "slip", at_s=5.0)
    before, after = recording.session.odometry, changed.session.odometry
    gained_m = (after.values - before.values) * before.wheels.left_radius_m
    assert np.abs(gained_m[before.stamps_ns <= span.start_ns]).max() == 0.0
    assert gained_m[-1] == pytest.approx([0.5, 0.5])


def test_a_blocked_wheel_stands_while_the_other_goes_on(recording):
    changed, span = done(recording, "blocked")
    before, after = recording.session.odometry, changed.session.odometry
    inside = span.holds(before.stamps_ns)
    moved = np.ptp(after.values[inside], axis=0)
    assert sorted(moved > 1e-9) == [False, True]
    assert np.diff(after.values[~inside & (before.stamps_ns > span.end_ns)], axis=0) == pytest.approx(
        np.diff(before.values[~inside & (before.stamps_ns > span.end_ns)], axis=0)
    )


def test_a_jump_is_between_two_rows_of_one_wheel(recording):
    changed, _ = done(recording, "jump", at_s=5.0)
    steps = np.diff(changed.session.odometry.values - recording.session.odometry.values, axis=0)
    assert np.count_nonzero(np.abs(steps) > 1e-9) == 1
    assert np.abs(steps).max() == pytest.approx(10.0)


def test_dropout_takes_odometrys_rows_and_no_others(recording):
    changed, span = done(recording, "odometry-dropout", at_s=5.0, for_s=3.0)
    stamps = changed.session.odometry.stamps_ns
    assert not span.holds(stamps).any()
    assert len(stamps) == (~span.holds(recording.session.odometry.stamps_ns)).sum()


def test_late_frames_overtake_each_other_and_are_never_early(recording):
    changed, _ = done(recording, "late", at_s=0.0)
    arrivals = [frame.arrival_ns for frame in changed.session.frames]
    stamps = [frame.stamp_ns for frame in changed.session.frames]
    assert stamps == [frame.stamp_ns for frame in recording.session.frames]
    assert all(0 <= at - stamp <= 3 * S for at, stamp in zip(arrivals, stamps, strict=True))
    assert arrivals != sorted(arrivals)


def test_a_doubled_frame_shows_the_picture_before_at_its_own_stamp(recording):
    changed, _ = done(recording, "doubled", at_s=0.0, for_s=100.0)
    before, after = recording.session.frames, changed.session.frames
    assert [frame.stamp_ns for frame in before] == [frame.stamp_ns for frame in after]
    repeated = [at for at in range(1, len(after)) if after[at].path == after[at - 1].path]
    assert 0 < len(repeated) < len(after) - 1


def test_clocks_off_and_drifting(recording):
    stamps = np.array([frame.stamp_ns for frame in recording.session.frames])
    off, span = done(recording, "clock-offset", at_s=5.0)
    shift = np.array([frame.stamp_ns for frame in off.session.frames]) - stamps
    assert set(shift[stamps < span.start_ns]) == {0}
    assert set(np.abs(shift[stamps >= span.start_ns])) == {S // 10}
    drifting, span = done(recording, "clock-drift", at_s=5.0)
    shift = np.array([frame.stamp_ns for frame in drifting.session.frames]) - stamps
    since = np.maximum(stamps - span.start_ns, 0)
    assert np.abs(shift) == pytest.approx(1e-3 * since, abs=1.0)


def test_maps_lose_gain_and_move_edges(recording):
    count = len(recording.document.segments)
    assert len(done(recording, "map-missing")[0].document.segments) == count - int(0.2 * count)
    assert len(done(recording, "map-extra")[0].document.segments) == count + int(0.2 * count)
    moved = done(recording, "map-moved")[0].document.segments
    for before, after in zip(recording.document.segments, moved, strict=True):
        assert np.linalg.norm(np.subtract(after.p0, before.p0)) == pytest.approx(0.05)
        assert np.subtract(after.p1, before.p1) == pytest.approx(np.subtract(after.p0, before.p0))


def test_one_door_moves_along_its_wall_as_a_whole(recording):
    changed = done(recording, "door-moved")[0].document.segments
    shifts = {
        (one.name.rsplit("/", 1)[0], tuple(np.round(np.subtract(other.p0, one.p0), 6)))
        for one, other in zip(recording.document.segments, changed, strict=True)
        if one != other
    }
    assert len(shifts) == 1
    name, shift = next(iter(shifts))
    frame = [one for one in recording.document.segments if one.name.startswith(f"{name}/")]
    assert sum(one != other for one, other in zip(recording.document.segments, changed, strict=True)) == len(
        frame
    )
    assert np.linalg.norm(shift) == pytest.approx(0.5)


def test_another_building_has_rooms_of_other_sizes(recording, tmp_path):
    changed, _ = done(recording, "wrong-map")
    session = written(recording, changed, tmp_path / "out")
    before = recording.session.wire_map
    assert session.wire_map.floor.area == pytest.approx(before.floor.area * 1.3 * 0.75, rel=1e-3)


def test_what_is_not_touched_is_copied_byte_for_byte(recording, tmp_path):
    changed, _ = done(recording, "slip")
    written(recording, changed, tmp_path / "out")
    source = recording.session.folder
    for name in ("robot.yaml", "map.yaml", "ground_truth_dense.csv", "observable.csv"):
        assert (tmp_path / "out" / name).read_bytes() == (source / name).read_bytes()
    assert yaml.safe_load((tmp_path / "out" / "fault.yaml").read_text()) == {"kind": "test"}


def test_a_corrupted_session_can_be_corrupted_again(recording, tmp_path):
    first, _ = done(recording, "blackout", at_s=2.0, for_s=4.0)
    written(recording, first, tmp_path / "first")
    again = read_recording(tmp_path / "first")
    second, span = done(again, "whiteout", at_s=7.0, for_s=4.0)
    session = written(again, second, tmp_path / "second")
    levels = [read_image(frame.path).mean() for frame in session.frames]
    assert sum(level < 20 for level in levels) == sum(edit is not None for edit in first.edits)
    assert (
        sum(level > 235 for level in levels)
        == span.holds(np.array([f.stamp_ns for f in session.frames])).sum()
    )


def test_the_command_tells_its_kinds_and_refuses_others(wireloc, toy, tmp_path):
    listed = wireloc("session", "corrupt", toy, "--fault", "list")
    assert listed.code == 0
    assert [line.split()[0] for line in listed.out.splitlines()] == list(FAULTS)
    refused = wireloc("session", "corrupt", toy, "--fault", "flood", "--out", tmp_path / "out")
    assert refused.code == 2
    assert "flood" in refused.err
    assert refused.err.count("\n") == 1


def test_the_command_writes_a_session_of_fixes_that_runs(wireloc, toy, tmp_path):
    out = tmp_path / "out"
    made = wireloc("session", "corrupt", toy, "--fault", "slip", "--out", out, "--at", 3, "--seed", 4)
    assert made.code == 0
    told = yaml.safe_load((out / "fault.yaml").read_text())
    assert told == {"kind": "slip", "seed": 4, "start_s": 3.0, "end_s": 4.0}
    assert read_session(out).odometry.values[-1] - read_session(toy).odometry.values[-1] == pytest.approx(
        10.0
    )
    assert wireloc("run", out, "--out", tmp_path / "run", "--log", "off").code == 0


@pytest.mark.parametrize(
    ("kind", "what"), [("blackout", "fault of images"), ("map-missing", "fault of the map")]
)
def test_a_session_without_what_is_to_fail_is_refused(toy, kind, what):
    recording = read_recording(toy)
    with pytest.raises(InputError, match=what):
        corrupted(recording, kind, Span(0, S), 0)


def test_a_fault_past_the_end_is_refused(recording):
    with pytest.raises(InputError, match="past the session's end"):
        fault_span(recording, FAULTS["slip"], at_s=99.0)


def test_twists_are_written_as_they_were_recorded(toy, tmp_path):
    rows = [f"{time / 10:.1f},0.4,0.3" for time in range(80)]
    (toy / "odometry.csv").write_text("\n".join(["timestamp_s,forward_mps,turn_radps", *rows]) + "\n")
    text = (toy / "robot.yaml").read_text() + "twist: {forward_scale: 1.25, turn_scale: 0.5}\n"
    (toy / "robot.yaml").write_text(text)
    recording = read_recording(toy)
    changed, span = done(recording, "slip", at_s=3.0)
    session = written(recording, changed, tmp_path / "out")
    gained = session.odometry.values - recording.session.odometry.values
    inside = span.holds(session.odometry.stamps_ns)
    assert gained[inside, 0] == pytest.approx(0.5)
    assert np.abs(gained[~inside]).max() < 1e-6
