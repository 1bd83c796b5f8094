"""Run the predictor."""

import sys

from common.runtime import process
from services.predictor.build import build
from services.predictor.config import PredictorConfig

if __name__ == "__main__":
    sys.exit(process.main("predictor", PredictorConfig, build))
