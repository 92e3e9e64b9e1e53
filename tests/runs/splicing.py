"""Sessions to which something happens: robots that are moved unawares, cameras that are covered."""

import csv
import dataclasses

import numpy as np

from runs.evaluation import read_truth
from runs.runlog import Trajectory
from runs.session import read_session
from vision.encoding import jpeg


def moved_unawares(folder, cut_s, gone_s):
    """Return session and truth of a folder without what happened from `cut_s` on for `gone_s`.

    What comes after is moved to the cut, in time and on the wheels: somebody carried the robot.
    """
    session, truth = read_session(folder), read_truth(folder)
    cut_ns, gone_ns = round(cut_s * 1e9), round(gone_s * 1e9)

    def later(stamps_ns):
        return np.where(stamps_ns < cut_ns, stamps_ns, stamps_ns - gone_ns)

    def kept(stamps_ns):
        return (stamps_ns < cut_ns) | (stamps_ns >= cut_ns + gone_ns)

    odometry = session.odometry
    left = kept(odometry.stamps_ns)
    values, stamps_ns = odometry.values[left].copy(), odometry.stamps_ns[left]
    first = int(np.argmax(stamps_ns >= cut_ns))
    if odometry.wheels is not None:
        values[first:] += values[first - 1] - values[first]
    odometry = dataclasses.replace(
        odometry, stamps_ns=later(stamps_ns), arrivals_ns=later(odometry.arrivals_ns[left]), values=values
    )
    frames = tuple(
        dataclasses.replace(
            frame, stamp_ns=int(later(frame.stamp_ns)), arrival_ns=int(later(frame.arrival_ns))
        )
        for frame in session.frames
        if kept(frame.stamp_ns)
    )
    left = kept(truth.stamps_ns)
    truth = Trajectory(later(truth.stamps_ns[left]), truth.poses[left])
    return dataclasses.replace(session, odometry=odometry, frames=frames), truth


def observable_frames(folder):
    """Return the names of the frames in which five map edges or more can be found."""
    with (folder / "observable.csv").open() as file:
        return {row["filename"] for row in csv.DictReader(file) if int(row["observable"]) >= 5}


def covered(folder, scratch, from_s, to_s):
    """Return the session of a folder whose camera sees nothing for a time; `scratch`: for the black picture."""
    session = read_session(folder)
    assert session.camera is not None
    black = scratch / "black.jpg"
    black.write_bytes(jpeg(np.full((session.camera.height, session.camera.width), 8, np.uint8)))
    frames = [
        dataclasses.replace(frame, path=black) if from_s * 1e9 <= frame.stamp_ns < to_s * 1e9 else frame
        for frame in session.frames
    ]
    return dataclasses.replace(session, frames=tuple(frames))
