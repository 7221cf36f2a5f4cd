"""Regulation: maps from an exosystem's state to the plant's state and input."""

from invtrack.regulation.admissible import InadmissibleState
from invtrack.regulation.exosystem_map import exosystem_map
from invtrack.regulation.francis import Regulator, francis
from invtrack.regulation.francis_map import single_francis, switched_francis
from invtrack.regulation.map_certificate import RegulationCertificate
from invtrack.regulation.regulation_map import RegulationMap

__all__ = [
    "InadmissibleState",
    "RegulationCertificate",
    "RegulationMap",
    "Regulator",
    "exosystem_map",
    "francis",
    "single_francis",
    "switched_francis",
]
