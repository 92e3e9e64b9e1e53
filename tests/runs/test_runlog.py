"""Records and logs: the columns of the contract, and logs that hear everything."""

import numpy as np

from maps.outcomes import PoseBelief
from maps.poses import Pose2
from runs.runlog import COLUMNS, LogGroup, NullLog, Trajectories, Trajectory

HEADER = (
    "timestamp_s,arrival_s,filename,state,prior_x_m,prior_y_m,prior_phi_rad,window_dt_m,window_dphi_rad,"
    "segments,selected,hypotheses,matches,outcome,reason,fix_x_m,fix_y_m,fix_phi_rad,fix_sxx,fix_sxy,"
    "fix_sxp,fix_syy,fix_syp,fix_spp,verdict,nis,x_m,y_m,phi_rad,sxx,sxy,sxp,syy,syp,spp,extract_ms,"
    "match_ms,update_ms"
)


class Listener(NullLog):
    """Remember the beliefs heard."""

    def __init__(self):
        self.heard = []

    def belief(self, belief):
        self.heard.append(belief)


def test_columns_are_those_of_the_contract():
    assert ",".join(COLUMNS) == HEADER


def test_group_passes_on_to_everybody():
    nothing = Trajectory.of_beliefs([])
    belief = PoseBelief(0, Pose2(0.0, 0.0, 0.0), np.eye(3))
    first, second = Listener(), Listener()
    group = LogGroup((first, second))
    group.belief(belief)
    group.finish(Trajectories(nothing, nothing, nothing, nothing))
    assert first.heard == second.heard == [belief]


def test_trajectory_of_nothing_and_of_poses():
    assert len(Trajectory.of_beliefs([])) == 0
    assert Trajectory.of_beliefs([]).covariances.shape == (0, 3, 3)
    track = Trajectory.of_poses([(5, Pose2(1.0, 2.0, 3.0))])
    assert track.poses.tolist() == [[1.0, 2.0, 3.0]]
    assert track.covariances is None
