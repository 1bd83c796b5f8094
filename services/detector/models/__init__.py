"""People models: an image in, people with box, score and keypoints or mask out."""

from services.detector.config import ModelSettings
from services.detector.models.base import DetectedPerson, InstanceMask, PersonModel
from services.detector.models.registry import MODELS, check_model, load_model

__all__ = [
    "MODELS",
    "DetectedPerson",
    "InstanceMask",
    "ModelSettings",
    "PersonModel",
    "check_model",
    "load_model",
]
