"""People models: an image in, people with box, score and keypoints or mask out."""

from services.detector.models.base import InstanceMask, ModelSettings, Person, PersonModel
from services.detector.models.registry import MODELS, load_model

__all__ = ["MODELS", "InstanceMask", "ModelSettings", "Person", "PersonModel", "load_model"]
