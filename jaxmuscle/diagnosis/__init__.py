"""Diagnosis of a recording: the effect that its model lacks."""

from jaxmuscle.diagnosis.diagnose import diagnose
from jaxmuscle.diagnosis.result import Diagnosis

__all__ = ["Diagnosis", "diagnose"]
