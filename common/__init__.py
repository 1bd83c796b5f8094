"""Shared parts of all services: buses, the process loop, geometry, inference, metrics.

Two libraries send telemetry once imported, so this package switches it off. Every process of
people4d imports it first, and passes the environment variable to its children.
"""

import os
import sys

os.environ["ORT_DISABLE_TELEMETRY"] = "1"  # must be set before onnxruntime is imported
sys.modules["openvino_telemetry"] = None  # type: ignore[assignment]  # OpenVINO has a stub for it
