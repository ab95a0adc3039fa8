"""Recordings and building maps: readers that turn files into drives and outlines, and the registry of known files.

A :class:`Drive` holds scans, the odometry between them and, where there is one, the truth; the two never mix. Every
reader counts what it used, passed over and found damaged (:class:`ReadReport`).
"""

from factorloc.datasets.buildings import BUILDING_READERS, BuildingReader, read_buildings
from factorloc.datasets.carmen import CarmenReader, read_carmen
from factorloc.datasets.drive import Drive
from factorloc.datasets.kitti_odometry import KittiOdometryReader, read_kitti_odometry
from factorloc.datasets.kitti_raw import KittiRawReader, read_kitti_raw
from factorloc.datasets.nclt import NcltReader, read_nclt
from factorloc.datasets.pairing import match_scans, pair_raw_with_corrected
from factorloc.datasets.reader import READERS, Reader, open_drive
from factorloc.datasets.registry import KNOWN_FILES, KnownFile, data_folder, known_max_range, log_name
from factorloc.datasets.relations import Relations, read_relations
from factorloc.datasets.report import Damage, ReadReport

__all__ = [
    "BUILDING_READERS",
    "KNOWN_FILES",
    "READERS",
    "BuildingReader",
    "CarmenReader",
    "Damage",
    "Drive",
    "KittiOdometryReader",
    "KittiRawReader",
    "KnownFile",
    "NcltReader",
    "ReadReport",
    "Reader",
    "Relations",
    "data_folder",
    "known_max_range",
    "log_name",
    "match_scans",
    "open_drive",
    "pair_raw_with_corrected",
    "read_buildings",
    "read_carmen",
    "read_kitti_odometry",
    "read_kitti_raw",
    "read_nclt",
    "read_relations",
]
