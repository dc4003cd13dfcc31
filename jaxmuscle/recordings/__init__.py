"""Recordings and their cards: from files in the units of the bench to SI, checked at the door."""

from jaxmuscle.recordings.card import Card, actuator_from_card
from jaxmuscle.recordings.read import read
from jaxmuscle.recordings.recording import Recording, recording
from jaxmuscle.recordings.schema import ColumnSpec, Quantity

__all__ = ["Card", "ColumnSpec", "Quantity", "Recording", "actuator_from_card", "read", "recording"]
