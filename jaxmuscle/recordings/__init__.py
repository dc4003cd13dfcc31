"""Recordings and their cards: from files in the units of the bench to SI, checked at the door."""

from jaxmuscle.recordings.card import Card, actuator_from_card
from jaxmuscle.recordings.data_sheets import DataSheet, data_sheet
from jaxmuscle.recordings.from_arrays import recording
from jaxmuscle.recordings.read import read
from jaxmuscle.recordings.recording import Recording
from jaxmuscle.recordings.row_selection import LongRecording
from jaxmuscle.recordings.schema import ColumnSpec, Quantity

__all__ = [
    "Card",
    "ColumnSpec",
    "DataSheet",
    "LongRecording",
    "Quantity",
    "Recording",
    "actuator_from_card",
    "data_sheet",
    "read",
    "recording",
]
