"""From a recording to the effect that its model lacks."""

from jaxmuscle.diagnosis.loop import diagnose
from jaxmuscle.diagnosis.result import Diagnosis

__all__ = ["Diagnosis", "diagnose"]
