"""Evaluation: errors with units, and whether covariances are as large as the errors they promise.

Trajectories are associated by stamps, compared absolutely or relatively, and summarized; all angles are radians until a
table is printed. The figures equal those of evo's command line.
"""

from factorloc.evaluation.absolute import AbsoluteErrors, absolute_errors
from factorloc.evaluation.alignment import align, transform_trajectory
from factorloc.evaluation.association import Association, associate
from factorloc.evaluation.consistency import Consistency, covariance_factor, nees
from factorloc.evaluation.pose_errors import PoseErrors
from factorloc.evaluation.relative import RelativeErrors, StepUnit, relative_errors, step_pairs
from factorloc.evaluation.report import Report, evaluate
from factorloc.evaluation.statistics import ErrorStatistics

__all__ = [
    "AbsoluteErrors",
    "Association",
    "Consistency",
    "ErrorStatistics",
    "PoseErrors",
    "RelativeErrors",
    "Report",
    "StepUnit",
    "absolute_errors",
    "align",
    "associate",
    "covariance_factor",
    "evaluate",
    "nees",
    "relative_errors",
    "step_pairs",
    "transform_trajectory",
]
